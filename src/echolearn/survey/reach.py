"""What recordings tell of the place: how far echoes are heard, how long sound takes to die away.

    r_m(tau) of mended recordings --mean square over microphones and poses--> energy E(tau)
    E over what noise leaves of it --> farthest wall;  slope of its decay --> T60

A single recording says little: in its correlations reverberation is as rough as noise. Their mean
square over a walk is smooth. The noise's part, the mean of the last lags, is taken off, and what is
left is integrated backwards (Schroeder 1965), so that its slope is that of the decay.
"""

import math
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.signals import matched_filter
from echolearn.acoustics.types import Array
from echolearn.survey.survey import Survey, blocks

NOISE_SHARE = 0.1
"""Share of the lags, the last, in which there is noise alone."""

CLEAR = 5.0
"""Standard deviations of averaged noise by which echoes stand out of it."""

ALIKE = 4.0
"""Neighbouring correlations that tell about as much as one, since bursts have no full band."""

SMOOTH = 0.002
"""s over which energy is averaged before it is compared."""

FIT_DB = (-5.0, -25.0)
"""Levels of the decay between which its slope is taken; less will do where noise comes first."""

LEAST_DB = 8.0
"""dB of decay without which there is no slope to be told."""


class Reach(NamedTuple):
    """What a walk's recordings tell of the place.

    Attributes:
        farthest: distance up to which walls' echoes stand out of the noise, in m; NaN if they
            nowhere do, or recordings end before noise is alone.
        t60: reverberation time in s; NaN where noise hides the decay.
    """

    farthest: float
    t60: float


UNHEARD = Reach(math.nan, math.nan)
"""What is known where nothing stands out of the noise, or nothing was recorded."""


def reach_of(survey: Survey) -> Reach:
    """Return how far recordings hear, and how long the place rings.

    Args:
        survey: mended; the direct path is removed when it is read.
    """
    rate = survey.emitted.sample_rate
    first, _ = survey.window.lags(survey.array, rate, speed_of_sound=survey.speed_of_sound)
    energy = energy_by_lag(survey, first)
    averaged = len(survey.poses) * int(survey.used.sum())
    step = survey.speed_of_sound / rate / 2
    return reach_in(energy, rate=rate, averaged=averaged, first=first, step=step)


def energy_by_lag(survey: Survey, first: int) -> Array:
    """Return the mean square of all correlations with the burst, shape (L,), from a lag on.

    There are none where recordings end before all of the burst came back from there.
    """
    probe = survey.emitted
    last = probe.length - len(probe.samples)
    total = np.zeros(max(0, last - first + 1))
    if not len(total):
        return total
    for block in blocks(survey):
        heard = survey.observe(block).samples[:, survey.used]
        total += np.square(matched_filter(heard, probe, first=first, last=last)).sum(axis=(0, 1))
    return total / (len(survey.poses) * survey.used.sum())


def reach_in(energy: Array, *, rate: float, averaged: int, first: int, step: float) -> Reach:
    """Return what energy by lag tells.

    Args:
        energy: shape (L,).
        rate: in Hz.
        averaged: correlations that each is the mean of.
        first: lag of the first.
        step: distance of walls whose echoes are a lag apart, in m.
    """
    width = max(1, round(SMOOTH * rate))
    count = len(energy) // width
    if count < 4 or not energy.any():
        return UNHEARD
    steps = energy[: count * width].reshape(count, width).mean(axis=1)
    noise = float(steps[-max(1, round(NOISE_SHARE * count)) :].mean())
    loud = steps > noise * (1.0 + CLEAR * math.sqrt(2.0 * ALIKE / (averaged * width)))
    # Up to the first step that is not: later ones that are stand out by chance.
    heard = count if loud.all() else int(np.argmin(loud))
    if not heard:
        return UNHEARD
    farthest = (first + heard * width) * step
    return Reach(farthest, _decay(steps[:heard] - noise, width / rate))


def _decay(energy: Array, step: float) -> float:
    """Return the reverberation time of energies (K,), a step of so many seconds apart; or NaN."""
    if len(energy) < 4:
        return math.nan
    level = 10.0 * np.log10(np.cumsum(np.maximum(energy, 1e-300)[::-1])[::-1])
    level -= level[0]
    # What was cut off at the noise is missing from the sum: its last part falls too fast.
    lowest = max(FIT_DB[1], level[: max(2, round(0.8 * len(level)))][-1])
    inside = np.flatnonzero((level <= FIT_DB[0]) & (level >= lowest))
    if len(inside) < 3 or FIT_DB[0] - lowest < LEAST_DB:
        return math.nan
    slope = np.polyfit(step * inside, level[inside], 1)[0]
    return float(-60.0 / slope) if slope < 0 else float("nan")
