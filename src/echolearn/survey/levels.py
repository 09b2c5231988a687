"""What does not belong to the sound of a recording: offset, mains, clipping, lost samples.

An offset is told from low frequencies by being alone: its power is compared with that of the
lowest frequencies beside it. The mains is told from other tones by a comb: what sinusoids at
multiples of 50 or 60 Hz explain is compared with what combs of other frequencies do.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.types import Array, Probe
from echolearn.survey.lost import repeated, repeated_alone, still
from echolearn.survey.mending import steadied

OFFSET = 0.25
"""Offset over the rms of the rest from which it is subtracted; it takes 3 % of a score."""

ALONE = 16.0
"""Power of an offset over that of its neighbours from which it stands out."""

STEADY = 0.7
"""Share of recordings in which a channel has an offset, all to one side."""

MAINS = (50.0, 60.0)
OTHERS = (37.0, 43.0, 71.0, 83.0)
"""Fundamental frequencies in Hz of the mains, and of combs to compare with."""

HARMONICS = 10
"""Tones of a comb."""

COMB = 8.0
"""Power of the mains' comb over that of the others from which it stands out."""

TONE = 4.0
"""The same of a single tone, where there is hum: one too many is but a hertz of the recording."""

ASTRAY = 0.6
FINER = 61
"""Hz by which the mains may be off, and the frequencies among which it is sought."""

HUM = 0.05
"""Share of a channel's power from which hum is subtracted."""

CLIPPED = 0.01
"""Share of the samples of a burst at the rails from which a channel counts as clipped."""

STEPS = 16
FAR_FROM_RAILS = 0.5
"""Steps of a converter between the smallest and the largest sample, and share of full scale, below
which many samples are the largest because the sound is soft."""

OVERFLOWED = 2
"""Samples of a walk that came out at the other end of the range."""


class Levels(NamedTuple):
    """What is measured of one recording.

    Attributes:
        offset: mean of each channel, shape (M,).
        shifted: whether that is an offset rather than low frequencies, shape (M,), bool.
        hum: power of the mains over that of the rest, of each channel, shape (M,).
        tones: frequencies of the mains that stand out, in cycles per sample.
        clipping: share of the loudest burst's length at the rails, shape (M,).
        steps: of the converter, between the smallest and the largest sample, shape (M,).
        still: longest run of equal samples between loud ones, shape (M,).
        repeated: longest stretch that is exactly as one before it, of all channels or one.
    """

    offset: Array
    shifted: Array
    hum: Array
    tones: tuple[float, ...]
    clipping: Array
    level_steps: Array
    still: Array
    repeated: int


def measure_levels(samples: Array, probe: Probe) -> tuple[Levels, Array]:
    """Return what is measured of a recording (M, N), and the recording without offset and hum."""
    everywhere = np.ones(len(samples), dtype=bool)
    offset = samples.mean(axis=-1)
    tones = mains(samples - offset[:, None], probe.sample_rate)
    rest = steadied(samples, everywhere, tones=tones)
    hum = np.zeros(len(samples))
    if tones:
        hum = np.var(samples, axis=-1) / np.maximum(np.var(rest, axis=-1), 1e-30) - 1.0
    share = clipping(samples, len(probe.samples))
    found = Levels(
        offset,
        stands_out(offset, rest),
        np.maximum(hum, 0.0),
        tones,
        share,
        level_steps(samples, share > CLIPPED),
        np.array([still(channel) for channel in samples]),
        repeated(samples) or repeated_alone(samples),
    )
    return found, rest


