"""Matched filters about an echo: as they are, or aligned at all microphones."""

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.localization.correlations import PAD, advance
from echolearn.localization.matched_filter import MatchedFilter

SEGMENT = 64
"""Lags of the matched filters around an echo from which its tensors are taken."""


def align(matched: MatchedFilter, index: Array, *, toward: Array) -> Array:
    """Return r_m(toa + eta_m + k) for `SEGMENT` lags k around 0, shape (B, M, SEGMENT).

    Args:
        matched: matched-filter view of B observations.
        index: lag indices of the echoes, shape (B,).
        toward: unit vectors for which microphones are delayed by eta_m, shape (B, 3).
    """
    advanced = advance(matched.padded, matched.eta(toward)[:, None])
    return cut(advanced[:, 0], index)


def cut(padded: Array, index: Array) -> Array:
    """Return `SEGMENT` lags centred on lag indices (B,) of `padded` (B, M, L + 2 PAD)."""
    lags = index[:, None] + PAD - SEGMENT // 2 + np.arange(SEGMENT)
    return np.take_along_axis(padded, lags[:, None, :], axis=-1)
