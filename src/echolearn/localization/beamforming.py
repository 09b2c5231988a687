"""Beamforming: steering vectors, covariances, steered response power, steered matched filter.

A plane wave from (psi, phi) has the spectrum d(omega) X(omega) at the microphones, with the
steering vector d_m = exp(-j omega delay_m). From recordings with covariance R (Eq. 17), regularised
to R_bar = (1 - g) R + g tr(R)/M I (Eq. 18), the minimum power distortionless response beamformer
(Eq. 15) passes the power 1 / (d^H R_bar^-1 d); summed over bins and maximised over directions it
gives the DOA (Eq. 16). A white covariance reduces it to delay-and-sum.

Steering the *matched filters* instead of the recordings keeps only what arrives at one time:
J(tau, phi) = sum_m r_m(tau + eta_m(phi)).

A Hermitian matrix is packed into M*M reals: the diagonal, then real and imaginary parts of the
    upper
triangle, so that quadratic forms of a whole block are one real matrix product per bin.
"""

from functools import lru_cache

import numpy as np
from scipy import fft

from echolearn.acoustics.geometry import far_field_delays, relative_delays
from echolearn.acoustics.types import Array, MicArray

PAD = 64
"""Lags computed beyond the search window on either side, so that steered lags can be interpolated.
"""


def azimuth_grid(azimuths: int) -> Array:
    """Return `azimuths` directions evenly over the circle, from -pi, in rad."""
    return -np.pi + 2 * np.pi * np.arange(azimuths) / azimuths


def direction_grid(azimuths: int, elevations: int = 1) -> tuple[Array, Array]:
    """Return azimuths and elevations of a grid, each of shape (A,), in rad.

    A planar array cannot tell up from down, so elevations run over (0, pi/2]; one elevation is the
    array's plane.
    """
    elevation = np.pi / 2 * np.arange(elevations, 0, -1) / elevations
    azimuth, elevation = np.meshgrid(azimuth_grid(azimuths), elevation)
    return azimuth.ravel(), elevation.ravel()


def steering(
    array: MicArray, azimuth: Array, elevation: Array, *, frequencies: Array, speed_of_sound: float
) -> Array:
    """Return steering vectors exp(-j omega delay), shape (F, A, M): directions (A,), `frequencies`
    (F,) in Hz.
    """
    delays = far_field_delays(array, azimuth, elevation, speed_of_sound)
    return np.exp(-2j * np.pi * frequencies[:, None, None] * delays)


def covariance(spectra: Array) -> Array:
    """Return R = 1/T sum_t Y Y^H (Eq. 17), shape (..., F, M, M), from spectra (..., M, F, T)."""
    bins = np.moveaxis(spectra, -3, -2)
    return bins @ np.moveaxis(bins, -1, -2).conj() / spectra.shape[-1]


def regularize(covariances: Array, gamma: float) -> Array:
    """Return (1 - gamma) R + gamma tr(R)/M I (Eq. 18); an all-zero R becomes a tiny identity."""
    microphones = covariances.shape[-1]
    level = np.trace(covariances, axis1=-2, axis2=-1).real[..., None, None] / microphones
    tiny = np.finfo(level.dtype).tiny ** 0.5
    return (1.0 - gamma) * covariances + (gamma * level + tiny) * np.eye(
        microphones, dtype=level.dtype
    )


def pack(hermitian: Array) -> Array:
    """Return Hermitian matrices (..., M, M) as reals (..., M*M): diagonal, upper real parts, upper
    imaginary parts.
    """
    upper = np.triu_indices(hermitian.shape[-1], 1)
    above = hermitian[..., upper[0], upper[1]]
    return np.concatenate(
        [np.diagonal(hermitian, axis1=-2, axis2=-1).real, above.real, above.imag], axis=-1
    )


def pack_steering(vectors: Array) -> Array:
    """Return weights (..., M*M) with which `pack(R)` gives d^H R d, for steering vectors d (...,
    M).
    """
    outer = vectors.conj()[..., :, None] * vectors[..., None, :]
    packed = pack(outer)
    microphones = vectors.shape[-1]
    half = microphones * (microphones - 1) // 2
    factor = np.concatenate([np.ones(microphones), np.full(half, 2.0), np.full(half, -2.0)])
    return packed * factor


def quadratic(hermitian: Array, weights: Array) -> Array:
    """Return d^H R d per bin, shape (F, B, A), for matrices R (B, F, M, M) and packed steering (F,
    M*M, A).
    """
    return np.moveaxis(pack(hermitian), -2, 0) @ weights


def invert(hermitian: Array) -> Array:
    """Return the inverses of positive definite matrices (..., M, M) by Gauss-Jordan steps over the
    whole block.

    Pivoting is not needed for positive definite matrices, and M is small: M steps on contiguous
        planes are
    far faster than one LAPACK call per matrix.
    """
    size = hermitian.shape[-1]
    work = np.moveaxis(hermitian, (-2, -1), (0, 1)).copy(order="C")
    for k in range(size):
        pivot = 1.0 / work[k, k].real
        work[k, k] = 1.0
        row = work[k] * pivot
        column = work[:, k].copy()
        column[k] = 0.0
        work[:, k] = 0.0
        work[k] = row
        work -= column[:, None] * row[None]
    return np.moveaxis(work, (0, 1), (-2, -1))


