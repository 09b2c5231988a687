"""The matched-filter view of a block of observations, shared by the localizers and the features.

r_m(tau) is computed once over the search window (plus `PAD` lags on either side); S-NLS is its
argmax at microphone 1, and steering it gives J(tau, phi), of which the echo-gated direction is one
row.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, Echoes, MicArray, Observation
from echolearn.checks import check, check_whole
from echolearn.localization import beamforming, faults
from echolearn.localization.relax import relax
from echolearn.localization.search import Peak, Search
from echolearn.localization.whitening import check_known, whitened

APART = 5
"""Lags that an echo takes of the window, for counting how many it can hold."""

FINER = 4
"""Points per lag at which whitened recordings are searched."""

GATE = 2
"""Lags on either side of the estimated TOA that the echo-gated direction listens to."""


@dataclass(frozen=True)
class MatchedFilter:
    """MatchedFilter-filter outputs of observations with samples (B, M, N).

    Attributes:
        observation: what was recorded.
        window: where echoes are sought.
        azimuths: directions in the array's plane that the steered response covers, besides its
            axis.
    """

    observation: Observation
    window: SearchWindow
    azimuths: int = 180
    first: int = field(init=False)
    last: int = field(init=False)

    def __post_init__(self) -> None:
        first, last = faults.check_recordings(self.observation, self.window)
        object.__setattr__(self, "first", first)
        object.__setattr__(self, "last", last)

    @property
    def scale(self) -> float:
        """Samples per metre of path."""
        return self.observation.probe.sample_rate / self.observation.speed_of_sound

    @cached_property
    def silent(self) -> Array:
        """Which microphones do not hear, shape (B, M), bool."""
        return faults.deaf(self.observation.samples)

    @cached_property
    def padded(self) -> Array:
        """r_m(tau) from first - PAD to last + PAD, shape (B, M, L + 2 PAD)."""
        start = self.first - beamforming.PAD
        skipped = max(-start, 0)
        full = signals.matched_filter(
            self.observation.samples,
            self.observation.probe,
            first=start + skipped,
            last=self.last + beamforming.PAD,
        )
        return np.pad(full, [(0, 0), (0, 0), (skipped, 0)])

    @cached_property
    def correlation(self) -> Array:
        """r_m(tau) inside the window, shape (B, M, L)."""
        return self.padded[..., beamforming.PAD : -beamforming.PAD]

    @cached_property
    def energy(self) -> Array:
        """Energy of each recording under the delayed probe, shape (B, M, L)."""
        observation = self.observation
        return signals.energy_under_probe(
            observation.samples, observation.probe, first=self.first, last=self.last
        )

    @cached_property
    def probe_energy(self) -> float:
        """||s||^2."""
        return float(np.sum(np.square(self.observation.probe.samples)))

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        """Azimuths and elevations of the steered response, each (A,): the array's plane, and its
        axis last.

        Walls are in the plane of a robot that stands upright, floor and ceiling on its axis.
        """
        azimuth, elevation = beamforming.direction_grid(self.azimuths)
        return np.append(azimuth, 0.0), np.append(elevation, 0.0)

    @cached_property
    def steered(self) -> Array:
        """J(tau, phi) for `directions`, inside the window, shape (B, A, L), float32."""
        full = beamforming.steered_response(
            self.padded, self.observation.array, *self.directions, scale=self.scale
        )
        return full[..., beamforming.PAD : -beamforming.PAD]

    @cached_property
    def strongest(self) -> Array:
        """S-NLS (Eq. 13): lag index of the largest r_1 in the window, shape (B,)."""
        return self.correlation[:, 0].argmax(axis=-1)

    def having(self, padded: Array) -> "MatchedFilter":
        """Return a view of the same recordings that has other matched-filter outputs, shaped like
        `padded`.
        """
        other = copy(self)
        for name in ("correlation", "steered", "strongest"):
            vars(other).pop(name, None)
        vars(other)["padded"] = padded
        return other

    def toa(self, index: Array) -> Array:
        """Return times of arrival in s of lag indices (B,) into the window."""
        return (self.first + index) / self.observation.probe.sample_rate

    def index(self, toa: Array) -> Array:
        """Return the lag index (B,) nearest to times of arrival in s, clipped to the window."""
        lag = np.rint(np.asarray(toa) * self.observation.probe.sample_rate).astype(int) - self.first
        return np.clip(lag, 0, self.last - self.first)

    def score(self, index: Array) -> Array:
        """Return the normalised correlation of microphone 1 with the probe at lag indices (B,), -1
        to 1.
        """
        rows = np.arange(len(index))
        energy = np.maximum(self.energy[rows, 0, index] * self.probe_energy, 1e-30)
        return self.correlation[rows, 0, index] / np.sqrt(energy)

    def gain(self, index: Array) -> Array:
        """Return the gain of the echo at lag indices (B,) (Eq. 11): r_1 / ||s||^2."""
        return self.correlation[np.arange(len(index)), 0, index] / self.probe_energy

    def gated_power(self, index: Array) -> Array:
        """Return the steered power within `GATE` lags of lag indices (B,): sum_k J(tau + k, phi)^2,
        shape (B, A).
        """
        offsets = np.clip(index[:, None] + np.arange(-GATE, GATE + 1), 0, self.last - self.first)
        rows = np.arange(len(index))[:, None, None]
        gate = self.steered[rows, np.arange(self.azimuths + 1)[:, None], offsets[:, None, :]]
        return np.sum(np.square(gate), axis=-1)


def matched_view(
    observation: Observation,
    window: SearchWindow,
    *,
    azimuths: int,
    whiten: bool,
    whole: bool,
    view: "MatchedFilter | None" = None,
) -> "MatchedFilter":
    """Check recordings, whiten them where asked, and return their matched-filter view.

    Args:
        observation: recordings (B, M, N).
        window: where echoes are sought.
        azimuths: of the steered response.
        whiten: divide by the square root of the noise density first.
        whole: whether more of the recordings is needed than the search window touches.
        view: of the same recordings, if somebody has made one; it is returned where it serves.
    """
    if not whiten:
        if view is not None and (view.window, view.azimuths) == (window, azimuths):
            return view
        return MatchedFilter(observation, window, azimuths)
    _, last = faults.check_recordings(observation, window)
    check_known(observation)
    taps = 2 * faults.density(observation).shape[-1]
    touched = last + beamforming.PAD + len(observation.probe.samples) + taps
    return MatchedFilter(
        whitened(observation, samples=None if whole else touched), window, azimuths
    )


def check_extent(matched: MatchedFilter) -> None:
    """Raise `BadValue` unless the array is small enough to be steered within `PAD` lags of the
    window.
    """
    positions = matched.observation.array.positions
    largest = float(np.linalg.norm(positions - positions[:1], axis=-1).max())
    allowed = f"microphones up to {beamforming.PAD / matched.scale:.2f} m from the first"
    check(
        largest * matched.scale <= beamforming.PAD,
        "array.positions",
        f"{largest:.2f} m",
        allowed=allowed,
    )


def check_echoes(matched: MatchedFilter, echoes: int) -> None:
    """Raise `BadValue` if the window has not `APART` lags for each of R echoes."""
    lags = matched.last - matched.first + 1
    allowed = f"at most {lags // APART} in a window of {lags} samples"
    check_whole(
        "localizer.echoes", echoes, low=1, high=lags // APART, hint=f"{allowed}; widen the window"
    )


def joint_search(
    matched: MatchedFilter, *, weights: Array | None = None, refine: bool = True, finer: int = 1
) -> Search:
    """Return the search of J over all microphones that hear, or with `weights` (B, M)."""
    check_extent(matched)
    if weights is None:
        weights = (~matched.silent).astype(float)
    energy = matched.probe_energy
    return Search(
        matched.observation.array,
        *matched.directions,
        matched.scale,
        weights,
        energy,
        refine,
        finer,
    )


def reference_search(matched: MatchedFilter, *, refine: bool = True, finer: int = 1) -> Search:
    """Return the search of r_1, the matched filter of microphone 1 alone."""
    alone = MicArray(matched.observation.array.positions[:1])
    nowhere, ones = np.zeros(1), np.ones((len(matched.padded), 1))
    return Search(alone, nowhere, nowhere, matched.scale, ones, matched.probe_energy, refine, finer)


def several(
    matched: MatchedFilter, search: Search, *, echoes: int, padded: Array | None = None
) -> list[Peak]:
    """Return R echoes by RELAX, of all microphones or of the first, as the search has them.

    Args:
        matched: the recordings.
        search: of echoes.
        echoes: R.
        padded: correlations to search instead of the recordings' own, shape (B, M, L + 2 PAD).
    """
    microphones = len(search.array)
    energy = faults.energies(matched.observation.samples[:, :microphones])
    burst = matched.observation.probe.samples
    heard = matched.padded[:, :microphones] if padded is None else padded
    surface = (
        matched.steered if padded is None and search.is_plain(matched.padded.shape[1]) else None
    )
    return relax(heard, search, echoes=echoes, burst=burst, energy=energy, surface=surface)


def joint_echoes(matched: MatchedFilter, search: Search, peaks: Sequence[Peak]) -> Echoes:
    """Return peaks of J as echoes, fields (B, R), the strongest first; the score is that of all
    microphones together.

    score = J / (||s|| sqrt(sum_m w_m) sqrt(sum_m w_m E_m)), E_m the energy under the aligned probe; power = J^2.
    """
    rows, names = [], ("lag", "azimuth", "elevation", "gain", "height")
    for peak in peaks:
        delays = np.rint(search.delays(peak.lag, peak.azimuth, peak.elevation)).astype(int)
        index = np.clip(delays, 0, matched.last - matched.first)
        energy = np.take_along_axis(matched.energy, index[..., None], axis=-1)[..., 0]
        share = search.share(peak.azimuth, peak.elevation)
        largest = share * (search.weights * energy).sum(axis=-1) * matched.probe_energy
        score = np.clip(peak.height / np.sqrt(np.where(largest > 0, largest, np.inf)), -1.0, 1.0)
        rows.append(np.stack([*(getattr(peak, name) for name in names), score]))
    stacked = np.stack(rows, axis=-1)
    order = np.argsort(-stacked[3], axis=-1, kind="stable")
    lag, azimuth, elevation, gain, height, score = np.take_along_axis(stacked, order[None], axis=-1)
    return Echoes(matched.toa(lag), score, gain, azimuth, elevation, height**2)
