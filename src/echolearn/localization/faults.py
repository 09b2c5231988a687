"""Faults of recordings: what no estimator can use is refused by name, what some can survive is
told.

Refused: a number of channels that is not the array's, a sample rate that is not the probe's, NaN
    and infinity, a
clipped channel, a search window outside the recording. Told by a warning: a microphone that does
not hear, that is, whose power is 40 dB below the median of its neighbours or whose samples never
change. An estimator that can do without it leaves it out; S-NLS, which has only microphone 1,
refuses if it is that one.
"""

import warnings

import numpy as np

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, Observation
from echolearn.checks import check
from echolearn.localization.beamforming import PAD

DEAF = 1e-4
"""Power relative to the median microphone below which one counts as not hearing."""

CLIPPED = 0.01
"""Share of samples at the largest magnitude above which a channel counts as clipped."""

BOLD = 4.0
"""Largest weight of a microphone relative to the median one: little noise may mean that little is
heard."""


class DeafMicrophone(UserWarning):
    """A microphone hears nothing and is left out."""


def check_recordings(observation: Observation, window: SearchWindow) -> tuple[int, int]:
    """Check recordings (B, M, N) and return the first and last lag of the search window.

    Raises:
        BadValue: see the module's header.
    """
    check_shape(observation)
    first, last = window.lags(
        observation.array, observation.probe.sample_rate, observation.speed_of_sound
    )
    length = observation.samples.shape[-1]
    check(
        last + PAD < length,
        "window.farthest",
        f"{window.farthest} m",
        allowed=f"echoes within the recording of {length} samples",
        hint="the recording is too short, or its sample rate is not the probe's",
    )
    finite = bool(np.isfinite(energies(observation.samples)).all())
    check(
        finite,
        "observation.samples",
        "NaN or infinity",
        allowed="finite samples",
        hint="is a microphone broken?",
    )
    check_clipping(observation.samples[..., first : last + len(observation.probe.samples)])
    return first, last


def check_shape(observation: Observation) -> None:
    """Raise `BadValue` unless recordings have the array's channels and the probe's sample rate."""
    shape, microphones = observation.samples.shape, len(observation.array)
    fits = len(shape) == 3 and shape[-2] == microphones
    check(
        fits,
        "observation.samples",
        shape,
        allowed=f"(B, {microphones}, N), one channel for each microphone",
    )
    rate = observation.probe.sample_rate
    check(
        observation.sample_rate in (None, rate),
        "observation.sample_rate",
        f"{observation.sample_rate} Hz",
        allowed=f"{rate:g} Hz, the probe's",
        hint="resample the recording",
    )


def check_clipping(samples: Array) -> None:
    """Raise `BadValue` if in a channel of `samples` (B, M, N) more than `CLIPPED` of them are at
    the rails.
    """
    magnitude = np.abs(samples)
    rail = magnitude.max(axis=-1, keepdims=True)
    clipped = (np.mean(magnitude >= rail, axis=-1) > CLIPPED) & ~stuck(samples)
    if clipped.any():
        row, channel = np.argwhere(clipped)[0]
        where = (
            f"microphone {channel + 1} of observation {row} clipped at {rail[row, channel, 0]:g}"
        )
        check(
            False,
            "observation.samples",
            where,
            allowed="unclipped samples",
            hint="record with less gain",
        )


def energies(samples: Array) -> Array:
    """Return the energy of each recording (B, M, N), shape (B, M); NaN or infinity where a sample
    is.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return np.vecdot(samples, samples)


def stuck(samples: Array) -> Array:
    """Tell which recordings (B, M, N) never change, shape (B, M), bool."""
    still = np.ptp(samples[..., ::31], axis=-1) == 0
    still[still] = np.ptp(samples[still], axis=-1) == 0
    return still


def deaf(samples: Array) -> Array:
    """Tell which microphones do not hear, shape (B, M), bool; none where a whole recording (M, N)
    is silent.
    """
    energy = energies(samples)
    quiet = (energy <= DEAF * np.median(energy, axis=-1, keepdims=True)) | stuck(samples)
    return quiet & ~quiet.all(axis=-1, keepdims=True)


def tell(silent: Array, *, reference: bool) -> None:
    """Warn of deaf microphones, `silent` (B, M); refuse them if the first is one and is needed as
    the `reference`.
    """
    if not silent.any():
        return
    names = ", ".join(str(channel + 1) for channel in np.flatnonzero(silent.any(axis=0)))
    rows = f"{int(silent.any(axis=-1).sum())} of {len(silent)} observations"
    lost = reference and bool(silent[:, 0].any())
    hint = (
        "localizer=joint and localizer=em, or a bundle trained with one of them, can do without it"
    )
    check(
        not lost,
        "observation.samples",
        "silence at microphone 1",
        allowed="a reference that hears",
        hint=hint,
    )
    message = (
        f"observation.samples: microphone {names} hears nothing in {rows} and is left out there"
    )
    warnings.warn(message, DeafMicrophone, stacklevel=3)


def density(observation: Observation) -> Array:
    """Return `noise_psd`, which must be known, for each microphone, shape (M, F).

    Raises:
        BadValue: a density that does not fit the array.
    """
    psd, microphones = (
        np.atleast_2d(np.asarray(observation.noise_psd, dtype=float)),
        len(observation.array),
    )
    fits = psd.ndim == 2 and len(psd) in (1, microphones)
    check(fits, "observation.noise_psd", psd.shape, allowed=f"shape (F,) or ({microphones}, F)")
    fine = bool(np.isfinite(psd).all() and (psd >= 0).all())
    check(fine, "observation.noise_psd", "NaN, infinity or below 0", allowed="densities >= 0")
    return np.broadcast_to(psd, (microphones, psd.shape[-1]))


def noise_variance(observation: Observation) -> Array:
    """Return the noise power of each recording, shape (B, M).

    It is the mean of `noise_psd` where that is known, and else the power of the last quarter of the
    recording, when the early echoes are over; late reverberation is not.
    """
    if observation.noise_psd is not None:
        return np.broadcast_to(density(observation).mean(axis=-1), observation.samples.shape[:-1])
    tail = observation.samples[..., -(observation.samples.shape[-1] // 4) :]
    return energies(tail) / tail.shape[-1]


def noise_weights(observation: Observation, silent: Array) -> Array:
    """Return how much each microphone counts, shape (B, M): median noise power over its own, 0
    where `silent`.

    None counts more than `BOLD` times the median.
    """
    heard = np.where(silent, np.nan, np.maximum(noise_variance(observation), np.finfo(float).tiny))
    median = np.nanmedian(heard, axis=-1, keepdims=True)
    return np.where(silent, 0.0, np.minimum(median / np.where(silent, 1.0, heard), BOLD))
