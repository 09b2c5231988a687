"""Single arrivals of a response: taken out as an engine has put them there, changed, put back.

An arrival is g phi(n - t), with the phi of `image_loops`, read from a table. Of it may be left
fewer high frequencies, and a rough wall makes it a cluster (`kernels`).
"""

from dataclasses import dataclass
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
        return SoundPaths(self.delay, self.gain * factor, self.highs, self.clusters)

    def beside(self, other: "SoundPaths") -> "SoundPaths":
        """Return these and others together."""
        count = len(self.clusters)
        taps = max(self.clusters.shape[1], other.clusters.shape[1])
        clusters = np.zeros((count + len(other.clusters), taps))
        clusters[:count, : self.clusters.shape[1]] = self.clusters
        clusters[count:, : other.clusters.shape[1]] = other.clusters
        return SoundPaths(
            delay=np.concatenate([self.delay, other.delay]),
            gain=np.concatenate([self.gain, other.gain]),
            highs=np.concatenate([self.highs, other.highs]),
            clusters=clusters,
        )

    def subtract(self, response: Array) -> None:
        """Take the plain arrivals out of a response (M, K)."""
        from echolearn.simulation.fir_loops import subtract_pulses

        first, place = self._places()
        subtract_pulses(response, first, table=_phi(), place=place, gain=self.gain)

    def add(self, response: Array, *, microphones: Array, sample_rate: float) -> None:
        """Add the arrivals, with what has become of them, to a response (M, K).

        Args:
            response: is changed.
            microphones: their own responses, shape (M, T).
            sample_rate: in Hz.
        """
        from echolearn.simulation import fir_loops

        reach = self.clusters.shape[-1] + microphones.shape[-1]
        size = fft.next_fast_len(_phi().shape[1] + 2 * MARGIN + reach, real=True)
        first, place = self._places()
        spectra = fir_loops.changed_spectra(
            _spectra(size),
            place,
            gain=self.gain,
            low=_low_band(size, sample_rate),
            highs=self.highs,
            clusters=fft.rfft(self.clusters, size),
            microphones=fft.rfft(microphones, size),
        )
        changed = fft.irfft(spectra, size, overwrite_x=True)
        # What a filter of phase zero puts before the first tap comes out at the end.
        fir_loops.add(response, first, taps=changed, ahead=MARGIN)

    def _places(self) -> tuple[Array, Array]:
        """Return the first sample of each arrival and its row in the table of phi, each (P, M)."""
        whole = np.floor(self.delay)
        place = (self.delay - whole) * STEPS
        return whole.astype(np.int64) - (_phi().shape[1] // 2 - 1), place


@lru_cache
def _spectra(size: int) -> Array:
    """Return the spectra of the table of phi, shape (STEPS + 1, size // 2 + 1)."""
    return fft.rfft(_phi(), size)


@lru_cache
def _low_band(size: int, sample_rate: float) -> Array:
    """Return the low band at the bins of a transform, shape (size // 2 + 1,)."""
    return low_band(fft.rfftfreq(size, 1.0 / sample_rate))


@lru_cache
def _phi() -> Array:
    """Return the taps of phi for each step of a fractional delay, shape (STEPS + 1, 2 half)."""
    from echolearn.simulation.image_loops import HALF_WIDTH, fractional_delay

    fraction = np.arange(STEPS + 1)[:, None] / STEPS
    return fractional_delay(np.arange(1 - HALF_WIDTH, HALF_WIDTH + 1) - fraction)
