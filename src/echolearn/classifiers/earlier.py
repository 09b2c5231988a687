"""A filter that was trained before, from which another classifier begins: a bundle, or a run.

    init --read--> EarlierFilter --begin--> a classifier that has it --fit--> adapted

All that a bundle tells of its model is an ONNX file, from inputs to a confidence c. What a
regression looks at is the logit of that, log c - log (1 - c), which grows with what the filter
believes and has no ends at which it saturates.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.classifiers.inputs import Inputs, Rows

SUREST = 1e-9
"""Distance of a confidence from 0 and 1 at least, so that its logit is finite."""


class Learned(NamedTuple):
    """What a network is trained on from.

    Attributes:
        rows: inputs that it was trained on, which fix its scaler.
        weights: content of its safetensors file.
        mapping: from its decisions to confidences, as they were calibrated.
    """

    rows: Rows
    weights: bytes
    mapping: Callable[[Array], Array]


@dataclass(frozen=True)
class EarlierFilter:
    """A trained filter.

    Attributes:
        told: what metrics say of it: `kind` (bundle or run), `name`, `sha256`, as `data` the
            digests of all sets that it has learned from, and how many `places` it is adapted to.
        classifier: what it is called in names.
        microphones: positions of its array in m, (M, 3); None: not known.
        inputs: columns that it sees, or its one tensor.
        model: ONNX file, float32 (B, ...) to confidences (B,).
        open: returns what the file computes; called when it is first asked for.
        learned: returns what a network is trained on from; of a run of a network alone.
    """

    told: Mapping[str, Any]
    classifier: str
    inputs: tuple[str, ...]
    microphones: list[list[float]] | None
    model: bytes
    open: Callable[[], Callable[[Inputs], Array]]
    learned: Callable[[], Learned] | None = None

    @cached_property
    def compute(self) -> Callable[[Inputs], Array]:
        """Function from inputs (B, ...) to confidences (B,)."""
        return self.open()

    def logit(self, x: Inputs) -> Array:
        """Return what it believes of inputs (B, ...) without ends, float32, shape (B,)."""
        confidence = np.clip(np.asarray(self.compute(x), dtype=float), SUREST, 1.0 - SUREST)
        found: Array = (np.log(confidence) - np.log(1.0 - confidence)).astype(np.float32)
        return found
