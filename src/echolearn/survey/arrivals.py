"""What arrives at each microphone over a whole recording: the matched filter at all its lags.

    r_m(tau) = sum_n y_m(n + tau) s(n),   -L < tau < N

A negative lag is a burst whose beginning was lost. The first arrival is the earliest lag whose
|r_m| is no side lobe of a later one and stands out of the noise; between the samples it is read by
a windowed sinc.
"""

from dataclasses import dataclass
from functools import cache, cached_property, lru_cache

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array, Probe

SEEN = 7.0
"""Standard deviations of the noise from which an arrival at one microphone is seen: among 20 000
lags noise reaches 5."""

FIRST = 0.3
"""Height over the largest from which an earlier arrival counts; the direct path is the nearest, and
seldom 10 dB below an echo."""

TAPS = 16
FINER = 32
"""Samples on either side from which a crest is read, and points per sample on which."""


@dataclass(frozen=True)
class Arrivals:
    """The matched filter of one recording, samples (M, N).

    Attributes:
        spectrum: of r, shape (M, F).
        size: of the transform.
        length: N.
        probe: what was emitted.
    """

    spectrum: Array
    size: int
    length: int
    probe: Probe

    @property
    def zero(self) -> int:
        """Place of lag 0 in `outputs`."""
        return len(self.probe.samples)

    @cached_property
    def outputs(self) -> Array:
        """r_m over the burst's norm, from lag -L to N - 1, shape (M, L + N)."""
        whole = fft.irfft(self.spectrum, self.size)
        return np.roll(whole, self.zero, axis=-1)[:, : self.zero + self.length]

    @cached_property
    def noise(self) -> Array:
        """Standard deviation of r_m where nothing arrives, at most, shape (M,)."""
        # Every fourth lag tells the median as well as all do, in less time.
        step = 4 if self.length > 4096 else 1
        middle = np.median(np.abs(self.outputs[:, self.zero :: step]), axis=-1)
        return np.maximum(middle / 0.6745, 1e-300)

    def first(self, outputs: Array, noise: float) -> int:
        """Return the place of the first arrival in one of the `outputs`, shape (L + N,)."""
        height = np.abs(outputs)
        enough = max(_side_lobe(self.probe.samples.tobytes()) * float(height.max()), SEEN * noise)
        places = np.flatnonzero(height >= min(enough, float(height.max())))
        start = int(places[0])
        # The crest, not its foot.
        return start + int(height[start : start + 8].argmax())

    def without(self, heights: Array, lags: Array) -> "Arrivals":
        """Return what is left when an arrival is subtracted from each microphone.

        Args:
            heights: of the arrivals, shape (M,); 0 leaves a microphone alone.
            lags: of the arrivals in samples, shape (M,).
        """
        burst = _burst(self.probe.samples.tobytes(), self.size)
        late = heights[:, None] * _delays(lags, self.size)
        left = self.spectrum - late * (np.abs(burst) ** 2 / self.probe.energy)
        return Arrivals(left, self.size, self.length, self.probe)


@lru_cache(maxsize=4)
def _side_lobe(burst: bytes) -> float:
    """Return the height of an arrival, over the largest, from which it is no side lobe."""
    samples = np.frombuffer(burst)
    alike = np.abs(fft.irfft(np.abs(fft.rfft(samples, 2 * len(samples))) ** 2))[: len(samples)]
    beside = float(alike[8:].max(initial=0.0) / alike[0])
    return min(max(FIRST, 1.5 * beside), 1.0)


def arrivals(samples: Array, probe: Probe) -> Arrivals:
    """Return the matched filter of a recording, samples (M, N)."""
    length = samples.shape[-1]
    size = fft.next_fast_len(length + 2 * len(probe.samples), real=True)
    burst = _burst(probe.samples.tobytes(), size).conj() / np.sqrt(probe.energy)
    return Arrivals(fft.rfft(samples, size) * burst, size, length, probe)


@lru_cache(maxsize=4)
def _burst(burst: bytes, size: int) -> Array:
    """Return the spectrum of a burst: the same for every recording of a survey."""
    found: Array = fft.rfft(np.frombuffer(burst), size)
    return found


def _delays(lags: Array, size: int) -> Array:
    """Return exp(-j w lag) at the frequencies of a real transform, shape (M, size // 2 + 1)."""
    count = size // 2 + 1
    coarse = int(np.sqrt(count)) + 1
    step = -2j * np.pi * lags[:, None] / size
    fine = np.exp(step * np.arange(coarse))
    # A product of two short rows is a long one, without an exponential for each frequency.
    rows = np.exp(step * coarse * np.arange(coarse))[:, :, None] * fine[:, None, :]
    return rows.reshape(len(lags), -1)[:, :count]


def crests(outputs: Array, places: Array) -> tuple[Array, Array]:
    """Return where |r| (M, K) is largest within a sample of places (M,), and r there, each (M,)."""
    rows = np.arange(len(outputs))
    near = places[:, None] + np.arange(-TAPS, TAPS + 1)
    around = outputs[rows[:, None], np.clip(near, 0, outputs.shape[-1] - 1)]
    heights = around @ _table().T
    best = np.clip(np.abs(heights).argmax(axis=-1), 1, heights.shape[-1] - 2)
    before, here, after = (np.abs(heights[rows, best + step]) for step in (-1, 0, 1))
    bend = before - 2 * here + after
    off = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, 1.0), 0.0)
    return places + (best + off) / FINER - 1.0, heights[rows, best]


def largest(outputs: Array) -> tuple[Array, Array]:
    """Return where |r| (M, K) is largest, and r there, each (M,)."""
    return crests(outputs, np.abs(outputs).argmax(axis=-1))


@cache
def _table() -> Array:
    """Return windowed sincs that read within a sample, shape (2 FINER + 1, 2 TAPS + 1)."""
    where = np.arange(-FINER, FINER + 1) / FINER
    distance = where[:, None] - np.arange(-TAPS, TAPS + 1)
    return np.sinc(distance) * np.cos(np.pi * np.clip(distance / (TAPS + 2), -1, 1) / 2) ** 2
