"""What a classifier may look at: named columns of an echo, and covariance tensors of its
observation.

Columns marked (g) change with the gain of the recording; the others are dimensionless.

| column          | unit | meaning                                                                             |
|-----------------|------|-------------------------------------------------------------------------------------|
| toa             | s    | estimated time of arrival at microphone 1                                           |
| score           | 1    | normalised correlation of microphone 1 with the probe at toa                        |
| peak_to_rms     | 1    | r_1(toa) over the rms of r_1 in the search window                                   |
| second_to_first | 1    | second highest peak of r_1, at least 5 lags away, over r_1(toa)                     |
| gain            | (g)  | amplitude of the echo (Eq. 11)                                                      |
| gain_delay      | m (g)| 4 pi c toa gain: a wall's reflection coefficient if loudspeaker and gain are known   |
| power           | dB(g)| whole-recording MPDR beam power, the paper's second feature (Eq. 16)                |
| power_ratio     | dB   | that power over its mean over azimuth                                               |
| coherence       | 1    | (sum_m a_m)^2 / (M sum_m a_m^2), a_m = r_m(toa + eta_m(doa)); 1 is a plane wave      |
| joint           | 1    | J(toa, doa) over the rms of J in the window                                         |
| joint_max       | 1    | maximum of J over the same rms                                                      |
| joint_ratio     | 1    | J(toa, doa)     over the maximum of J                                               |
| joint_score     | 1    | J(toa, doa)     as a normalised correlation over all microphones                    |
| joint_lag       | samples | |toa - time of the maximum of J|                                                 |
| gated_ratio     | dB   | gated power at the doa over its mean over directions                                |
| azimuth, elevation | rad | direction the localizer chose                                                     |
| azimuth_mpdr    | rad  | direction of the whole-recording MPDR (the paper's)                                 |

Tensors are (BANDS, M*M) packed Hermitian matrices (`beam.pack`), each band scaled to trace M:
`covariance` of the whole recording, `covariance_gated` of the matched-filter outputs around the
echo, `covariance_steered` the same after steering to the estimated direction, so that an echo from
there is all ones whatever its direction.
"""

from collections.abc import Collection, Mapping
from dataclasses import fields

import numpy as np
from scipy import fft

from echolearn.acoustics.geometry import direction
from echolearn.acoustics.signals import decibel
from echolearn.acoustics.types import Array, Echoes
from echolearn.localization import beamforming
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.methods.snls import recording_covariance, spectrum_of
from echolearn.localization.separation import apart

BANDS = 16
SEGMENT = 64
"""MatchedFilter-filter lags around an echo from which its covariance is taken."""

COLUMNS = (
    "toa score peak_to_rms second_to_first gain gain_delay power power_ratio coherence joint joint_max "
    "joint_ratio joint_score joint_lag gated_ratio azimuth elevation azimuth_mpdr"
).split()
UNITS = {
    **dict.fromkeys(COLUMNS, "1"),
    **dict.fromkeys(("power", "power_ratio", "gated_ratio"), "dB"),
    **dict.fromkeys(("azimuth", "elevation", "azimuth_mpdr"), "rad"),
    **{"toa": "s", "gain_delay": "m", "joint_lag": "samples"},
}
"""Unit of each column."""

TENSORS = ("covariance", "covariance_gated", "covariance_steered")


def describe(
    matched: MatchedFilter, echoes: Echoes, *, names: Collection[str] = (*COLUMNS, *TENSORS)
) -> dict[str, Array]:
    """Return columns, shape (B * R,), and tensors, shape (B * R, BANDS, M*M): a row for each echo.

    Rows go observation by observation. Of several echoes each is described as the others leave it
    (`localize.apart`); what speaks of the whole recording is the same for all of them.

    Args:
        matched: matched-filter view of B observations.
        echoes: their echoes, fields (B, R).
        names: what is wanted; what is costly and only good for others is not computed, though some
            may come along.
    """
    whole = recording_columns(matched, names)
    each = [
        echo_columns(view, echo_of(echoes, r), whole, names)
        for r, view in enumerate(apart(matched, echoes))
    ]
    return {
        name: np.stack([one[name] for one in each], axis=1).reshape(-1, *each[0][name].shape[1:])
        for name in each[0]
    }


def echo_of(echoes: Echoes, r: int) -> Echoes:
    """Return echo number r of each observation, fields (B,)."""
    return Echoes(*(getattr(echoes, field.name)[:, r] for field in fields(Echoes)))


def recording_columns(matched: MatchedFilter, names: Collection[str]) -> dict[str, Array]:
    """Return what speaks of the whole recording, for B observations."""
    beams, tensor = (
        not {"power", "power_ratio", "azimuth_mpdr"}.isdisjoint(names),
        "covariance" in names,
    )
    if not (beams or tensor):
        return {}
    whole = recording_covariance(matched.observation)
    return (beam_columns(whole, matched) if beams else {}) | (
        {"covariance": band_average(whole)} if tensor else {}
    )


def echo_columns(
    matched: MatchedFilter, echo: Echoes, whole: Mapping[str, Array], names: Collection[str]
) -> dict[str, Array]:
    """Return the description of one echo per observation, fields (B,), with what is known of the
    `whole` recording.
    """
    index = matched.index(echo.toa)
    toward = direction(echo.azimuth, echo.elevation)
    known = {
        "toa": echo.toa,
        "score": echo.score,
        "gain": echo.gain,
        "gain_delay": 4 * np.pi * matched.observation.speed_of_sound * echo.toa * echo.gain,
        "azimuth": echo.azimuth,
        "elevation": echo.elevation,
        **peak_columns(matched.correlation[:, 0], index),
        **{name: value for name, value in whole.items() if name != "covariance"},
        **steered_columns(matched, index, toward),
        **{name: value for name, value in whole.items() if name == "covariance"},
    }
    gated = {"covariance_gated", "covariance_steered"}
    return known if gated.isdisjoint(names) else known | gated_covariances(matched, index, toward)


