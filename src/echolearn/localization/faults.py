"""Faults of recordings: what no estimator can use is refused by name, what some survive is told.

Refused: a number of channels that is not the array's, a sample rate that is not the probe's, NaN
and infinity, a clipped channel, a search window outside the recording. Told by a warning: a silent
microphone, that is, one whose power is 40 dB below the median of its neighbours or whose samples
never change. An estimator that can do without it leaves it out; one that has only microphone 1
refuses if it is that one.
"""

import warnings
from collections.abc import Iterator

import numpy as np

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, Observation
from echolearn.checks import check, check_finite
from echolearn.localization.correlations import PAD

SILENT = 1e-4
"""Power relative to the median microphone below which one counts as silent."""

CLIPPED = 0.01
"""Share of samples at the largest magnitude above which a channel counts as clipped."""


class SilentMicrophone(UserWarning):
    """A microphone is silent and is left out."""


def check_recordings(observation: Observation, window: SearchWindow) -> tuple[int, int]:
    """Check recordings (B, M, N) and return the first and last lag of the search window.

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
        last + PAD < length,
        "window.farthest",
        f"{window.farthest} m",
        allowed=f"echoes must arrive within the recording of {length} samples",
        hint="the recording is too short, or its sample rate is not the probe's",
    )
    # A sum of squares is finite only if all samples are, and takes no array of their size.
    check_finite(
        "observation.samples",
        energies(samples),
        allowed="samples must be finite",
        hint="is a microphone broken?",
    )
    check_clipping(samples[..., first : last + len(observation.probe.samples)])
    return first, last


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


def energies(samples: Array) -> Array:
    """Return the energy of recordings (B, M, N), shape (B, M), not finite if a sample is not."""
    # Who calls asks whether it is finite: a warning would say it twice.
    with np.errstate(over="ignore", invalid="ignore"):
        return np.vecdot(samples, samples)


def stuck(samples: Array) -> Array:
    """Tell which recordings (B, M, N) never change, shape (B, M), bool."""
    # Most do change within every 31st sample, so the whole is read only where these are alike.
    still = np.ptp(samples[..., ::31], axis=-1) == 0
    still[still] = np.ptp(samples[still], axis=-1) == 0
    return still


def silent_microphones(samples: Array) -> Array:
    """Tell which microphones of (B, M, N) are silent, shape (B, M), bool; none where all are."""
    energy = energies(samples)
    quiet = (energy <= SILENT * np.median(energy, axis=-1, keepdims=True)) | stuck(samples)
    return quiet & ~quiet.all(axis=-1, keepdims=True)


def alike(silent: Array) -> Iterator[tuple[Array, Array]]:
    """Yield recordings with the same silent microphones (B, M): their rows, and which these are."""
    for pattern in np.unique(silent, axis=0):
        yield np.flatnonzero((silent == pattern).all(axis=-1)), pattern


def warn_of_silent(silent: Array, *, reference: bool) -> None:
    """Warn of silent microphones, (B, M); refuse them if the first is one and is the `reference`.

    Raises:
        BadValue: microphone 1 is silent and needed.
    """
    if not silent.any():
        return
    check(
        not (reference and silent[:, 0].any()),
        "observation.samples",
        "silence at microphone 1",
        allowed="this localizer takes times from microphone 1 alone",
        hint="localizer=joint and localizer=em, or a bundle trained with one of them, need it not",
    )
    names = ", ".join(str(channel + 1) for channel in np.flatnonzero(silent.any(axis=0)))
    rows = f"{int(silent.any(axis=-1).sum())} of {len(silent)} observations"
    message = f"observation.samples: microphone {names} is silent in {rows} and is left out there"
    # Levels: this function, `prepare`, the localizer, whoever called it.
    warnings.warn(message, SilentMicrophone, stacklevel=4)
