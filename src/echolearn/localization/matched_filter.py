"""The matched-filter view of a block of observations, shared by the localizers and the features.

r_m(tau) = sum_n y_m(n + tau) s(n) is computed once over the search window (plus `PAD` lags on
either side). S-NLS is its argmax at microphone 1 (Eq. 13), and steering it gives J(tau, phi), of
which the echo-gated direction is one row.
"""

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.arrays import tells_up
from echolearn.acoustics.bistatic import upright_elevation
from echolearn.acoustics.geometry import SearchWindow, relative_delays
from echolearn.acoustics.types import Array, Observation
from echolearn.checks import check, check_whole
from echolearn.localization.beamforming import direction_grid
from echolearn.localization.correlations import PAD, advance, steered_response
from echolearn.localization.faults import check_recordings
from echolearn.localization.silence import silent_microphones

PEAK_SPACING = 5
"""Lags between two peaks of a correlation that count as two, and so those an echo takes."""

GATE = 2
"""Lags on either side of a time of arrival from which the echo-gated direction is taken."""

SEGMENT = 64
"""Lags of the matched filters around an echo from which its tensors are taken."""


@dataclass(frozen=True)
class Filters:
    """What computes matched filters; the compiled transforms of SciPy unless given.

    Attributes:
        correlate: returns r_m, as `signals.matched_filter` does.
        steer: returns J, as `steered_response` does.
    """

    correlate: Callable[..., Array] = signals.matched_filter
    steer: Callable[..., Array] = steered_response


COMPILED = Filters()