def peak_columns(correlation: Array, index: Array, *, away: int = 5) -> dict[str, Array]:
    """Return the columns that judge the peak of r_1, shape (B, L), at lag indices (B,)."""
    rows = np.arange(len(index))
    peak = correlation[rows, index]
    rms = np.sqrt(np.mean(np.square(correlation), axis=-1))
    elsewhere = np.abs(np.arange(correlation.shape[-1]) - index[:, None]) >= away
    second = np.max(correlation, axis=-1, where=elsewhere, initial=-np.inf)
    return {"peak_to_rms": ratio(peak, rms), "second_to_first": ratio(second, peak)}


def beam_columns(covariances: Array, matched: MatchedFilter) -> dict[str, Array]:
    """Return the columns of the whole-recording MPDR beam, from covariances (B, F, M, M)."""
    spectrum = spectrum_of(covariances, matched.observation, azimuths=matched.azimuths)
    power = decibel(spectrum.max(axis=-1).astype(float))
    return {
        "power": power,
        "power_ratio": power - decibel(spectrum.mean(axis=-1).astype(float)),
        "azimuth_mpdr": beamforming.azimuth_grid(matched.azimuths)[spectrum.argmax(axis=-1)],
    }


def steered_columns(matched: MatchedFilter, index: Array, toward: Array) -> dict[str, Array]:
    """Return the columns that compare all microphones, at lag indices (B,) and unit vectors
    `toward` (B, 3).
    """
    rows, steered = np.arange(len(index)), matched.steered
    lags = steered.shape[-1]
    aligned = align(matched, index, toward)[:, :, SEGMENT // 2]
    here = aligned.sum(axis=-1)
    best = steered.reshape(len(index), -1).argmax(axis=-1)
    highest = steered.reshape(len(index), -1)[rows, best].astype(float)
    rms = np.sqrt(np.mean(np.square(steered), axis=(-2, -1), dtype=float))
    energy = np.sqrt(matched.energy[rows, :, index]).sum(axis=-1) * np.sqrt(matched.probe_energy)
    gated = matched.gated_power(index)
    nearest = (toward @ direction(*matched.directions).T).argmax(axis=-1)
    return {
        "coherence": ratio(here**2, aligned.shape[-1] * np.sum(aligned**2, axis=-1)),
        "joint": ratio(here, rms),
        "joint_max": ratio(highest, rms),
        "joint_ratio": ratio(here, highest),
        "joint_score": ratio(here, energy),
        "joint_lag": np.abs(best % lags - index).astype(float),
        "gated_ratio": decibel(ratio(gated[rows, nearest].astype(float), gated.mean(axis=-1))),
    }


def align(matched: MatchedFilter, index: Array, toward: Array) -> Array:
    """Return r_m(toa + eta_m + k) for k from -SEGMENT/2, eta_m of unit vectors (B, 3), shape (B, M,
    SEGMENT).
    """
    along = toward @ matched.observation.array.positions.T
    eta = (along[:, :1] - along) * matched.scale
    advanced = beamforming.advance(matched.padded, eta[:, None])[:, 0]
    return cut(advanced, index)


def cut(padded: Array, index: Array) -> Array:
    """Return `SEGMENT` lags centred on lag indices (B,) of `padded` (B, M, L + 2 PAD), shape (B, M,
    SEGMENT).
    """
    lags = index[:, None] + beamforming.PAD - SEGMENT // 2 + np.arange(SEGMENT)
    return np.take_along_axis(padded, lags[:, None, :], axis=-1)


def gated_covariances(matched: MatchedFilter, index: Array, toward: Array) -> dict[str, Array]:
    """Return the covariance tensors of the matched-filter outputs around the echo, plain and
    steered.
    """
    segments = {
        "covariance_gated": cut(matched.padded, index),
        "covariance_steered": align(matched, index, toward),
    }
    window = np.hanning(SEGMENT + 1)[:-1]
    spectra = {name: fft.rfft(segment * window)[..., None] for name, segment in segments.items()}
    return {
        name: band_average(beamforming.covariance(spectrum)) for name, spectrum in spectra.items()
    }


def band_average(covariances: Array) -> Array:
    """Return covariances (B, F, M, M), bin 0 left out, averaged over `BANDS` equal bands: packed,
    trace M.
    """
    bins = (covariances.shape[1] - 1) // BANDS
    used = covariances[:, 1 : 1 + bins * BANDS]
    packed = beamforming.pack(used.reshape(len(used), BANDS, bins, *used.shape[2:]).mean(axis=2))
    microphones = covariances.shape[-1]
    trace = packed[..., :microphones].sum(axis=-1, keepdims=True)
    return (packed * microphones / np.maximum(trace, 1e-30)).astype(np.float32)


def ratio(numerator: Array, denominator: Array) -> Array:
    """Return numerator / denominator, 0 where the denominator vanishes (a silent recording)."""
    safe = np.where(denominator == 0, 1.0, denominator)
    return np.where(denominator == 0, 0.0, numerator / safe)
