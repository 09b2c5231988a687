"""The matched-filter view of a block of observations, shared by the localizers and the features.

r_m(tau) is computed once over the search window (plus `PAD` lags on either side); S-NLS is its argmax at
microphone 1, and steering it gives J(tau, phi), of which the echo-gated direction is one row.
"""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from echolearn import signals
from echolearn.geometry import SearchWindow
from echolearn.localize import beam
from echolearn.types import Array, Observation, check

GATE = 2
"""Lags on either side of the estimated TOA that the echo-gated direction listens to."""


@dataclass(frozen=True)
class Matched:
    """Matched-filter outputs of observations with samples (B, M, N).

    Attributes:
        observation: what was recorded.
        window: where echoes are sought.
        azimuths: directions in the array's plane that the steered response covers, besides its axis.
    """

    observation: Observation
    window: SearchWindow
    azimuths: int = 180
    first: int = field(init=False)
    last: int = field(init=False)

    def __post_init__(self) -> None:
        probe, array = self.observation.probe, self.observation.array
        first, last = self.window.lags(array, probe.sample_rate, self.observation.speed_of_sound)
        length = self.observation.samples.shape[-1]
        check(
            last + beam.PAD < length,
            "window.farthest",
            f"{self.window.farthest} m",
            allowed=f"echoes within the recording of {length} samples",
            hint="the recording is too short, or its sample rate is not the probe's",
        )
        finite = bool(np.isfinite(self.observation.samples).all())
        check(
            finite, "observation.samples", "NaN or infinity", allowed="finite samples", hint="is a microphone broken?"
        )
        object.__setattr__(self, "first", first)
        object.__setattr__(self, "last", last)

    @property
    def scale(self) -> float:
        """Samples per metre of path."""
        return self.observation.probe.sample_rate / self.observation.speed_of_sound

    @cached_property
    def padded(self) -> Array:
        """r_m(tau) from first - PAD to last + PAD, shape (B, M, L + 2 PAD)."""
        start = self.first - beam.PAD
        skipped = max(-start, 0)
        full = signals.matched_filter(
            self.observation.samples, self.observation.probe, first=start + skipped, last=self.last + beam.PAD
        )
        return np.pad(full, [(0, 0), (0, 0), (skipped, 0)])

    @cached_property
    def correlation(self) -> Array:
        """r_m(tau) inside the window, shape (B, M, L)."""
        return self.padded[..., beam.PAD : -beam.PAD]

    @cached_property
    def energy(self) -> Array:
        """Energy of each recording under the delayed probe, shape (B, M, L)."""
        observation = self.observation
        return signals.energy_under_probe(observation.samples, observation.probe, first=self.first, last=self.last)

    @cached_property
    def probe_energy(self) -> float:
        """||s||^2."""
        return float(np.sum(np.square(self.observation.probe.samples)))

    @cached_property
    def directions(self) -> tuple[Array, Array]:
        """Azimuths and elevations of the steered response, each (A,): the array's plane, and its axis last.

        Walls are in the plane of a robot that stands upright, floor and ceiling on its axis.
        """
        azimuth, elevation = beam.direction_grid(self.azimuths)
        return np.append(azimuth, 0.0), np.append(elevation, 0.0)

    @cached_property
    def steered(self) -> Array:
        """J(tau, phi) for `directions`, inside the window, shape (B, A, L), float32."""
        full = beam.steered_response(self.padded, self.observation.array, *self.directions, scale=self.scale)
        return full[..., beam.PAD : -beam.PAD]

    @cached_property
    def strongest(self) -> Array:
        """S-NLS (Eq. 13): lag index of the largest r_1 in the window, shape (B,)."""
        return self.correlation[:, 0].argmax(axis=-1)

    def toa(self, index: Array) -> Array:
        """Return times of arrival in s of lag indices (B,) into the window."""
        return (self.first + index) / self.observation.probe.sample_rate

    def index(self, toa: Array) -> Array:
        """Return the lag index (B,) nearest to times of arrival in s, clipped to the window."""
        lag = np.rint(np.asarray(toa) * self.observation.probe.sample_rate).astype(int) - self.first
        return np.clip(lag, 0, self.last - self.first)

    def score(self, index: Array) -> Array:
        """Return the normalised correlation of microphone 1 with the probe at lag indices (B,), -1 to 1."""
        rows = np.arange(len(index))
        energy = np.maximum(self.energy[rows, 0, index] * self.probe_energy, 1e-30)
        return self.correlation[rows, 0, index] / np.sqrt(energy)

    def gain(self, index: Array) -> Array:
        """Return the gain of the echo at lag indices (B,) (Eq. 11): r_1 / ||s||^2."""
        return self.correlation[np.arange(len(index)), 0, index] / self.probe_energy

    def gated_power(self, index: Array) -> Array:
        """Return the steered power within `GATE` lags of lag indices (B,): sum_k J(tau + k, phi)^2, shape (B, A)."""
        offsets = np.clip(index[:, None] + np.arange(-GATE, GATE + 1), 0, self.last - self.first)
        rows = np.arange(len(index))[:, None, None]
        gate = self.steered[rows, np.arange(self.azimuths + 1)[:, None], offsets[:, None, :]]
        return np.sum(np.square(gate), axis=-1)
