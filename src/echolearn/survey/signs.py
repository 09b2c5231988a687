"""Which microphones are wired the other way, and in which recordings.

The direct path tells it of each recording. Without one only a microphone that differs from the
others shows, by the strongest echo of many recordings; the fewer are taken to be the wrong ones, of
two halves those at which echoes are negative. A plug that is turned on the way turns all that
follow.
"""

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.survey.arrivals import SEEN
from echolearn.survey.time_zero import Direct

SURE = 0.9
"""Share of recordings that must agree on a sign."""

FEWEST = 5
"""Recordings whose echoes must tell it, where there is no direct path."""

BESIDE = 0.5
"""Samples by which a direct path may be off the others, whose sign is looked at."""


def wiring_signs(direct: Direct, echo: Array) -> Array:
    """Return -1 where microphones are wired the other way, else 1, shape (P, M).

    Args:
        direct: the direct paths, fields (P, M); NaN where there are none.
        echo: sign of the strongest echo at each microphone, 0 where it is not seen, shape (P, M).
    """
    if np.isfinite(direct.height).any():
        return _of_direct(direct)
    sides = _sides(echo)
    # Between two halves nobody knows who is right, but walls seldom turn an echo.
    halves = 2 * np.count_nonzero(sides < 0, axis=1) == np.count_nonzero(sides, axis=1)
    heard = np.sign((sides * echo).sum(axis=1))
    many = np.count_nonzero(sides < 0, axis=1) * 2 > np.count_nonzero(sides, axis=1)
    wrong: Array = np.asarray(many | (halves & (heard[halves].sum() < 0)))
    return np.where(np.where(wrong[:, None], -sides, sides) < 0, -1.0, 1.0)


def _of_direct(direct: Direct) -> Array:
    """Return the signs that direct paths tell, shape (P, M)."""
    sign = np.sign(direct.height)
    latency = np.where(np.isfinite(direct.latency), direct.latency, np.nan)
    with np.errstate(invalid="ignore"):
        clear: Array = np.asarray(np.abs(direct.height) > SEEN * direct.noise)
    place = np.median(latency[clear]) if clear.any() else np.nan
    clear &= np.abs(latency - _row_middle(latency, place)) < BESIDE
    found = np.empty(sign.shape)
    for m, (each, sure) in enumerate(zip(sign.T, clear.T, strict=True)):
        certain = np.flatnonzero(sure)
        if len(set(each[certain])) > 1:
            # Those that do not tell are as the nearest that does.
            nearest = certain[np.abs(np.arange(len(each))[:, None] - certain).argmin(axis=1)]
            found[:, m] = each[nearest]
            continue
        known: Array = each[certain] if len(certain) else each[np.isfinite(each)]
        negative = np.count_nonzero(known < 0)
        found[:, m] = -1.0 if len(known) and negative >= SURE * len(known) else 1.0
    return found


def _row_middle(latency: Array, otherwise: float) -> Array:
    """Return the median latency of each recording, shape (P, 1)."""
    known = np.isfinite(latency).any(axis=1, keepdims=True)
    filled = np.where(known, latency, otherwise)
    middle: Array = np.nanmedian(filled, axis=1, keepdims=True)
    return middle


def _sides(echo: Array) -> Array:
    """Return on which of two sides each microphone is, 1 or -1, 0 if that is not known, (P, M)."""
    reference = int(np.count_nonzero(echo, axis=0).argmax())
    beside = echo * echo[:, reference : reference + 1]
    sides = np.zeros(echo.shape)
    for m, each in enumerate(beside.T):
        place = turning_point(each)
        count = np.count_nonzero(each)
        if place:
            before = np.sign(each[:place].sum())
            sides[:, m] = np.where(np.arange(len(each)) < place, before, -before)
        elif count >= FEWEST and abs(each.sum()) >= SURE * count:
            sides[:, m] = np.sign(each.sum())
    return sides


def turning_point(signs: Array) -> int:
    """Return from where on signs (P,), 0 where none is known, are the others; 0 if nowhere."""
    known = np.flatnonzero(signs)
    sums = np.cumsum(signs[known])
    counts = np.arange(1, len(known) + 1)
    before = sums[:-1]
    after = sums[-1:] - before
    rest = len(known) - counts[:-1]
    enough = (counts[:-1] >= FEWEST) & (rest >= FEWEST)
    sure = (np.abs(before) >= SURE * counts[:-1]) & (np.abs(after) >= SURE * rest)
    clear = enough & sure & (before * after < 0)
    if not clear.any():
        return 0
    best = int(np.where(clear, np.abs(before) + np.abs(after), 0.0).argmax())
    return int(known[best + 1])
