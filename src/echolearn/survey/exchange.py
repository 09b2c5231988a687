"""Which microphones changed places: exchanging two of them makes the echoes of a walk louder.

    J(tau, phi) = sum_m r_m(tau + eta_m(phi)),   eta_m of a plane wave from phi
    z_ij = max |J_ij| / max |J| - 1,             J_ij with eta_i and eta_j exchanged

One echo deceives where two walls answer at once, so all those of a walk, or of its beginning or
end, are asked together: T = sum z / sqrt(sum z^2) is as a number of standard deviations, and below
zero where microphones are where they should be. Neighbours are sometimes taken for those exchanged.
"""

from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.geometry import direction
from echolearn.acoustics.types import Array

ECHOES = 4
"""Echoes of a recording that are looked at."""

DIRECTIONS = 24
"""Azimuths that are tried, and the axis."""

SLANTED = np.deg2rad([30.0, 60.0, 120.0, 150.0])
"""Angles from the axis, in rad, that are tried besides where microphones are not in one level:
there an echo that comes slanting, taken for a level one, would make others seem exchanged."""

FINER = 2
"""Points per lag at which the matched filter is read."""

BESIDE = 16
"""Lags on either side of those that are read, for what lies between samples."""

SEEN = 8.0
"""Height of a sum over its noise from which an echo tells: with two exchanged noise reaches 6.5."""

SURE = 2.4
CLEAR = 5.0
"""T, and T times the sum of z, from which microphones are exchanged; sound walks reach 2 and 1.4.
"""

FEWEST = 6
"""Recordings that must have become louder, more than half of those of a stretch that tell."""


class Exchange(NamedTuple):
    """Two microphones that changed places.

    Attributes:
        pair: numbers of the microphones, from 0.
        recordings: in which they did, shape (P,), bool.
    """

    pair: tuple[int, int]
    recordings: Array


def pairs_of(count: int) -> list[tuple[int, int]]:
    """Return all pairs of so many microphones."""
    return list(combinations(range(count), 2))


class Strongest(NamedTuple):
    """The strongest echoes of a recording; NaN where none is seen.

    Attributes:
        louder: z_ij of each, shape (ECHOES, pairs).
        lag: at the array's middle, shape (ECHOES,), in samples.
        azimuth: shape (ECHOES,), in rad; NaN of what comes slanting or along the axis.
    """

    louder: Array
    lag: Array
    azimuth: Array


def strongest(outputs: Array, noise: Array, *, positions: Array) -> Strongest:
    """Return the strongest echoes of a recording.

    Args:
        outputs: of the matched filter without the direct path, shape (M, K).
        noise: standard deviation of each, shape (M,).
        positions: of the microphones, in samples of path, shape (M, 3).
    """
    delays = _delays(positions.tobytes(), len(positions))
    reach = int(np.ceil(np.abs(delays).max())) + 1
    sides = 2 * reach + BESIDE
    heard = np.pad(outputs / noise[:, None], ((0, 0), (sides, sides)))
    # All microphones hear an echo within the array's width, whoever they are.
    summed = np.pad(np.cumsum(np.sum(heard**2, axis=0)), (reach + 1, reach), mode="edge")
    summed[: reach + 1] = 0.0
    around = summed[2 * reach + 1 :] - summed[: -2 * reach - 1]
    rows = []
    for _ in range(ECHOES):
        place = int(around[sides:-sides].argmax()) + sides
        z, lag, azimuth = _echo_at(heard[:, place - sides : place + sides + 1], delays, reach=reach)
        rows.append((z, lag + place - 2 * sides, azimuth))
        around[max(place - 2 * reach, 0) : place + 2 * reach + 1] = 0.0
    return Strongest(*map(np.array, zip(*rows, strict=True)))


@lru_cache(maxsize=4)
def _delays(positions: bytes, count: int) -> Array:
    """Return eta_m(phi) in samples, shape (A, M): level directions first, then the others."""
    places = np.frombuffer(positions).reshape(count, 3)
    azimuths = 2 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    elevations = [np.pi / 2]
    upright = [[0.0, 0.0, 1.0]]
    if np.ptp(places[:, 2]) > 0.1 * np.ptp(places, axis=0).max():
        elevations += SLANTED.tolist()
        upright.append([0.0, 0.0, -1.0])
    around = direction(azimuths, np.array(elevations)[:, None]).reshape(-1, 3)
    toward = np.concatenate([around, upright])
    return -toward @ (places - places.mean(axis=0)).T


def _echo_at(heard: Array, delays: Array, *, reach: int) -> tuple[Array, float, float]:
    """Return z_ij of one echo, shape (pairs,), its lag in `heard`, and its azimuth.

    Args:
        heard: outputs over their noise around it, shape (M, W).
        delays: of the directions, shape (A, M), in samples.
        reach: largest of them.
    """
    count, width = heard.shape
    finer = np.fft.irfft(np.fft.rfft(heard), width * FINER) * FINER
    lags = np.arange(reach + BESIDE // 2, width - reach - BESIDE // 2)
    at = np.rint((lags + delays[..., None]) * FINER).astype(int)
    # Row m, column k: what microphone m would add were it at the place of k.
    added = finer[:, at].swapaxes(1, 2)
    own = added[np.arange(count), np.arange(count)]
    usual = own.sum(axis=0)
    gained = added - own[:, None]
    first, second = np.array(pairs_of(count)).T
    highest = np.abs(usual + gained[first, second] + gained[second, first]).max(axis=(1, 2))
    toward, place = np.unravel_index(int(np.abs(usual).argmax()), usual.shape)
    best = float(np.abs(usual[toward, place]))
    if max(best, float(highest.max())) < SEEN * np.sqrt(count):
        return np.full(len(highest), np.nan), np.nan, np.nan
    # Only the first ones are level.
    azimuth = 2 * np.pi * float(toward) / DIRECTIONS if toward < DIRECTIONS else np.nan
    return highest / best - 1.0, float(lags[place]), azimuth


def exchanged(louder: Array) -> Exchange | None:
    """Return the microphones that changed places, if two did, by z_ij (P, ECHOES, pairs)."""
    z = np.where(np.isfinite(louder), louder, 0.0)
    length = len(z)
    total = z.sum(axis=1)
    # From the beginning up to each recording, and from each on to the end.
    sums, squares, votes, told = map(_stretches, (total, (z**2).sum(axis=1), total > 0, total != 0))
    spread = np.sqrt(squares)
    sure = (sums > SURE * spread) & (sums * np.abs(sums) > CLEAR * spread)
    sure &= (votes >= FEWEST) & (2 * votes > told)
    if not sure.any():
        return None
    place, pair = np.unravel_index(int(np.where(sure, sums, 0.0).argmax()), sums.shape)
    numbers = np.arange(length)
    within = numbers <= place if place < length else numbers > place - length
    which = within & (total[:, pair] > 0)
    return Exchange(pairs_of(_microphones(z.shape[-1]))[int(pair)], which)


def _stretches(values: Array) -> Array:
    """Return sums (2 P - 1, K) of values (P, K) from the beginning, and up to the end."""
    sums = np.cumsum(values, axis=0)
    return np.concatenate([sums, sums[-1] - sums[:-1]])


def _microphones(pairs: int) -> int:
    """Return how many microphones have so many pairs."""
    return round((1 + np.sqrt(1 + 8 * pairs)) / 2)