def mpdr_power(covariances: Array, weights: Array, *, gamma: float) -> Array:
    """Return the MPDR beam power summed over bins (Eq. 16), shape (B, A).

    Args:
        covariances: R of Eq. 17, shape (B, F, M, M).
        weights: packed steering, shape (F, M*M, A), from `steering_weights`.
        gamma: regularisation of Eq. 18.
    """
    return np.sum(1.0 / quadratic(invert(regularize(covariances, gamma)), weights), axis=0)


def delay_and_sum_power(covariances: Array, weights: Array) -> Array:
    """Return the delay-and-sum beam power d^H R d / M^2 summed over bins, shape (B, A)."""
    return np.sum(quadratic(covariances, weights), axis=0) / covariances.shape[-1] ** 2


def summits(power: Array, count: int) -> Array:
    """Return the indices of the `count` highest local maxima of power over a circle, from (B, A) to
    (B, count).

    Where there are fewer, the highest is repeated.
    """
    local = (power > np.roll(power, 1, axis=-1)) & (power >= np.roll(power, -1, axis=-1))
    height = np.where(local, power, -np.inf)
    order = np.argsort(-height, axis=-1, kind="stable")[:, :count]
    best = power.argmax(axis=-1)[:, None]
    return np.where(np.isfinite(np.take_along_axis(height, order, axis=-1)), order, best)


def steering_weights(
    array: MicArray,
    azimuths: int,
    elevations: int,
    *,
    frame: int,
    sample_rate: float,
    speed_of_sound: float,
) -> Array:
    """Return packed steering for `direction_grid` and the bins of an STFT, shape (F, M*M, A),
    float32, cached.
    """
    return _steering_weights(
        array.positions.tobytes(), azimuths, elevations, frame, sample_rate, speed_of_sound
    )


@lru_cache(maxsize=4)
def _steering_weights(
    positions: bytes,
    azimuths: int,
    elevations: int,
    frame: int,
    sample_rate: float,
    speed_of_sound: float,
) -> Array:
    array = MicArray(np.frombuffer(positions).reshape(-1, 3))
    frequencies = np.fft.rfftfreq(frame, 1.0 / sample_rate)
    directions = direction_grid(azimuths, elevations)
    vectors = steering(array, *directions, frequencies=frequencies, speed_of_sound=speed_of_sound)
    return np.ascontiguousarray(np.moveaxis(pack_steering(vectors), -1, -2), dtype=np.float32)


def advance(correlation: Array, lags: Array) -> Array:
    """Return matched-filter outputs (..., M, L) read at tau + lags: r_m(tau + lags_m), shape (...,
    A, M, L).

    Args:
        correlation: r_m, shape (..., M, L).
        lags: fractional advance, shape (..., A, M), in samples.

    The interpolation is band-limited over the L lags; they should reach `PAD` beyond those of
    interest.
    """
    size = correlation.shape[-1]
    omega = 2 * np.pi * np.fft.rfftfreq(size)
    phase = np.exp(1j * lags[..., None] * omega)
    return fft.irfft(fft.rfft(correlation)[..., None, :, :] * phase, size)


def steered_response(
    correlation: Array,
    array: MicArray,
    azimuth: Array,
    elevation: Array,
    *,
    scale: float,
    finer: int = 1,
) -> Array:
    """Return J(tau, phi) = sum_m r_m(tau + eta_m(phi)), shape (B, A, finer * L).

    Args:
        correlation: matched-filter outputs, shape (B, M, L).
        array: M microphones.
        azimuth, elevation: directions, shape (A,), in rad.
        scale: sample_rate / speed_of_sound, in samples per m.
        finer: points per lag.
    """
    size = correlation.shape[-1]
    phase = _advancing(
        array.positions.tobytes(), azimuth.tobytes(), elevation.tobytes(), size, scale
    )
    spectrum = np.moveaxis(fft.rfft(correlation.astype(np.float32)), -1, 0)
    steered = np.moveaxis(spectrum @ phase, 0, -1)
    return fft.irfft(steered, size) if finer == 1 else interpolate(steered, size, finer)


def interpolate(spectrum: Array, size: int, finer: int) -> Array:
    """Return `finer` points per lag of correlations given by their spectra over `size` lags, (...,
    finer * size).
    """
    if size % 2 == 0:
        spectrum = np.concatenate(
            [spectrum[..., :-1], spectrum[..., -1:] / 2], axis=-1
        )  # Nyquist splits into two
    return fft.irfft(spectrum, finer * size) * finer


@lru_cache(maxsize=8)
def _advancing(
    positions: bytes, azimuth: bytes, elevation: bytes, size: int, scale: float
) -> Array:
    """Return the phases exp(j omega eta_m) that align microphones, shape (F, M, A), complex64."""
    array = MicArray(np.frombuffer(positions).reshape(-1, 3))
    eta = relative_delays(array, np.frombuffer(azimuth), np.frombuffer(elevation), 1.0) * scale
    omega = 2 * np.pi * np.fft.rfftfreq(size)
    return np.exp(1j * omega[:, None, None] * eta.T).astype(np.complex64)