def stands_out(offset: Array, rest: Array) -> Array:
    """Tell which offsets (M,) are more than low frequencies, shape (M,), bool.

    Args:
        offset: mean of each channel, shape (M,).
        rest: the recording without it and without hum, shape (M, N).
    """
    much = np.abs(offset) > OFFSET * rest.std(axis=-1)
    if not much.any():
        return much
    length = rest.shape[-1]
    # The lowest frequencies alone, without the transform of all.
    low = _heights(rest, tuple(k / length for k in range(1, 9)))
    beside = np.mean(np.abs(low) ** 2, axis=-1) / length**2
    # A closed room gathers pressure while it is sounded into, which fades with the sound.
    ends = (rest[:, : length // 16 + 1], rest[:, -length // 4 :])
    first, last = ((each.mean(axis=-1) + offset) * offset > offset**2 / 2 for each in ends)
    return first & last & much & (offset**2 > ALONE * beside)


def steady(levels: Levels) -> Array:
    """Tell which offsets of P recordings are a converter's, fields (P, ...), shape (P, M), bool.

    That of a channel is alike in all recordings; the rumble of motors has either sign.
    """
    shifted = np.asarray(levels.shifted)
    sides = np.sum(shifted * np.sign(levels.offset), axis=0)
    same: Array = shifted & (np.abs(sides) > STEADY * len(shifted))
    return same


def humming(tones: tuple[tuple[float, ...], ...], levels: Levels) -> tuple[tuple[float, ...], ...]:
    """Return the tones of the mains in each recording, those of a passing motor left out.

    Args:
        tones: that stand out in each recording, in cycles per sample.
        levels: of every recording, fields (P, ...).
    """
    # The mains hum everywhere; what is louder than all else is subtracted in any case.
    if 2 * sum(map(bool, tones)) >= len(tones):
        return tones
    loud = np.asarray(levels.hum).max(axis=1) > 1.0
    return tuple(each if much else () for each, much in zip(tones, loud, strict=True))


def mains(samples: Array, sample_rate: float) -> tuple[float, ...]:
    """Return the tones of the mains that stand out, in cycles per sample.

    Args:
        samples: a recording without offset, shape (M, N).
        sample_rate: in Hz.
    """
    # Averages of a few samples keep what is below 1 kHz, and are fewer.
    step = max(1, int(sample_rate // 4000))
    length = samples.shape[-1] // step
    # A product is ten times as fast as a mean over so few.
    slow = samples[:, : length * step].reshape(len(samples), length, step) @ np.full(step, 1 / step)
    rate = sample_rate / step
    powers = comb(slow, np.array([*MAINS, *OTHERS]) / rate)
    beside = np.median(powers[len(MAINS) :].sum(axis=1), axis=0)
    inside = powers[: len(MAINS)].sum(axis=1)
    total = np.maximum(np.vecdot(samples, samples) / samples.shape[-1], 1e-30)
    heard = ((inside > HUM * total) & (inside > COMB * beside)).any(axis=-1)
    if not heard.any():
        return ()

    # A grid's frequency is near the nominal one only.
    middle = MAINS[int(inside.sum(axis=-1).argmax())]
    near = np.linspace(middle - ASTRAY, middle + ASTRAY, FINER)
    powers = comb(slow, near / rate).sum(axis=-1)
    best = int(powers.sum(axis=-1).argmax())
    loud = powers[best] > np.maximum(beside.sum() / HARMONICS * TONE, HUM / 20 * powers[best].max())
    # Motors have other lowest tones than the mains and its rectifiers.
    if not loud[:2].any():
        return ()
    return tuple(float(near[best] * k / sample_rate) for k in np.flatnonzero(loud) + 1)


def comb(samples: Array, fundamentals: Array) -> Array:
    """Return the power that each tone of each comb explains, shape (combs, HARMONICS, M).

    Args:
        samples: shape (M, N).
        fundamentals: of the combs, in cycles per sample.
    """
    tones = np.outer(fundamentals, np.arange(1, HARMONICS + 1)).ravel()
    heights = _heights(samples, tuple(tones.tolist())) / samples.shape[-1]
    return (2 * np.abs(heights) ** 2).T.reshape(-1, HARMONICS, len(samples))


def _heights(samples: Array, frequencies: tuple[float, ...]) -> Array:
    """Return sum_n y_m(n) exp(-j 2 pi f n), shape (M, F)."""
    # A product of reals: cosines and sines side by side.
    found: Array = (samples @ _waves(samples.shape[-1], frequencies).view(float)).view(complex)
    return found


@lru_cache(maxsize=8)
def _waves(length: int, frequencies: tuple[float, ...]) -> Array:
    """Return exp(-j 2 pi f n), shape (length, F): the same for every recording of a survey."""
    return np.exp(-2j * np.pi * np.outer(np.arange(length), frequencies))


def clipping(samples: Array, burst: int) -> Array:
    """Return the share of the loudest stretch of a burst's length at the rails, shape (M,)."""
    low = samples.min(axis=-1, keepdims=True)
    high = samples.max(axis=-1, keepdims=True)
    most = np.zeros(len(samples))
    for m, rails in enumerate((samples <= low) | (samples >= high)):
        places = np.flatnonzero(rails)
        most[m] = (np.searchsorted(places, places + burst) - np.arange(len(places))).max()
    # The largest and the smallest sample are nobody's rails.
    most = np.maximum(most - 2, 0)
    # A channel that never changes is dead, not clipped.
    return np.where(high[:, 0] > low[:, 0], most / burst, 0.0)


def level_steps(samples: Array, which: Array) -> Array:
    """Return the steps between the smallest and the largest sample of some channels, shape (M,).

    Args:
        samples: a recording, shape (M, N).
        which: channels that are looked at, shape (M,), bool; the others have infinitely many.
    """
    found = np.full(len(samples), np.inf)
    # What is loud is at the rails of the converter itself.
    for m in np.flatnonzero(which & (np.abs(samples).max(axis=-1) < FAR_FROM_RAILS)):
        apart = np.diff(np.unique(samples[m]))
        found[m] = np.round(apart.sum() / apart.min())
    return found
