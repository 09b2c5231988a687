"""PSD pre-whitening: Y and S divided by the square root of the noise's power spectral density.

A matched filter is the best detector in *white* noise; in coloured noise it is the best one after
both recording and probe have passed a filter that makes the noise white. Rotors are loud below 1
kHz, which then hardly counts. All microphones pass the same filter, made from the mean shape of
their densities, so that the probe stays one and no direction is distorted; their levels remain as
`noise_psd` of the result, for weights.

What is known of the noise is a recording of it alone: its density at each microphone, and its
covariance between them (`signals.noise_psd`, `signals.noise_covariance`).
"""

from dataclasses import replace

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.types import Array, Observation, Probe
from echolearn.checks import check, check_finite
from echolearn.localization.silence import energies, silent_microphones

LARGEST_WEIGHT = 4.0
"""Weight of a microphone relative to the median one: little noise may mean that it is covered."""


def whitened(observation: Observation, *, samples: int | None = None) -> Observation:
    """Return recordings, probe and density after the whitening filter; lags stay what they are.

    A silent microphone is silent in the result.

    Args:
        observation: recordings (B, M, N) with `noise_psd` (F,) or (M, F).
        samples: how many of each recording are needed from its start; all unless given.

    Raises:
        BadValue: no noise density, or one that does not fit the array.
    """
    check(
        observation.noise_psd is not None,
        "localizer.whiten",
        True,
        allowed="needs observation.noise_psd, the density of the noise",
        hint="record the noise alone: noise.wav of a survey, or signals.noise_psd",
    )
    psd = density(observation)
    # One filter for all microphones and the probe, so that no direction is distorted.
    shape = colour(psd)
    probe = observation.probe
    burst = signals.whiten(probe.samples, shape)

    # The filter's response is as long as 2 F samples, which the last lags still need.
    needed = None if samples is None else samples + 2 * len(shape)
    recordings = signals.whiten(observation.samples[..., :needed], shape)
    # It would wake up a stuck microphone.
    recordings[silent_microphones(observation.samples)] = 0.0

    return replace(
        observation,
        samples=recordings,
        probe=Probe(burst, probe.sample_rate, max(recordings.shape[-1], len(burst))),
        noise_psd=psd / np.maximum(shape, 1e-6 * shape.mean()),
    )


def density(observation: Observation) -> Array:
    """Return `noise_psd`, which must be known, for each microphone, shape (M, F).

    Raises:
        BadValue: a density that does not fit the array.
    """
    name = "observation.noise_psd"
    psd = np.atleast_2d(np.asarray(observation.noise_psd, dtype=float))
    microphones = len(observation.array)
    check(
        psd.ndim == 2 and len(psd) in (1, microphones),
        name,
        f"shape {psd.shape}",
        allowed=f"must be (F,) or ({microphones}, F), a row for each microphone",
    )
    fine = np.isfinite(psd).all() and (psd >= 0).all()
    check(fine, name, "NaN, infinity or below 0", allowed="densities must be 0 or more")
    return np.broadcast_to(psd, (microphones, psd.shape[-1]))


def colour(psd: Array) -> Array:
    """Return the mean shape of densities (M, F), of mean 1, shape (F,); silence does not count."""
    level = psd.mean(axis=-1, keepdims=True)
    loud = level[:, 0] > 0
    check(
        loud.any(),
        "observation.noise_psd",
        "0",
        allowed="noise must be recorded at some microphone",
    )
    return np.mean(psd[loud] / level[loud], axis=0)


def noise_variance(observation: Observation) -> Array:
    """Return the noise power of each recording, shape (B, M).

    It is the mean of `noise_psd` where that is known, and else the power of the last quarter of the
    recording, when the early echoes are over; late reverberation is not.
    """
    samples = observation.samples
    if observation.noise_psd is not None:
        return np.broadcast_to(density(observation).mean(axis=-1), samples.shape[:-1])
    tail = samples[..., -(samples.shape[-1] // 4) :]
    return energies(tail) / tail.shape[-1]


def noise_weights(observation: Observation, silent: Array) -> Array:
    """Return the weight of each microphone, median noise power over its own, shape (B, M).

    It is 0 where a microphone is `silent` (B, M), and `LARGEST_WEIGHT` at most.
    """
    variance = np.maximum(noise_variance(observation), np.finfo(float).tiny)
    median = np.nanmedian(np.where(silent, np.nan, variance), axis=-1, keepdims=True)
    return np.where(silent, 0.0, np.minimum(median / variance, LARGEST_WEIGHT))


def shared_noise(observation: Observation) -> tuple[Observation, Array]:
    """Return an observation with a density, and `noise_covariance` over its `colour`, (F, M, M).

    The density is the covariance's, where there is no other.

    Raises:
        BadValue: a covariance that is not known or does not fit the array.
    """
    covariance = _checked_covariance(observation)
    densities = np.diagonal(covariance, axis1=-2, axis2=-1).real.T
    if observation.noise_psd is None:
        observation = replace(observation, noise_psd=densities)
    return observation, covariance / np.maximum(colour(densities), 1e-6)[:, None, None]


def _checked_covariance(observation: Observation) -> Array:
    """Return `noise_covariance` (F, M, M), or raise `BadValue`."""
    name = "observation.noise_covariance"
    check(
        observation.noise_covariance is not None,
        "localizer.whiten",
        "spatial",
        allowed=f"needs {name}",
        hint="record the noise alone and give signals.noise_covariance",
    )
    covariance = np.asarray(observation.noise_covariance, dtype=complex)
    shape = covariance.shape
    count = len(observation.array)
    fits = len(shape) == 3 and shape[1:] == (count, count) and shape[0] > 1
    check(fits, name, f"shape {shape}", allowed=f"must be (F, {count}, {count})")
    check_finite(name, covariance, allowed="numbers must be finite")

    asymmetry = np.abs(covariance - covariance.conj().mT).max()
    least = np.diagonal(covariance, axis1=-2, axis2=-1).real.min()
    check(
        least >= 0 and asymmetry <= 1e-6 * np.abs(covariance).max(),
        name,
        "not Hermitian, or a density below 0",
        allowed="must be covariances E Y Y^H",
    )
    return covariance
