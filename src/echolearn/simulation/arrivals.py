"""Single arrivals of a response: taken out as an engine has put them there, changed, put back.

An arrival is g phi(n - t), with the phi of `image_loops`. Of it may be left fewer high frequencies,
and a rough wall makes it a cluster (`kernels`).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array
from echolearn.simulation.kernels import low_band

MARGIN = 24
"""Samples on either side of phi into which a filter of phase zero may reach."""


@dataclass(frozen=True, eq=False)
class Arrivals:
    """P arrivals at M microphones.

    Attributes:
        delay: t, in samples, shape (P, M).
        gain: g, shape (P, M).
        highs: share of high frequencies that is left, shape (P, 1) or (P, M).
        clusters: what each becomes in time, shape (P, T).
    """

    delay: Array
    gain: Array
    highs: Array
    clusters: Array

    def scaled(self, factor: Array) -> "Arrivals":
        """Return the same with gains multiplied by factors (P, 1) or (P, M)."""
        return replace(self, gain=self.gain * factor)

    def beside(self, other: "Arrivals") -> "Arrivals":
        """Return these and others together."""
        taps = max(self.clusters.shape[1], other.clusters.shape[1])
        own = np.pad(self.clusters, [(0, 0), (0, taps - self.clusters.shape[1])])
        others = np.pad(other.clusters, [(0, 0), (0, taps - other.clusters.shape[1])])
        return Arrivals(
            delay=np.concatenate([self.delay, other.delay]),
            gain=np.concatenate([self.gain, other.gain]),
            highs=np.concatenate([self.highs, other.highs]),
            clusters=np.concatenate([own, others]),
        )

    def subtract(self, response: Array) -> None:
        """Take the plain arrivals out of a response (M, K)."""
        first, taps = self._plain()
        _add(response, first, -taps)

    def add(self, response: Array, *, sample_rate: float) -> None:
        """Add the arrivals, with what has become of them, to a response (M, K)."""
        first, taps = self._plain()
        length = 2 * MARGIN + taps.shape[-1] + self.clusters.shape[-1]
        size = fft.next_fast_len(length, real=True)
        low = low_band(fft.rfftfreq(size, 1.0 / sample_rate))
        share = low + self.highs[..., None] * (1.0 - low)
        cluster = fft.rfft(self.clusters, size)[:, None]
        padded = np.pad(taps, [(0, 0), (0, 0), (MARGIN, 0)])
        changed = fft.irfft(fft.rfft(padded, size) * share * cluster, size)
        _add(response, first - MARGIN, changed[..., :length])

    def _plain(self) -> tuple[Array, Array]:
        """Return the first sample (P, M) of each arrival and its taps (P, M, 2 half)."""
        from echolearn.simulation.image_loops import HALF_WIDTH, fractional_delay

        first = np.floor(self.delay).astype(np.int64) - HALF_WIDTH + 1
        offset = first[..., None] + np.arange(2 * HALF_WIDTH) - self.delay[..., None]
        return first, self.gain[..., None] * fractional_delay(offset)


def _add(response: Array, first: Array, taps: Array) -> None:
    """Add taps (P, M, T) from sample `first` (P, M) on; what lies outside (M, K) is left out."""
    microphones, length = response.shape
    at = first[..., None] + np.arange(taps.shape[-1])
    inside = (at >= 0) & (at < length)
    flat = at + length * np.arange(microphones)[:, None]
    total = np.bincount(flat[inside], taps[inside], minlength=response.size)
    response += total.reshape(response.shape)
