"""The echo against the cells around it: the cell-averaging detector of radar, on J(tau, phi).

A threshold on a level must be set anew for every noise. CFAR (constant false alarm rate; Finn and
Johnson, RCA Review 29, 1968) divides the cell under test by the mean power of a ring of reference
cells around it, without the guard cells next to it, over which the echo itself is spread:

    cfar = J(toa, doa) / sqrt(mean of J(tau, phi)^2 over the ring)

Guard cells are nearer than `PEAK_SPACING` lags *and* nearer than `GUARD` in direction; the ring
ends at `REACH` lags and at `OUTER`. Noise that is louder at some times or from some side, a
reverberation that decays within the window, is so taken where the echo is.
"""

import numpy as np

from echolearn.acoustics.geometry import direction
from echolearn.acoustics.types import Array
from echolearn.localization.correlations import ratio_or_zero
from echolearn.localization.matched_filter import PEAK_SPACING, SEGMENT, MatchedFilter, align

REACH = 32
"""Lags on either side of the echo where the ring ends, 25 cm of distance."""

GUARD, OUTER = np.deg2rad(30.0), np.deg2rad(90.0)
"""Angles to the echo's direction, in rad: the main lobe of a small array, and a half space."""


def cfar(matched: MatchedFilter, index: Array, *, toward: Array) -> Array:
    """Return J at the echo over the rms of J in the ring around it, shape (B,).

    Args:
        matched: matched-filter view of B observations.
        index: lag indices of the echoes, shape (B,).
        toward: unit vectors of their directions, shape (B, 3).
    """
    here = align(matched, index, toward=toward)[:, :, SEGMENT // 2].sum(axis=-1)
    power = np.square(matched.steered, dtype=float)
    late = np.abs(np.arange(power.shape[-1]) - index[:, None])[:, None]
    beside = (toward @ direction(*matched.directions).T)[:, :, None]
    guard = (late < PEAK_SPACING) & (beside > np.cos(GUARD))
    ring = (late <= REACH) & (beside >= np.cos(OUTER) - 1e-9) & ~guard
    mean = np.sum(power, where=ring, axis=(-2, -1)) / np.maximum(ring.sum(axis=(-2, -1)), 1)
    return ratio_or_zero(here, np.sqrt(mean))
