"""Standardisation that survives heavy tails.

Ratios and powers have tails that reach a hundred deviations. Each entry is clipped to the middle 99
% of its training values, then centred and scaled by what is left:

    z = (clip(x, q_0.005, q_0.995) - mean) / deviation

Clipping also bounds what a network is asked to extrapolate to in a room it has never seen.
"""

import numpy as np
import torch

from echolearn.classifiers.constants import register_constants
from echolearn.classifiers.inputs import Inputs

TAIL = 0.005
"""Share of the training values clipped on either side."""


class Standardise(torch.nn.Module):
    """The map x -> z, entry by entry, computed in float64 and returned in float32."""

    low: torch.Tensor
    high: torch.Tensor
    mean: torch.Tensor
    scale: torch.Tensor

    def __init__(self, x: Inputs, rows: int = 4000) -> None:
        """Learn the constants.

        Args:
            x: training inputs, shape (B, ...).
            rows: at most this many, evenly spread, are looked at.
        """
        super().__init__()
        some = np.asarray(x[:: -(-len(x) // rows)], dtype=float)
        low, high = np.quantile(some, [TAIL, 1.0 - TAIL], axis=0)
        clipped = np.clip(some, low, high)
        deviation = clipped.std(axis=0)

        # An entry that never varies says nothing: it becomes 0 rather than 0 / 0.
        scale = np.where(deviation > 0, deviation, 1.0)
        register_constants(self, low=low, high=high, mean=clipped.mean(axis=0), scale=scale)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, ...) to (B, ...)."""
        clipped = torch.minimum(torch.maximum(x.double(), self.low), self.high)
        return ((clipped - self.mean) / self.scale).float()
