"""Single arrivals of a response: taken out as an engine has put them there, changed, put back.

An arrival is g phi(n - t), with the phi of `image_loops`, read from a table. Of it may be left
fewer high frequencies, and a rough wall makes it a cluster (`kernels`).
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array
from echolearn.simulation.kernels import low_band

MARGIN = 24
"""Samples on either side of phi into which a filter of phase zero may reach."""

STEPS = 512
"""Rows in the table of phi, for one sample; between them it errs by less than -110 dB."""


@dataclass(frozen=True, eq=False)
class SoundPaths:
    """P arrivals at M microphones.

    Attributes:
        delay: t, in samples, shape (P, M).
        gain: g, shape (P, M).
        highs: share of high frequencies that is left, shape (P, M).
        clusters: what each becomes in time, shape (P, T).
    """

    delay: Array
    gain: Array
    highs: Array
    clusters: Array

    def scaled(self, factor: Array) -> "SoundPaths":
        """Return the same with gains multiplied by factors that broadcast to (P, M)."""
        return replace(self, gain=self.gain * factor)

    def beside(self, other: "SoundPaths") -> "SoundPaths":
        """Return these and others together."""
        taps = max(self.clusters.shape[1], other.clusters.shape[1])
        own = np.pad(self.clusters, [(0, 0), (0, taps - self.clusters.shape[1])])
        others = np.pad(other.clusters, [(0, 0), (0, taps - other.clusters.shape[1])])
        return SoundPaths(
            delay=np.concatenate([self.delay, other.delay]),
            gain=np.concatenate([self.gain, other.gain]),
            highs=np.concatenate([self.highs, other.highs]),
            clusters=np.concatenate([own, others]),
        )

    def subtract(self, response: Array) -> None:
        """Take the plain arrivals out of a response (M, K)."""
        from echolearn.simulation.fir_loops import add

        first, taps = self._plain()
        add(response, first, -taps)

    def add(self, response: Array, *, microphones: Array, sample_rate: float) -> None:
        """Add the arrivals, with what has become of them, to a response (M, K).

        Args:
            response: is changed.
            microphones: their own responses, shape (M, T).
            sample_rate: in Hz.
        """
        from echolearn.simulation.fir_loops import add

        first, taps = self._plain()
        reach = self.clusters.shape[-1] + microphones.shape[-1]
        size = fft.next_fast_len(taps.shape[-1] + 2 * MARGIN + reach, real=True)
        low = low_band(fft.rfftfreq(size, 1.0 / sample_rate))
        share = low + self.highs[..., None] * (1.0 - low)
        after = fft.rfft(self.clusters, size)[:, None] * fft.rfft(microphones, size)
        # What a filter of phase zero puts before the first tap comes out at the end.
        changed = fft.irfft(fft.rfft(taps, size) * share * after, size)
        add(response, first - MARGIN, np.roll(changed, MARGIN, axis=-1))

    def _plain(self) -> tuple[Array, Array]:
        """Return the first sample (P, M) of each arrival and its taps (P, M, 2 half)."""
        table = _phi()
        whole = np.floor(self.delay)
        place = (self.delay - whole) * STEPS
        row = place.astype(np.int64)
        weight = self.gain * (place - row)
        taps = table[row + 1] * weight[..., None] + table[row] * (self.gain - weight)[..., None]
        return whole.astype(np.int64) - (table.shape[1] // 2 - 1), taps


@lru_cache
def _phi() -> Array:
    """Return the taps of phi for each step of a fractional delay, shape (STEPS + 1, 2 half)."""
    from echolearn.simulation.image_loops import HALF_WIDTH, fractional_delay

    fraction = np.arange(STEPS + 1)[:, None] / STEPS
    return fractional_delay(np.arange(1 - HALF_WIDTH, HALF_WIDTH + 1) - fraction)
