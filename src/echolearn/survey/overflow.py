"""Samples that overflowed: beyond full scale they came out at the other end of the range.

    y(n) = x(n) - 2 round(x(n) / 2),   x = h * s about the largest arrival

h, a short response, is fitted to the recording by least squares. Where the fit goes beyond full
scale and the sample is two full scales away from it, the sample has wrapped around.
"""

import numpy as np
from scipy import fft
from scipy.linalg import solve_toeplitz

from echolearn.acoustics.types import Array
from echolearn.survey.arrivals import Arrivals

FULL = 0.9
"""Share of full scale below which nothing has wrapped, which would lie on both sides of it."""

BEFORE = 8
TAPS = 64
"""Lags before the largest arrival, and in all, at which h is fitted."""

ROUNDS = 4
"""Fits, each with the samples unwrapped that the one before found."""

NOISY = 0.1
"""Standard deviation of the rest, in full scales, from which on nothing is told."""

NEAR = 4.0
"""Standard deviations of the rest within which a wrapped sample is what was fitted."""


def wrapped(samples: Array, found: Arrivals) -> Array:
    """Return how many samples of each channel have wrapped around, shape (M,).

    Args:
        samples: a recording in units of full scale, shape (M, N).
        found: its matched filter.
    """
    reaches = (samples.max(axis=-1) > FULL) & (samples.min(axis=-1) < -FULL)
    # Numbers beyond full scale are floating-point, which does not wrap.
    reaches &= np.abs(samples).max() <= 1.0
    count = np.zeros(len(samples), dtype=int)
    for m in np.flatnonzero(reaches):
        place = int(np.abs(found.outputs[m]).argmax()) - found.zero
        count[m] = _wrapped_at(samples[m], found.probe.samples, start=place - BEFORE)
    return count


def _wrapped_at(channel: Array, burst: Array, *, start: int) -> int:
    """Return how many samples of a channel (N,) have wrapped where a burst arrives at `start`."""
    length = len(burst) + TAPS - 1
    where = np.arange(start, start + length)
    inside = (where >= 0) & (where < len(channel))
    heard = np.where(inside, channel[np.clip(where, 0, len(channel) - 1)], 0.0)
    size = fft.next_fast_len(2 * length, real=True)
    spectrum = fft.rfft(burst, size)
    alike = fft.irfft(np.abs(spectrum) ** 2, size)[:TAPS]
    # A burst of few frequencies leaves the fit free at the others.
    alike[0] *= 1 + 1e-3
    whole = heard
    for _ in range(ROUNDS):
        against = fft.irfft(fft.rfft(whole, size) * spectrum.conj(), size)[:TAPS]
        response = solve_toeplitz(alike, against)
        fitted = fft.irfft(fft.rfft(response, size) * spectrum, size)[:length]
        whole = heard + 2 * np.rint((fitted - heard) / 2) * inside
    rest = whole - fitted
    spread = max(float(np.median(np.abs(rest[inside]))) / 0.6745, 1e-3)
    beyond = (whole != heard) & (np.abs(fitted) > 1 - spread) & (np.abs(rest) < NEAR * spread)
    # Where noise is large, what lies two full scales away fits by chance.
    return int(beyond.sum()) if spread < NOISY else 0
