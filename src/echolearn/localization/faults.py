"""Faults of recordings that no estimator can use: each is refused by name.

A number of channels that is not the array's, a sample rate that is not the probe's, NaN and
infinity, a clipped channel, a search window outside the recording. What some estimators survive,
a silent microphone, is told instead (`silence`).
"""

import numpy as np

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, Observation
from echolearn.checks import check, check_finite
from echolearn.localization.silence import energies, stuck

CLIPPED = 0.01
"""Share of samples at the largest magnitude above which a channel counts as clipped."""


def check_recordings(
    observation: Observation, window: SearchWindow, *, beyond: int
) -> tuple[int, int, Array]:
    """Check recordings (B, M, N); return first and last lag of the window, and energies (B, M).

    Args:
        observation: the recordings.
        window: where echoes are sought.
        beyond: lags behind the window that are read, too.

    Raises:
        BadValue: see the module's header.
    """
    check_shape(observation)
    first, last = window.lags(
        observation.array,
        sample_rate=observation.probe.sample_rate,
        speed_of_sound=observation.speed_of_sound,
    )
    samples = observation.samples
    length = samples.shape[-1]
    check(
        last + beyond < length,
        "window.farthest",
        f"{window.farthest} m",
        allowed=f"echoes must arrive within the recording of {length} samples",
        hint="the recording is too short, or its sample rate is not the probe's",
    )
    # A sum of squares is finite only if all samples are, and takes no array of their size.
    energy = energies(samples)
    check_finite(
        "observation.samples",
        energy,
        allowed="samples must be finite",
        hint="is a microphone broken?",
    )
    check_clipping(samples[..., first : last + len(observation.probe.samples)])
    return first, last, energy


def check_shape(observation: Observation) -> None:
    """Raise `BadValue` unless recordings have the array's channels and the probe's sample rate."""
    shape = observation.samples.shape
    microphones = len(observation.array)
    check(
        len(shape) == 3 and shape[-2] == microphones,
        "observation.samples",
        f"shape {shape}",
        allowed=f"must be (B, {microphones}, N), one channel for each microphone",
        hint="one recording alone is samples[None]",
    )
    rate = observation.probe.sample_rate
    check(
        observation.sample_rate in (None, rate),
        "observation.sample_rate",
        f"{observation.sample_rate} Hz",
        allowed=f"must be {rate:g} Hz, the probe's",
        hint="resample the recording",
    )


def check_clipping(samples: Array) -> None:
    """Raise `BadValue` if a channel of `samples` (B, M, N) has more than `CLIPPED` at the rails."""
    magnitude = np.abs(samples)
    rail = magnitude.max(axis=-1, keepdims=True)
    # PCM of few bits repeats its extremes too, but not for a hundredth of the time.
    clipped = (np.mean(magnitude >= rail, axis=-1) > CLIPPED) & ~stuck(samples)
    if not clipped.any():
        return
    row, channel = np.argwhere(clipped)[0]
    where = f"microphone {channel + 1} of observation {row} clipped at {rail[row, channel, 0]:g}"
    check(
        False,
        "observation.samples",
        where,
        allowed="samples must not be clipped",
        hint="record with less gain",
    )
