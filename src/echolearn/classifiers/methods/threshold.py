"""A bare threshold on one column, the baseline of every learned classifier.

    d = s (x - mean) / deviation,     s = +1 or -1 so that reflectors have the larger d in training

The only things learned are the scale and the sign; the cut itself is chosen like everyone's, on
validation data.
"""

from dataclasses import dataclass, field
from typing import Self

import torch
from scipy.stats import rankdata

from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.classifiers.classifier import Examples
from echolearn.classifiers.constants import Formula
from echolearn.classifiers.inputs import Inputs, as_input, check_inputs


@dataclass
class Threshold:
    """A monotone function of one column.

    Attributes:
        inputs: name of the column, alone in a list.
    """

    inputs: tuple[str, ...]
    mean: float = field(init=False, repr=False)
    slope: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.inputs = check_inputs(self.inputs)
        shown = list(self.inputs)
        allowed = "a threshold looks at one column"
        check(len(self.inputs) == 1, "classifier.inputs", shown, allowed=allowed)

    def fit(self, examples: Examples) -> Self:
        """Learn scale and sign."""
        column = as_input(examples.x, self.inputs)[:, 0].astype(float)
        y = examples.y

        # Ranks, not values: a few huge outliers would decide the sign of a difference of means.
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
        return Formula(affine, mean=self.mean, slope=self.slope)


def affine(x: torch.Tensor, *, mean: torch.Tensor, slope: torch.Tensor) -> torch.Tensor:
    """Return (x - mean) slope of the only column, shape (B,), in float64.

    Args:
        x: shape (B, 1).
        mean, slope: numbers.
    """
    return (x[:, 0].double() - mean) * slope
