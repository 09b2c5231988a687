"""The map of J(tau, phi) about an echo: what else arrives when, and from where.

    J(tau, phi) = sum_m r_m(tau + eta_m(phi)),    C(k, i) = max J(tau_0 + k, phi_0 + i) / competitor

Times are those at the array's centre, and (tau_0, phi_0) is the estimate, so the echo lies in the
middle of every map, wherever it came from. C holds the largest J of `POOL` lags and of one of
`MAP_SECTORS` sectors of azimuth, sector 0 about phi_0; azimuth goes round, the last sector lies
beside the first. A further row is the same of the array's axis, from where floor and ceiling are
heard. Below stand the matched filters of the microphones themselves, aligned at the echo and not
pooled, so that their mean is J: a plane wave is alike at all of them, a chance hit is not.

Everything is divided by the strongest competitor, the largest J at least `PEAK_SPACING` lags away.
So the gain of a recording does not matter, nor how much of it is noise: levels over an rms differ
most between simulated and measured rooms, ratios to a competitor least.
"""

import numpy as np

from echolearn.acoustics.geometry import direction
from echolearn.acoustics.types import Array
from echolearn.localization.columns import MAP_LAGS, MAP_SECTORS
from echolearn.localization.matched_filter import PEAK_SPACING, MatchedFilter, align

FINE = 5
"""Directions in a sector, of which the largest J counts: 2 degrees apart, no more
than the width of an echo at any array."""

POOL = 2
"""Lags of which the largest J counts."""

MOST = 100.0
"""Bound of an entry, far beyond any echo; where nothing competes, numbers stay finite."""


def correlation_map(matched: MatchedFilter, index: Array, *, toward: Array) -> Array:
    """Return the map about an echo of each observation, (B, sectors + 1 + M, lags), float16.

    Args:
        matched: matched-filter view of B observations.
        index: lag indices of the echoes, shape (B,).
        toward: unit vectors of their directions, shape (B, 3).
    """
    steered = matched.steered
    rows = np.arange(len(index))[:, None, None]
    turned = sectors_about(toward, matched.azimuths)
    axis = np.arange(matched.azimuths, steered.shape[1]) * np.ones_like(index)[:, None]
    which = np.concatenate([turned, axis], axis=1)

    # Outside the window nothing was sought: it is silent there.
    lags = lags_about(matched, index, toward=toward, which=which)
    inside = (lags >= 0) & (lags < steered.shape[-1])
    there = np.clip(lags, 0, steered.shape[-1] - 1)
    around = np.where(inside, steered[rows, which[:, :, None], there], 0.0)
    around = around.reshape(*which.shape, MAP_LAGS, POOL).max(axis=-1)

    level = around[:, : MAP_SECTORS * FINE].reshape(len(index), MAP_SECTORS, FINE, MAP_LAGS)
    above = around[:, MAP_SECTORS * FINE :].max(axis=1, keepdims=True)
    # A wave of the same J at M microphones has J / M at each.
    microphones = align(matched, index, toward=toward)
    alone = microphones * microphones.shape[1]
    whole = np.concatenate([level.max(axis=2), above, alone], axis=1)
    return normalised(whole, competitor(steered, index))


def lags_about(matched: MatchedFilter, index: Array, *, toward: Array, which: Array) -> Array:
    """Return the lag indices of a map, (B, D, lags), so that its columns are times at the centre.

    J counts time at microphone 1, which waves from some directions reach before the array's centre.
    A map of such times would be skewed, and otherwise for each direction of the echo.

    Args:
        matched: matched-filter view of B observations.
        index: lag indices of the echoes, shape (B,).
        toward: unit vectors of their directions, shape (B, 3).
        which: directions of the grid, shape (B, D).
    """
    later = matched.eta(direction(*matched.directions)).mean(axis=-1)
    shift = matched.eta(toward).mean(axis=-1)[:, None] - later[which]
    steps = np.arange(MAP_LAGS * POOL) - MAP_LAGS * POOL // 2
    return (index[:, None] + np.rint(shift).astype(int))[:, :, None] + steps


def sectors_about(toward: Array, azimuths: int) -> Array:
    """Return the grid's azimuths, sector by sector from the one about a direction.

    Args:
        toward: unit vectors, shape (B, 3).
        azimuths: number of directions of the grid, from -pi.

    Returns:
        Indices into the grid, shape (B, `MAP_SECTORS` * `FINE`).
    """
    azimuth = np.arctan2(toward[:, 1], toward[:, 0])
    nearest = np.rint((azimuth + np.pi) / (2 * np.pi) * azimuths).astype(int)
    # The first sector lies on either side of the echo.
    steps = (np.arange(MAP_SECTORS * FINE) - FINE // 2) * azimuths / (MAP_SECTORS * FINE)
    return (nearest[:, None] + np.rint(steps).astype(int)) % azimuths


def competitor(steered: Array, index: Array) -> Array:
    """Return the largest J, (B, A, L), away from lag indices (B,), shape (B,)."""
    highest = steered.max(axis=1)
    away = np.abs(np.arange(highest.shape[-1]) - index[:, None]) >= PEAK_SPACING
    return np.max(highest, axis=-1, where=away, initial=0.0)


def normalised(values: Array, level: Array) -> Array:
    """Return values (B, ...) over levels (B,), within `MOST`, float16; 0 where all is silent."""
    safe = np.maximum(level, np.finfo(np.float32).tiny)[:, None, None]
    with np.errstate(over="ignore"):
        found = np.clip(values / safe, -MOST, MOST)
    return found.astype(np.float16)
