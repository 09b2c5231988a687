"""PSD pre-whitening: Y and S divided by the square root of the noise's power spectral density.

A matched filter is the best detector in *white* noise; in coloured noise it is the best one after both recording and
probe have passed a filter that makes the noise white. Rotors are loud below 1 kHz, where then nothing is listened to.
All microphones pass the same filter, made from the mean shape of their densities, so that the probe stays one and
no direction is distorted; their levels remain as `noise_psd` of the result, for weights.
"""

from dataclasses import replace

import numpy as np

from echolearn import signals
from echolearn.types import Array, Observation, Probe, check


def whitened(observation: Observation, *, samples: int | None = None) -> Observation:
    """Return recordings, probe and noise density after the whitening filter; lags stay what they are.

    Args:
        observation: recordings (B, M, N) with `noise_psd` (F,) or (M, F).
        samples: how many of each recording are needed from its start; all unless given.

    Raises:
        BadValue: no noise density, or one that does not fit the array.
    """
    psd = density(observation)
    shape = colour(psd)
    probe = observation.probe
    burst = signals.whiten(probe.samples, shape)
    heard = signals.whiten(observation.samples[..., :samples], shape)
    length = max(heard.shape[-1], len(burst))
    return replace(
        observation,
        samples=heard,
        probe=Probe(burst, probe.sample_rate, length),
        noise_psd=psd / np.maximum(shape, 1e-6 * shape.mean()),
    )


def density(observation: Observation) -> Array:
    """Return the noise density of each microphone, shape (M, F)."""
    check(
        observation.noise_psd is not None,
        "localizer.whiten",
        True,
        allowed="only with observation.noise_psd",
        hint="record the noise alone and give signals.noise_psd of it",
    )
    psd = np.atleast_2d(np.asarray(observation.noise_psd, dtype=float))
    microphones = len(observation.array)
    fits = psd.ndim == 2 and len(psd) in (1, microphones)
    check(fits, "observation.noise_psd", psd.shape, allowed=f"shape (F,) or ({microphones}, F)")
    return np.broadcast_to(psd, (microphones, psd.shape[-1]))


def colour(psd: Array) -> Array:
    """Return the mean shape of densities (M, F), scaled to mean 1, shape (F,); silent microphones do not count."""
    level = psd.mean(axis=-1, keepdims=True)
    heard = level[:, 0] > 0
    check(bool(heard.any()), "observation.noise_psd", "0", allowed="noise at some microphone")
    return np.mean(psd[heard] / level[heard], axis=0)
