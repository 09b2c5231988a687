"""Batches of standardised inputs, from memory or from the shards of a set.

    rows (set) --standardise--> whole tensor --index--> batch        at most `IN_MEMORY` bytes
    rows (set) --gather--> rows of a batch --standardise--> batch    beyond

At the sizes of the first kind workers and collation would cost more than the arithmetic. With the
second kind, a batch of 128 covariances costs a third more, and memory does not grow with the number
of rows. The batches are the same to the last bit: each entry is standardised by itself.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import torch

from echolearn.acoustics.types import Array
from echolearn.classifiers.inputs import Rows, blocks_of

BLOCK = 2048
"""Rows standardised or scored at once."""

IN_MEMORY = 64 * 2**20
"""Bytes of standardised inputs, of training and of validation rows each, kept as one tensor."""

Source = Callable[[torch.Tensor], torch.Tensor]
"""From indices (B,) to standardised inputs (B, ...)."""


class Batches:
    """Inputs and labels in equal parts, reshuffled at each pass if there is a seed."""

    def __init__(
        self,
        source: Source,
        y: Array,
        *,
        size: int,
        seed: int | None = None,
        walks: Array | None = None,
    ) -> None:
        """Divide rows into batches.

        Args:
            source: where standardised inputs come from.
            y: labels, shape (B,).
            size: rows in a batch, about.
            seed: seed of the order; None leaves the rows in theirs.
            walks: number 0, 1, 2 ... of the walk of each row, (B,), of which none is parted; None:
                each row by itself.
        """
        self.source = source
        self.y = torch.from_numpy(np.asarray(y).astype(np.float32))
        self.rows = len(y)
        self.members = None
        if walks is not None:
            ends = np.flatnonzero(np.diff(walks)) + 1
            self.members = torch.arange(self.rows).tensor_split(ends.tolist())
        self.count = max(1, round(self.rows / size))
        self.generator = None if seed is None else torch.Generator().manual_seed(seed)

    def __iter__(self) -> Iterator[tuple[torch.Tensor, torch.Tensor]]:
        units = self.rows if self.members is None else len(self.members)
        order = torch.arange(units)
        if self.generator is not None:
            order = torch.randperm(units, generator=self.generator)
        for part in order.tensor_split(min(self.count, units)):
            rows = part
            if self.members is not None:
                rows = torch.cat([self.members[each] for each in part.tolist()])
            yield self.source(rows), self.y[rows]


@dataclass(frozen=True)
class WholeEpoch:
    """A loader of one item, all batches of an epoch: Lightning takes one step through it."""

    batches: Batches

    def __len__(self) -> int:
        return 1

    def __iter__(self) -> Iterator[Batches]:
        yield self.batches


def source_of(rows: Rows, standardise: torch.nn.Module) -> Source:
    """Return where batches come from: one tensor if it is small enough, else the shards."""
    if 4 * math.prod(rows.shape) > IN_MEMORY:
        return lambda indices: standardise(torch.from_numpy(rows[indices.numpy()]))
    whole = torch.empty(rows.shape)
    start = 0
    for block in blocks_of(rows, rows.inputs, size=BLOCK):
        whole[start : start + len(block)] = standardise(torch.from_numpy(block))
        start += len(block)
    return whole.__getitem__
