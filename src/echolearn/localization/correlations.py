"""Correlations with the probe between their samples: advanced, steered, differentiated, modelled.

All functions here take correlations r_m(t) over a search window and `PAD` lags on either side of
it, shape (B, M, L + 2 PAD), and read them at fractional lags. They are band-limited, so each is its
short Fourier series, and what lies between samples is exact but for the ends of the padding (1 % of
the peak).

- Steering keeps only what arrives at one time from one direction:
  J(tau, phi) = sum_m r_m(tau + eta_m(phi)), eta_m of Eq. 3.
- An echo of gain g is g a(t - tau - eta_m(phi)) in r_m, with a the probe's autocorrelation. It is
  read from a table of a at fractions of a sample, exact to 3e-4 of its peak.
"""

from functools import lru_cache

import numpy as np
from scipy import fft

from echolearn.acoustics.geometry import direction, relative_delays
from echolearn.acoustics.types import Array, MicArray

PAD = 64
"""Lags on either side of the search window, so that steered lags can be interpolated."""

PHASES = 64
"""Tabled fractions of a sample; linear interpolation between them is exact to 3e-4 of the peak."""


def advance(correlation: Array, lags: Array) -> Array:
    """Return correlations read at tau + lags: r_m(tau + lags_m), shape (..., A, M, L).

    The interpolation is band-limited over the L lags; they should reach `PAD` beyond those of
    interest.

    Args:
        correlation: r_m, shape (..., M, L).
        lags: fractional advance, shape (..., A, M), in samples.
    """
    size = correlation.shape[-1]
    omega = 2 * np.pi * np.fft.rfftfreq(size)
    phase = np.exp(1j * lags[..., None] * omega)
    return fft.irfft(fft.rfft(correlation)[..., None, :, :] * phase, size)


def steered_response(
    correlation: Array,
    array: MicArray,
    *,
    directions: tuple[Array, Array],
    scale: float,
    finer: int = 1,
) -> Array:
    """Return J(tau, phi) = sum_m r_m(tau + eta_m(phi)), shape (B, A, finer * L), float32.

    Args:
        correlation: r_m, shape (B, M, L).
        array: M microphones.
        directions: azimuths and elevations, each of shape (A,), in rad.
        scale: sample_rate / speed_of_sound, in samples per m.
        finer: points per lag.
    """
    azimuth, elevation = directions
    size = correlation.shape[-1]
    phases = steering_phases(
        array, azimuth.tobytes(), elevation=elevation.tobytes(), size=size, scale=scale
    )

    # One matrix product per bin sums the microphones for all directions; single precision halves
    # its time and costs 1e-5 of the peak.
    spectrum = np.moveaxis(fft.rfft(correlation.astype(np.float32)), -1, 0)
    return interpolate(np.moveaxis(spectrum @ phases, 0, -1), size=size, finer=finer)


@lru_cache(maxsize=8)
def steering_phases(
    array: MicArray, azimuth: bytes, *, elevation: bytes, size: int, scale: float
) -> Array:
    """Return the phases exp(j omega eta_m) that align microphones, shape (F, M, A), complex64.

    Args:
        array: M microphones.
        azimuth, elevation: bytes of A angles each, in rad.
        size: number of lags.
        scale: samples per m.
    """
    toward = direction(np.frombuffer(azimuth), np.frombuffer(elevation))
    eta = relative_delays(array, toward, scale=scale)
    omega = 2 * np.pi * np.fft.rfftfreq(size)
    return np.exp(1j * omega[:, None, None] * eta.T).astype(np.complex64)


def interpolate(spectrum: Array, *, size: int, finer: int) -> Array:
    """Return correlations at `finer` points per lag, shape (..., finer * size).

    Args:
        spectrum: of the correlations, shape (..., size // 2 + 1).
        size: number of lags.
        finer: points per lag.
    """
    if finer == 1:
        return fft.irfft(spectrum, size)
    if size % 2 == 0:
        # In the longer series the Nyquist bin stands for a positive and a negative frequency.
        spectrum = np.concatenate([spectrum[..., :-1], spectrum[..., -1:] / 2], axis=-1)
    return fft.irfft(spectrum, finer * size) * finer


def bins(size: int) -> tuple[Array, Array]:
    """Return what the sum over a real spectrum takes: frequencies in rad per sample, and weights.

    Every bin but the first and the Nyquist bin stands for a negative frequency too.
    """
    omega = 2 * np.pi * np.fft.rfftfreq(size)
    return omega, np.where((omega == 0) | (omega >= np.pi), 1.0, 2.0) / size


def derivatives(spectrum: Array, delays: Array, *, size: int) -> Array:
    """Return correlations and their first two derivatives at fractional lags, shape (3, B, M).

    Args:
        spectrum: of the correlations, shape (B, M, size // 2 + 1).
        delays: where to read, in samples after the window's first lag, shape (B, M).
        size: number of lags, padding included.
    """
    omega, count = bins(size)
    turned = spectrum * np.exp(1j * (delays[..., None] + PAD) * omega)
    return np.stack(
        [turned.real @ count, -turned.imag @ (omega * count), -turned.real @ (omega**2 * count)]
    )


def echo_model(burst: Array, delays: Array, *, size: int) -> Array:
    """Return the correlations of echoes of gain 1: a(t - delay), shape (B, M, size).

    Args:
        burst: samples of the probe, shape (L,), float64.
        delays: of the echo at each microphone, after the window's first lag, in samples, (B, M).
        size: number of lags, padding included.
    """
    table = _autocorrelation(burst.tobytes(), size)
    reach = table.shape[-1] // 2
    whole = np.floor(delays)
    row, part = np.divmod((delays - whole) * PHASES, 1.0)
    lags = np.arange(size) - PAD - whole.astype(int)[..., None] + reach
    lags = np.clip(lags, 0, 2 * reach)

    lower = table[row.astype(int)[..., None], lags]
    upper = table[row.astype(int)[..., None] + 1, lags]
    return lower + part[..., None] * (upper - lower)


@lru_cache(maxsize=4)
def _autocorrelation(burst: bytes, size: int) -> Array:
    """Return a(k - p / PHASES) for p = 0 ... PHASES and |k| <= reach, (PHASES + 1, 2 reach + 1)."""
    samples = np.frombuffer(burst)
    reach = size + 8 * PAD
    length = fft.next_fast_len(2 * (len(samples) + reach), real=True)
    power = np.abs(fft.rfft(samples, length)) ** 2
    late = np.arange(PHASES + 1)[:, None] / PHASES * 2 * np.pi * np.fft.rfftfreq(length)
    table = fft.irfft(power * np.exp(-1j * late), length)
    return np.concatenate([table[:, -reach:], table[:, : reach + 1]], axis=-1)


def ratio_or_zero(numerator: Array, denominator: Array) -> Array:
    """Return numerator / denominator, 0 where the denominator vanishes (a silent recording)."""
    safe = np.where(denominator == 0, 1.0, denominator)
    return np.where(denominator == 0, 0.0, numerator / safe)
