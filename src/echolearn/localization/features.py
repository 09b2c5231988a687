"""From echoes to their columns and tensors, which `columns` lists with their meaning.

Each group of columns is a function of the matched filters and the place of an echo in them.
"""

from collections.abc import Collection

import numpy as np

from echolearn.acoustics.geometry import direction
from echolearn.acoustics.signals import decibel
from echolearn.acoustics.types import Array, Echoes
from echolearn.localization import beamforming
from echolearn.localization.correlations import ratio_or_zero
from echolearn.localization.matched_filter import PEAK_SPACING, SEGMENT, MatchedFilter, align


def recording_columns(
    matched: MatchedFilter, names: Collection[str]
) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return the columns of the beam and the tensor of whole recordings, if `names` want them."""
    beams = not {"power", "power_ratio", "azimuth_mpdr"}.isdisjoint(names)
    tensor = "covariance" in names
    if not (beams or tensor):
        return {}, {}
    covariances = beamforming.recording_covariance(matched.observation)
    return (
        beam_columns(matched, covariances) if beams else {},
        {"covariance": beamforming.band_average(covariances)} if tensor else {},
    )


def echo_columns(matched: MatchedFilter, echo: Echoes) -> dict[str, Array]:
    """Return the columns of one echo per observation, fields (B,), at microphone 1."""
    return {
        "toa": echo.toa,
        "score": echo.score,
        "gain": echo.gain,
        "gain_delay": 4 * np.pi * matched.observation.speed_of_sound * echo.toa * echo.gain,
        "azimuth": echo.azimuth,
        "elevation": echo.elevation,
        **peak_columns(matched.correlation[:, 0], matched.index(echo.toa)),
    }


def peak_columns(correlation: Array, index: Array) -> dict[str, Array]:
    """Return the columns of the peak of r_1, shape (B, L), at lag indices (B,)."""
    peak = np.take_along_axis(correlation, index[:, None], axis=-1)[:, 0]
    rms = np.sqrt(np.mean(np.square(correlation), axis=-1))
    elsewhere = np.abs(np.arange(correlation.shape[-1]) - index[:, None]) >= PEAK_SPACING
    second = np.max(correlation, axis=-1, where=elsewhere, initial=-np.inf)
    return {"peak_to_rms": ratio_or_zero(peak, rms), "second_to_first": ratio_or_zero(second, peak)}


def beam_columns(matched: MatchedFilter, covariances: Array) -> dict[str, Array]:
    """Return the columns of the whole-recording MPDR beam, from covariances (B, F, M, M)."""
    mpdr = beamforming.Mpdr(matched.azimuths)
    spectrum = mpdr(matched.observation, covariances)
    power = decibel(spectrum.max(axis=-1).astype(float))
    return {
        "power": power,
        "power_ratio": power - decibel(spectrum.mean(axis=-1).astype(float)),
        "azimuth_mpdr": mpdr.directions[0][spectrum.argmax(axis=-1)],
    }


def steered_columns(matched: MatchedFilter, index: Array, *, toward: Array) -> dict[str, Array]:
    """Return the columns that compare all microphones.

    Args:
        matched: matched-filter view of B observations.
        index: lag indices of the echoes, shape (B,).
        toward: unit vectors of their directions, shape (B, 3).
    """
    # The largest J anywhere tells whether the echo is what the recording has most of.
    rows = np.arange(len(index))
    steered = matched.steered
    flat = steered.reshape(len(index), -1)
    best = flat.argmax(axis=-1)
    highest = flat[rows, best].astype(float)
    rms = np.sqrt(np.mean(np.square(steered), axis=(-2, -1), dtype=float))

    # Outputs aligned at the echo are alike at all microphones if it is a plane wave.
    aligned = align(matched, index, toward=toward)[:, :, SEGMENT // 2]
    here = aligned.sum(axis=-1)
    energy = np.sqrt(matched.energy[rows, :, index]).sum(axis=-1) * np.sqrt(matched.probe_energy)

    # The estimated direction need not be one of the grid.
    gated = matched.gated_power(index)
    nearest = (toward @ direction(*matched.directions).T).argmax(axis=-1)
    return {
        "coherence": ratio_or_zero(here**2, aligned.shape[-1] * np.sum(aligned**2, axis=-1)),
        "joint": ratio_or_zero(here, rms),
        "joint_max": ratio_or_zero(highest, rms),
        "joint_ratio": ratio_or_zero(here, highest),
        "joint_score": ratio_or_zero(here, energy),
        "joint_lag": np.abs(best % steered.shape[-1] - index).astype(float),
        "gated_ratio": decibel(
            ratio_or_zero(gated[rows, nearest].astype(float), gated.mean(axis=-1))
        ),
    }
