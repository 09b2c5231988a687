"""How much of the direct path is removed, measured before the first possible echo.

    removed = (sum_k r_k^2 - K v) / (sum_k r'_k^2 - K v)

over the early lags k (`early.early_lags`), r the matched filter of a recording, r' that of what is
left of it, v the variance of the noise in either. A direct path that is hardly removed has side
lobes louder than echoes, and nothing else says so.
"""

import math

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.types import Array
from echolearn.survey.survey import Survey

LOOKED_AT = 8
"""Recordings, at most, that are looked at: the way is the same for all."""

LITTLE_DB = 6.0
"""dB below which what is left is told."""

MOST_DB = 40.0
"""dB beyond which nobody needs to know."""


def removed_db(survey: Survey, noise: Array) -> float:
    """Return by how much reading softens what comes before the first echo, in dB.

    NaN where recordings hold no direct path, or noise hides it.

    Args:
        survey: as it will be read.
        noise: standard deviation of the matched filter beside arrivals, over the burst's norm, of
            each recording and microphone, shape (P, M).
    """
    if not survey.direct:
        return math.nan
    count = len(survey.poses)
    poses = np.unique(np.linspace(0, count - 1, min(count, LOOKED_AT)).astype(int)).tolist()
    used = survey.used
    before = 0.0
    after = 0.0
    hidden = 0.0
    for pose in poses:
        whole = survey.mended(pose)
        left = survey.without_direct(whole[None], [pose])[0]
        before += _early_energy(survey, whole[used], pose=pose)
        after += _early_energy(survey, left[used], pose=pose)
        hidden += float(np.sum(noise[pose, used] ** 2)) * np.ptp(survey.early_lags(pose))
    # Of noise alone as much is left as there was.
    if not before > 2 * hidden:
        return math.nan
    rest = max(after - hidden, (before - hidden) * 10 ** (-MOST_DB / 10))
    return 10 * math.log10((before - hidden) / rest)


def _early_energy(survey: Survey, samples: Array, *, pose: int) -> float:
    """Return the sum of squares of the matched filter of samples (M, N) at a pose's early lags."""
    first, last = survey.early_lags(pose)
    r = signals.matched_filter(samples, survey.probe, first=first, last=last - 1)
    return float(np.sum(r**2)) / survey.probe.energy


def removal_lines(survey: Survey, removed: float) -> list[str]:
    """Return the line on a direct path of which little is removed, so many dB, if it is one."""
    if not removed < LITTLE_DB:
        return []
    hint = "direct=fir fits it to each recording"
    if survey.direct == "fir":
        hint = "is probe.wav what was played?"
    return [
        f"direct={survey.direct} removes {removed:z.1f} dB of what comes before the first echo: "
        f"must be {LITTLE_DB:g} dB or more; {hint}"
    ]
