"""What is to be learned from which rows of a labelled set.

    positions --> 80 % | 20 % test;   the 80 % --> 80 % training | 20 % validation

The paper's 1 989 rows become 1 273 for training, 318 for validation, 398 for testing. Rows of one
position never part. `split="row"` lets them, and shows what that leak is worth.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import check, check_number
from echolearn.classifiers.inputs import Rows, is_tensor, rows_of, stack_inputs
from echolearn.dataset.labelled_set import Dataset
from echolearn.storage.tables import check_plain
from echolearn.training.fields import FIELDS


class Parts(NamedTuple):
    """Row indices of a set's three parts."""

    train: Array
    validation: Array
    test: Array


@dataclass(frozen=True)
class LearningProblem:
    """A labelled set, the label to learn, and a division of the rows that these fields determine.

    Attributes:
        dataset: labelled observations.
        target: label to learn, "on_map", "time_and_direction" or "reflector" (the paper's); of
            hypotheses of walls "is_wall".
        seed: seed of the division.
        split: unit that is never divided, "position", or the leaky "row".
        test_share: share of all positions that is for testing.
        validation_share: share of the other positions that is for validation.
        train_rows: most rows to train on, whole positions of those for training; None takes all.
            Fewer are part of more, and validation and test rows are the same.
    """

    dataset: Dataset
    target: str = "on_map"
    seed: int = 0
    split: str = "position"
    test_share: float = 0.2
    validation_share: float = 0.2
    train_rows: int | None = None

    def __post_init__(self) -> None:
        check_plain("", vars(self), table=FIELDS)

    def identity(self) -> dict[str, Any]:
        """Return what tells this problem from all others, as plain containers."""
        fields = dict(vars(self))
        dataset = fields.pop("dataset")
        # What learns from all rows has the identity of before there was a choice.
        if self.train_rows is None:
            del fields["train_rows"]
        return {"plan": dataset.name, "data": dataset.digest, **fields}

    def inputs(self, names: Sequence[str]) -> Rows:
        """Return what a classifier with these inputs sees, (B, K), or a tensor (B, ...).

        Columns are read now, a tensor stays in the set's shards until its rows are asked for.
        """
        if is_tensor(names):
            numbers = np.arange(len(self.dataset))
            # Without rows this reads nothing, and fails now if there is no such tensor.
            self.dataset.gather(names[0], numbers[:0])
            return Rows(partial(self.dataset.gather, names[0]), numbers, names)
        return rows_of(stack_inputs(names, self.dataset), names)

    def labels(self) -> Array:
        """Return the target of every row, shape (B,), bool."""
        return self.dataset[self.target].astype(bool)

    def groups(self) -> Array:
        """Return the unit that is never divided, of each row, shape (B,)."""
        return groups_of(self.dataset, split=self.split)

    def parts(self) -> Parts:
        """Return the rows for training, validation and testing.

        Raises:
            BadValue: a part lacks one of the labels.
        """
        rest, test = split_groups(self.groups(), share=self.test_share, seed=self.seed)
        return self._divide(rest, test)

    def folds(self, count: int) -> Iterator[Parts]:
        """Yield `count` parts whose test rows together are all rows that `parts` does not test on.

        Raises:
            BadValue: a part lacks one of the labels.
        """
        groups = self.groups()
        parts = self.parts()
        known = np.sort(np.concatenate([parts.train, parts.validation]))
        # Whole groups are dealt out, so that folds are as disjoint as the parts.
        shuffled = np.random.default_rng(self.seed).permutation(np.unique(groups[known]))
        for chosen in np.array_split(shuffled, count):
            held = np.isin(groups[known], chosen)
            yield self._divide(known[~held], known[held])

    def _divide(self, rest: Array, test: Array) -> Parts:
        groups = self.groups()[rest]
        first, second = split_groups(groups, share=self.validation_share, seed=self.seed)
        first = first[self._taken(groups[first])]
        parts = Parts(rest[first], rest[second], test)

        # With one class alone there is nothing to learn, no threshold to choose, no curve to draw.
        y = self.labels()
        for part, rows in parts._asdict().items():
            count = int(y[rows].sum())
            shown = f"{count} of {len(rows)} are {self.target}"
            allowed = "must hold both classes"
            enough = 0 < count < len(rows)
            check(enough, f"{part} rows", shown, allowed=allowed, hint="use a larger set")
        return parts

    def _taken(self, groups: Array) -> Array:
        """Return which rows for training, given by their groups (B,), are trained on, (B,)."""
        if self.train_rows is None:
            return np.ones(len(groups), dtype=bool)
        unique, member, counts = np.unique(groups, return_inverse=True, return_counts=True)
        # In one order for any number of rows, so that a learning curve adds rows to those before.
        order = np.random.default_rng([self.seed, 1]).permutation(len(unique))
        taken = order[np.cumsum(counts[order]) <= self.train_rows]
        return np.isin(member, taken)


def groups_of(dataset: Dataset, *, split: str) -> Array:
    """Return the unit of each row that a split never divides, shape (B,)."""
    return dataset["group"] if split == "position" else np.arange(len(dataset))


def split_groups(groups: Array, *, share: float, seed: int) -> tuple[Array, Array]:
    """Split rows so that no group falls on both sides.

    Args:
        groups: position of each row, shape (B,).
        share: share of the groups that goes to the second part, 0 to 1.
        seed: seed of the shuffle.

    Returns:
        Row indices of the first and of the second part, ascending.
    """
    check_number("share", share, low=0.0, high=1.0)
    # The order of groups, not of rows, is drawn: it is the same for any number of rows in each.
    unique = np.unique(groups)
    chosen = np.random.default_rng(seed).permutation(unique)[: round(share * len(unique))]
    second = np.isin(groups, chosen)
    return np.flatnonzero(~second), np.flatnonzero(second)