@dataclass(frozen=True)
class MatchedFilter:
    """Matched-filter outputs of observations with samples (B, M, N).

    Attributes:
        observation: what was recorded.
        window: where echoes are sought.
        azimuths: number of directions in the array's plane that the steered response covers,
            besides its axis.
        white: whether recordings and probe have been whitened. Such echoes ring close to half the
            sample rate, so they are searched on finer grids.
        filters: what computes r_m and J.
        first, last: lags of the window, both inclusive.
        loudness: energy of each recording, shape (B, M).
    """

    observation: Observation
    window: SearchWindow
    azimuths: int = 180
    white: bool = False
    filters: Filters = COMPILED
    first: int = field(init=False)
    last: int = field(init=False)
    loudness: Array = field(init=False)

    def __post_init__(self) -> None:
        first, last, loudness = check_recordings(self.observation, self.window, beyond=PAD)
        object.__setattr__(self, "first", first)
        object.__setattr__(self, "last", last)
        object.__setattr__(self, "loudness", loudness)

    @property
    def scale(self) -> float:
        """Samples per metre of path."""
        return self.observation.probe.sample_rate / self.observation.speed_of_sound

    @cached_property
    def silent(self) -> Array:
        """Microphones that are silent, shape (B, M), bool."""
        return silent_microphones(self.observation.samples, self.loudness)

    @cached_property
    def padded(self) -> Array:
        """r_m(tau) from first - PAD to last + PAD, shape (B, M, L + 2 PAD)."""
        start = self.first - PAD
        # Nothing is recorded before the emission: what is missing there is silence.
        missing = max(-start, 0)
        outputs = self.filters.correlate(
            self.observation.samples,
            self.observation.probe,
            first=start + missing,
            last=self.last + PAD,
        )
        return np.pad(outputs, [(0, 0), (0, 0), (missing, 0)])

    @cached_property
    def correlation(self) -> Array:
        """r_m(tau) inside the window, shape (B, M, L)."""
        return self.padded[..., PAD:-PAD]

    @cached_property
    def energy(self) -> Array:
        """Energy of each recording under the delayed probe, shape (B, M, L)."""
        return signals.energy_under_probe(
            self.observation.samples, self.observation.probe, first=self.first, last=self.last
        )

    @cached_property
    def probe_energy(self) -> float:
        """||s||^2."""
        return self.observation.probe.energy

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        """Azimuths and elevations of the steered response, each (A,): the level plane, its axis.

        Walls are in the plane of a robot that stands upright, floor and ceiling on its axis: above
        stands for below, too, where the array cannot tell them apart. An array higher or lower than
        its loudspeaker sees the plane tilted, as much as halfway through the window.
        """
        azimuth, elevation = direction_grid(self.azimuths)
        array, speed = self.observation.array, self.observation.speed_of_sound
        if array.centre[2] != 0.0:
            halfway = np.full(len(azimuth), self.toa(np.array((self.last - self.first) / 2)))
            elevation = upright_elevation(halfway, azimuth, array=array, speed_of_sound=speed)
        axis = [0.0, np.pi] if tells_up(array) else [0.0]
        return np.append(azimuth, np.zeros(len(axis))), np.append(elevation, axis)

    @cached_property
    def steered(self) -> Array:
        """J(tau, phi) for `directions`, inside the window, shape (B, A, L), float32."""
        whole = self.filters.steer(
            self.padded, self.observation.array, directions=self.directions, scale=self.scale
        )
        return whole[..., PAD:-PAD]

    @cached_property
    def strongest(self) -> Array:
        """S-NLS (Eq. 13): lag index of the largest r_1 in the window, shape (B,)."""
        return self.correlation[:, 0].argmax(axis=-1)

    def with_outputs(self, padded: Array) -> "MatchedFilter":
        """Return a view of the same recordings with other outputs, shaped like `padded`."""
        other = copy(self)
        for name in ("correlation", "steered", "strongest"):
            vars(other).pop(name, None)
        vars(other)["padded"] = padded
        return other

    def upright(self) -> "MatchedFilter":
        """Return a view in which the largest |r_m| of each recording is positive.

        Recordings of echoes whose sign is turned are turned; one that is upright stays as it is.
        """
        outputs = self.correlation
        down = -outputs.min(axis=(-2, -1)) > outputs.max(axis=(-2, -1))
        if not down.any():
            return self
        sign = np.where(down, -1.0, 1.0)[:, None, None]
        turned = replace(self.observation, samples=sign * self.observation.samples)
        return replace(self, observation=turned).with_outputs(sign * self.padded)

    def toa(self, index: Array) -> Array:
        """Return times of arrival in s of lag indices into the window, any shape."""
        return (self.first + index) / self.observation.probe.sample_rate

    def index(self, toa: Array) -> Array:
        """Return the lag indices nearest to times of arrival in s, clipped to the window."""
        lag = np.rint(np.asarray(toa) * self.observation.probe.sample_rate).astype(int) - self.first
        return np.clip(lag, 0, self.last - self.first)

    def eta(self, toward: Array) -> Array:
        """Return eta_m (Eq. 3) of unit vectors (..., 3), in samples, shape (..., M)."""
        return relative_delays(self.observation.array, toward, scale=self.scale)

    def gated_power(self, index: Array) -> Array:
        """Return sum_k J(tau + k, phi)^2 for |k| <= `GATE`, from lag indices (B,), shape (B, A)."""
        offsets = np.clip(index[:, None] + np.arange(-GATE, GATE + 1), 0, self.last - self.first)
        gate = np.take_along_axis(self.steered, offsets[:, None, :], axis=-1)
        return np.sum(np.square(gate), axis=-1)


def check_extent(matched: MatchedFilter) -> None:
    """Raise `BadValue` unless the array can be steered within `PAD` lags of the window."""
    positions = matched.observation.array.positions
    largest = float(np.linalg.norm(positions - positions[:1], axis=-1).max())
    check(
        largest * matched.scale <= PAD,
        "array.positions",
        f"{largest:.2f} m",
        allowed=f"microphones must be within {PAD / matched.scale:.2f} m of the first",
        hint="are positions in m?",
    )


def check_echoes(matched: MatchedFilter, echoes: int) -> None:
    """Raise `BadValue` if the window has not `PEAK_SPACING` lags for each of R echoes."""
    lags = matched.last - matched.first + 1
    most = lags // PEAK_SPACING
    hint = f"at most {most} fit into a window of {lags} samples; widen the window"
    check_whole("localizer.echoes", echoes, low=1, high=most, hint=hint)


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
