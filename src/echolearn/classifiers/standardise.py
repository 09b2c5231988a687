"""Standardisation that survives heavy tails.

Ratios and powers have tails that reach a hundred deviations. Each entry is clipped to the middle 99
% of its training values, then centred and scaled by what is left:

    z = (clip(x, q_0.005, q_0.995) - mean) / deviation

Clipping also bounds what a network is asked to extrapolate to in a room it has never seen.
"""

import numpy as np
import torch

from echolearn.classifiers.constants import Formula
from echolearn.classifiers.inputs import Inputs

TAIL = 0.005
"""Share of the training values clipped on either side."""


def standardiser(x: Inputs, *, rows: int = 4000) -> Formula:
    """Return the map x -> z with the constants that training inputs call for.

    Args:
        x: training inputs, shape (B, ...).
        rows: at most this many, evenly spread, are looked at.
    """
    some = np.asarray(x[:: -(-len(x) // rows)], dtype=float)
    low, high = np.quantile(some, [TAIL, 1.0 - TAIL], axis=0)
    clipped = np.clip(some, low, high)
    deviation = clipped.std(axis=0)

    # An entry that never varies says nothing: it becomes 0 rather than 0 / 0.
    scale = np.where(deviation > 0, deviation, 1.0)
    return Formula(standardise, low=low, high=high, mean=clipped.mean(axis=0), scale=scale)


def standardise(
    x: torch.Tensor,
    *,
    low: torch.Tensor,
    high: torch.Tensor,
    mean: torch.Tensor,
    scale: torch.Tensor,
) -> torch.Tensor:
    """Return z, shape (B, ...), computed in float64 and returned in float32.

    Args:
        x: raw inputs, shape (B, ...).
        low, high, mean, scale: the constants, shape (...).
    """
    clipped = torch.minimum(torch.maximum(x.double(), low), high)
    return ((clipped - mean) / scale).float()
