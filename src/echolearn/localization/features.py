"""What a classifier may use: named columns of an echo, and covariance tensors of its recording.

Columns marked (g) change with the gain of the recording; the others are dimensionless.

| column          | unit | meaning |
|---|---|---|
| toa             | s    | estimated time of arrival at microphone 1 |
| score           | 1    | normalised correlation of microphone 1 with the probe at toa |
| peak_to_rms     | 1    | r_1(toa) over the rms of r_1 in the search window |
| second_to_first | 1    | second highest peak of r_1, at least 5 lags away, over r_1(toa) |
| gain            | (g)  | amplitude of the echo (Eq. 11) |
| gain_delay      | m (g)| 4 pi c toa gain: a wall's reflection coefficient if gains are known |
| power           | dB(g)| whole-recording MPDR beam power, the paper's second feature (Eq. 16) |
| power_ratio     | dB   | that power over its mean over azimuth |
| coherence       | 1    | (sum_m a_m)^2 / (M sum_m a_m^2) of a_m = r_m(toa + eta_m(doa)) |
| joint           | 1    | J(toa, doa) over the rms of J in the window |
| joint_max       | 1    | maximum of J over the same rms |
| joint_ratio     | 1    | J(toa, doa) over the maximum of J |
| joint_score     | 1    | J(toa, doa) as a normalised correlation over all microphones |
| joint_lag       | samples | |toa - time of the maximum of J| |
| gated_ratio     | dB   | gated power at the doa over its mean over directions |
| azimuth, elevation | rad | direction the localizer chose |
| azimuth_mpdr    | rad  | direction of the whole-recording MPDR (the paper's) |

Tensors are (COVARIANCE_BANDS, M*M) packed Hermitian matrices (`beamforming.pack_hermitian`),
each band scaled to trace M: `covariance` of the whole recording, `covariance_gated` of the
matched-filter outputs around the echo, `covariance_steered` the same after steering to the
estimated direction, so that an echo from there is all ones whatever its direction.
"""

from collections.abc import Collection
from dataclasses import fields

import numpy as np
from scipy import fft

from echolearn.acoustics.geometry import direction
from echolearn.acoustics.signals import decibel
from echolearn.acoustics.types import Array, Echoes
from echolearn.localization import beamforming
from echolearn.localization.correlations import PAD, advance
from echolearn.localization.matched_filter import PEAK_SPACING, MatchedFilter
from echolearn.localization.separation import separate

COVARIANCE_BANDS = 16
"""Bands of frequencies in a covariance tensor."""

SEGMENT = 64
"""Lags of the matched filters around an echo from which its covariance is taken."""

UNITS = {
    "toa": "s",
    "score": "1",
    "peak_to_rms": "1",
    "second_to_first": "1",
    "gain": "1",
    "gain_delay": "m",
    "power": "dB",
    "power_ratio": "dB",
    "coherence": "1",
    "joint": "1",
    "joint_max": "1",
    "joint_ratio": "1",
    "joint_score": "1",
    "joint_lag": "samples",
    "gated_ratio": "dB",
    "azimuth": "rad",
    "elevation": "rad",
    "azimuth_mpdr": "rad",
}
"""Unit of each column."""

COLUMNS = list(UNITS)
TENSORS = ("covariance", "covariance_gated", "covariance_steered")


