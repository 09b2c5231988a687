"""A bare threshold on one column, the yardstick of every learned classifier.

    d = s (x - mean) / deviation,     s = +1 or -1 so that reflectors lie on the upper side of the training set

The only things learned are the scale and the sign; the cut itself is chosen like everyone's, on
validation data.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Self

import torch
from scipy.stats import rankdata

from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.classifiers.inputs import FEATURES, Inputs, as_input, check_inputs, check_labels


@dataclass
class Threshold:
    """A monotone function of one column.

    Attributes:
        inputs: the column's name, alone in a list.
    """

    inputs: tuple[str, ...]
    mean: float = field(init=False, repr=False)
    slope: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.inputs = check_inputs(self.inputs)
        check(len(self.inputs) == 1, "classifier.inputs", list(self.inputs), allowed="one column")

    @property
    def view(self) -> str:
        """Return "features"."""
        return FEATURES

    def fit(
        self,
        x: Inputs,
        y: Array,
        *,
        groups: Array,
        validation: tuple[Inputs, Array],
        folder: Path,
        seed: int,
    ) -> Self:
        """Learn scale and sign; see `Classifier.fit`."""
        column = as_input(x, self.inputs)[:, 0].astype(float)
        y = check_labels(y, len(column))
        ranks = rankdata(column)
        sign = 1.0 if ranks[y].mean() >= ranks[~y].mean() else -1.0
        self.mean = float(column.mean())
        self.slope = sign / (float(column.std()) or 1.0)
        return self

    def decision(self, x: Inputs) -> Array:
        """Return the standardised column, shape (B,)."""
        column: Array = as_input(x, self.inputs)[:, 0].astype(float)
        return (column - self.mean) * self.slope

    def scorer(self) -> torch.nn.Module:
        """Return the function as a torch module."""
        return Line(self.mean, self.slope)


class Line(torch.nn.Module):
    """(x - mean) slope of the only column, in float64."""

    def __init__(self, mean: float, slope: float) -> None:
        super().__init__()
        self.register_buffer("mean", torch.tensor(mean, dtype=torch.float64))
        self.register_buffer("slope", torch.tensor(slope, dtype=torch.float64))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, 1) to (B,)."""
        return (x[:, 0].double() - self.get_buffer("mean")) * self.get_buffer("slope")
