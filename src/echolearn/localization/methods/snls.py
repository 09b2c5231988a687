"""The paper's estimator: S-NLS for the time, whole-recording SRP-MPDR for the direction.

TOA: argmax of r_1(tau) in the search window (Eq. 13), gain by Eq. 11. With several echoes, RELAX
    with refinement
between samples (`components.relax`).
DOA: argmax over directions of the MPDR beam power summed over STFT bins (Eqs. 15-18). It listens to
    the whole
recording, so below 0 dB it finds the noise or the late reverberation rather than the echo. Several
echoes share the
highest peaks of that power: the pairs of time and direction in which the aligned matched filters
    agree most,
one to one.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import SearchWindow, relative_delays
from echolearn.acoustics.types import Array, Echoes, MicArray, Observation
from echolearn.checks import check, check_number, check_whole
from echolearn.localization import beamforming, faults
from echolearn.localization.matched_filter import (
    FINER,
    MatchedFilter,
    check_echoes,
    matched_view,
    reference_search,
    several,
)
from echolearn.localization.whitening import check_whiten


@dataclass(frozen=True)
class Snls:
    """S-NLS and SRP-MPDR.

    Attributes:
        window: where echoes are sought.
        azimuths: size of the azimuth grid (180 is 2 degrees).
        elevations: size of the elevation grid over (0, pi/2]; 1 stays in the array's plane.
        gamma: regularisation of the covariance (Eq. 18).
        echoes: R; 1 is the paper, more are found by RELAX, in the array's plane.
        whiten: divide by the square root of the observation's `noise_psd` first.
    """

    window: SearchWindow = field(default_factory=SearchWindow)
    azimuths: int = 180
    elevations: int = 1
    gamma: float = 0.1
    echoes: int = 1
    whiten: bool = False

    def __post_init__(self) -> None:
        check_whole("localizer.azimuths", self.azimuths, low=8, high=3600)
        check_whiten(self.whiten)
        check_whole("localizer.elevations", self.elevations, low=1, high=90)
        directions = self.azimuths * self.elevations
        allowed = "azimuths * elevations up to 7200, for memory"
        check(directions <= 7200, "localizer.azimuths", self.azimuths, allowed=allowed)
        check_number("localizer.gamma", self.gamma, low=0.0, high=1.0)
        check_whole("localizer.echoes", self.echoes, low=1, high=64)
        flat = self.echoes == 1 or self.elevations == 1
        check(flat, "localizer.elevations", self.elevations, allowed="1 with several echoes")

    def __call__(self, observation: Observation, view: MatchedFilter | None = None) -> Echoes:
        """Estimate the strongest echoes of each observation, samples (B, M, N) -> fields (B, R)."""
        matched = matched_view(
            observation,
            self.window,
            azimuths=self.azimuths,
            whiten=self.whiten,
            whole=True,
            view=view,
        )
        check_echoes(matched, self.echoes)
        faults.tell(matched.silent, reference=True)
        times = reference_echoes(matched, self.echoes, fine=self.whiten)
        return paired(
            matched, times, azimuths=self.azimuths, elevations=self.elevations, gamma=self.gamma
        )


def reference_echoes(matched: MatchedFilter, echoes: int, *, fine: bool = False) -> Echoes:
    """Return times, scores and gains at microphone 1, fields (B, R), directions unknown.

    S-NLS on whole samples; with R > 1, or where asked to be fine, RELAX between them.
    """
    if echoes == 1 and not fine:
        return timed(matched, matched.strongest[:, None])
    peaks = several(matched, reference_search(matched, finer=FINER if fine else 1), echoes=echoes)
    lag, gain = (
        np.stack([getattr(peak, name) for peak in peaks], axis=-1) for name in ("lag", "gain")
    )
    order = np.argsort(-gain, axis=-1, kind="stable")
    lag, gain = np.take_along_axis(lag, order, axis=-1), np.take_along_axis(gain, order, axis=-1)
    under = np.take_along_axis(matched.energy[:, 0], np.rint(lag).astype(int), axis=-1)
    score = np.clip(
        gain * np.sqrt(matched.probe_energy / np.where(under > 0, under, np.inf)), -1.0, 1.0
    )
    return Echoes(matched.toa(lag), score, gain, *(np.zeros(lag.shape) for _ in range(3)))


def timed(matched: MatchedFilter, index: Array) -> Echoes:
    """Return echoes at lag indices (B, R), directions unknown."""
    score, gain = (
        np.stack([f(column) for column in index.T], axis=-1) for f in (matched.score, matched.gain)
    )
    return Echoes(matched.toa(index), score, gain, *(np.zeros(index.shape) for _ in range(3)))


def paired(
    matched: MatchedFilter, times: Echoes, *, azimuths: int, gamma: float, elevations: int = 1
) -> Echoes:
    """Return echoes (B, R) with the directions of the highest peaks of the MPDR power, each
    direction once.
    """
    power = heard_spectrum(matched, azimuths=azimuths, elevations=elevations, gamma=gamma)
    azimuth, elevation = beamforming.direction_grid(azimuths, elevations)
    best = power.argmax(axis=-1)[:, None]
    if times.toa.shape[-1] > 1:
        best = assign(matched, times.toa, beamforming.summits(power, times.toa.shape[-1]))
    fields = (
        times.toa,
        times.score,
        times.gain,
        azimuth[best],
        elevation[best],
        np.take_along_axis(power, best, -1),
    )
    return Echoes(*(np.asarray(value, dtype=float) for value in fields))


def assign(matched: MatchedFilter, toa: Array, summits: Array) -> Array:
    """Return which directions of `summits` (B, R), indices of the azimuth grid, times (B, R) have,
    each once.

    The pair with the largest J(tau, phi) is made first, then that of the rest.
    """
    azimuth = beamforming.azimuth_grid(matched.azimuths)[summits]
    eta = relative_delays(matched.observation.array, azimuth, np.pi / 2, 1.0) * matched.scale
    steered = beamforming.advance(matched.padded, eta).sum(axis=-2)
    index = matched.index(toa)[:, None, :] + beamforming.PAD
    alike = np.swapaxes(np.take_along_axis(steered, index, axis=-1), 1, 2)
    rows, chosen = np.arange(len(toa)), np.zeros(toa.shape, dtype=int)
    for _ in range(toa.shape[-1]):
        time, way = np.unravel_index(alike.reshape(len(toa), -1).argmax(axis=-1), alike.shape[1:])
        chosen[rows, time] = summits[rows, way]
        alike[rows, time, :] = alike[rows, :, way] = -np.inf
    return chosen


def heard_spectrum(
    matched: MatchedFilter, *, azimuths: int = 180, elevations: int = 1, gamma: float = 0.1
) -> Array:
    """Return the MPDR power of the microphones that hear, shape (B, A); those that do not are left
    out.
    """
    observation, silent = matched.observation, matched.silent
    if not silent.any():
        return mpdr_spectrum(observation, azimuths=azimuths, elevations=elevations, gamma=gamma)
    power = np.zeros((len(silent), azimuths * elevations), dtype=np.float32)
    for pattern in np.unique(silent, axis=0):
        rows = (silent == pattern).all(axis=-1)
        array = MicArray(observation.array.positions[~pattern])
        fewer = replace(observation, samples=observation.samples[rows][:, ~pattern], array=array)
        power[rows] = mpdr_spectrum(fewer, azimuths=azimuths, elevations=elevations, gamma=gamma)
    return power


def mpdr_spectrum(
    observation: Observation, *, azimuths: int = 180, elevations: int = 1, gamma: float = 0.1
) -> Array:
    """Return the whole-recording SRP-MPDR power over directions (Eq. 16), shape (B, A), from
    samples (B, M, N).
    """
    return spectrum_of(
        recording_covariance(observation),
        observation,
        azimuths=azimuths,
        elevations=elevations,
        gamma=gamma,
    )


def recording_covariance(observation: Observation) -> Array:
    """Return the covariance of the whole recording per STFT bin (Eq. 17), shape (B, F, M, M),
    complex64.
    """
    return beamforming.covariance(signals.stft(observation.samples.astype(np.float32)))


def spectrum_of(
    covariances: Array,
    observation: Observation,
    *,
    azimuths: int = 180,
    elevations: int = 1,
    gamma: float = 0.1,
) -> Array:
    """Return the SRP-MPDR power over directions, shape (B, A), of covariances (B, F, M, M)."""
    weights = beamforming.steering_weights(
        observation.array,
        azimuths,
        elevations,
        frame=signals.FRAME,
        sample_rate=observation.probe.sample_rate,
        speed_of_sound=observation.speed_of_sound,
    )
    return beamforming.mpdr_power(covariances, weights, gamma=gamma)