def describe(
    matched: MatchedFilter, echoes: Echoes, *, names: Collection[str] = (*COLUMNS, *TENSORS)
) -> dict[str, Array]:
    """Return columns (B * R,) and tensors (B * R, COVARIANCE_BANDS, M*M): a row for each echo.

    Rows go observation by observation. Of several echoes each is described as the others leave it
    (`separation`); what speaks of the whole recording is the same for all of them.

    Args:
        matched: matched-filter view of B observations.
        echoes: their echoes, fields (B, R).
        names: what is wanted; what is costly and only good for others is not computed, though some
            may come along.
    """
    beams, tensor = recording_columns(matched, names)
    each = []
    for r, view in enumerate(separate(matched, echoes)):
        one = Echoes(*(getattr(echoes, field.name)[:, r] for field in fields(Echoes)))
        # Their order is that of the columns in the files of sets.
        columns = echo_columns(view, one) | beams
        index = view.index(one.toa)
        toward = direction(one.azimuth, one.elevation)
        columns |= steered_columns(view, index, toward=toward) | tensor
        if not {"covariance_gated", "covariance_steered"}.isdisjoint(names):
            columns |= gated_covariances(view, index, toward=toward)
        each.append(columns)
    return {
        name: np.stack([columns[name] for columns in each], axis=1).reshape(-1, *first.shape[1:])
        for name, first in each[0].items()
    }


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
        {"covariance": band_average(covariances)} if tensor else {},
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
    return {"peak_to_rms": ratio(peak, rms), "second_to_first": ratio(second, peak)}


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
        "coherence": ratio(here**2, aligned.shape[-1] * np.sum(aligned**2, axis=-1)),
        "joint": ratio(here, rms),
        "joint_max": ratio(highest, rms),
        "joint_ratio": ratio(here, highest),
        "joint_score": ratio(here, energy),
        "joint_lag": np.abs(best % steered.shape[-1] - index).astype(float),
        "gated_ratio": decibel(ratio(gated[rows, nearest].astype(float), gated.mean(axis=-1))),
    }


def align(matched: MatchedFilter, index: Array, *, toward: Array) -> Array:
    """Return r_m(toa + eta_m + k) for `SEGMENT` lags k around 0, shape (B, M, SEGMENT).

    Args:
        matched: matched-filter view of B observations.
        index: lag indices of the echoes, shape (B,).
        toward: unit vectors for which microphones are delayed by eta_m, shape (B, 3).
    """
    advanced = advance(matched.padded, matched.eta(toward)[:, None])
    return cut(advanced[:, 0], index)


def cut(padded: Array, index: Array) -> Array:
    """Return `SEGMENT` lags centred on lag indices (B,) of `padded` (B, M, L + 2 PAD)."""
    lags = index[:, None] + PAD - SEGMENT // 2 + np.arange(SEGMENT)
    return np.take_along_axis(padded, lags[:, None, :], axis=-1)


def gated_covariances(matched: MatchedFilter, index: Array, *, toward: Array) -> dict[str, Array]:
    """Return the covariance tensors of the matched filters around the echo, plain and steered.

    Args:
        matched: matched-filter view of B observations.
        index: lag indices of the echoes, shape (B,).
        toward: unit vectors of their directions, shape (B, 3).
    """
    window = np.hanning(SEGMENT + 1)[:-1]
    segments = {
        "covariance_gated": cut(matched.padded, index),
        "covariance_steered": align(matched, index, toward=toward),
    }
    found = {}
    for name, segment in segments.items():
        spectrum = fft.rfft(segment * window)[..., None]
        found[name] = band_average(beamforming.covariance(spectrum))
    return found


def band_average(covariances: Array) -> Array:
    """Return covariances (B, F, M, M) averaged over equal bands: packed, trace M, without bin 0."""
    # Bin 0 holds no echo, only offsets of the microphones.
    bins = (covariances.shape[1] - 1) // COVARIANCE_BANDS
    used = covariances[:, 1 : 1 + bins * COVARIANCE_BANDS]
    banded = used.reshape(len(used), COVARIANCE_BANDS, bins, *used.shape[2:])
    packed = beamforming.pack_hermitian(banded.mean(axis=2))
    microphones = covariances.shape[-1]
    trace = packed[..., :microphones].sum(axis=-1, keepdims=True)
    return (packed * microphones / np.maximum(trace, 1e-30)).astype(np.float32)


def ratio(numerator: Array, denominator: Array) -> Array:
    """Return numerator / denominator, 0 where the denominator vanishes (a silent recording)."""
    safe = np.where(denominator == 0, 1.0, denominator)
    return np.where(denominator == 0, 0.0, numerator / safe)
