"""PSD pre-whitening: Y and S divided by the square root of the noise's power spectral density.

A matched filter is the best detector in *white* noise; in coloured noise it is the best one after
both recording and probe have passed a filter that makes the noise white. Rotors are loud below 1
kHz, where then nothing is listened to. All microphones pass the same filter, made from the mean
shape of their densities, so that the probe stays one and no direction is distorted; their levels
remain as `noise_psd` of the result, for weights.
"""

from dataclasses import replace

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.types import Array, Observation, Probe
from echolearn.checks import check
from echolearn.localization import faults


def whitened(observation: Observation, *, samples: int | None = None) -> Observation:
    """Return recordings, probe and noise density after the whitening filter; lags stay what they
    are.

    Args:
        observation: recordings (B, M, N) with `noise_psd` (F,) or (M, F).
        samples: how many of each recording are needed from its start; all unless given.

    A microphone that does not hear is silent in the result.

    Raises:
        BadValue: no noise density, or one that does not fit the array.
    """
    check_known(observation)
    psd = faults.density(observation)
    shape = colour(psd)
    probe, silent = observation.probe, faults.deaf(observation.samples)
    burst = signals.whiten(probe.samples, shape)
    heard = signals.whiten(observation.samples[..., :samples], shape)
    heard[silent] = 0.0  # the filter would wake up a stuck microphone
    length = max(heard.shape[-1], len(burst))
    return replace(
        observation,
        samples=heard,
        probe=Probe(burst, probe.sample_rate, length),
        noise_psd=psd / np.maximum(shape, 1e-6 * shape.mean()),
    )


def check_known(observation: Observation) -> None:
    """Raise `BadValue` unless the observation has a noise density."""
    known = observation.noise_psd is not None
    hint = "record the noise alone: noise.wav of a survey, or signals.noise_psd"
    check(known, "localizer.whiten", True, allowed="only with observation.noise_psd", hint=hint)


def check_whiten(value: object, *more: str) -> None:
    """Raise `BadValue` unless `value` is a way in which a localizer can whiten: true, false or one
    of `more`.
    """
    allowed = ", ".join(["true", "false", *more])
    known = isinstance(value, bool) or value in more
    check(
        known,
        "localizer.whiten",
        value,
        allowed=allowed,
        hint="" if more else "spatial is for localizer=joint",
    )


def colour(psd: Array) -> Array:
    """Return the mean shape of densities (M, F), scaled to mean 1, shape (F,); silent microphones
    do not count.
    """
    level = psd.mean(axis=-1, keepdims=True)
    heard = level[:, 0] > 0
    check(bool(heard.any()), "observation.noise_psd", "0", allowed="noise at some microphone")
    return np.mean(psd[heard] / level[heard], axis=0)
