"""Beamforming: steering vectors, covariances, whole-recording SRP-MPDR.

A plane wave from (psi, phi) has the spectrum d(omega) X(omega) at the microphones, with the
steering vector d_m = exp(-j omega delay_m). From recordings with covariance R (Eq. 17), regularised
to R_bar = (1 - g) R + g tr(R)/M I (Eq. 18), the minimum power distortionless response beamformer
(Eq. 15) passes the power 1 / (d^H R_bar^-1 d); summed over bins and maximised over directions it
gives the DOA (Eq. 16). A white covariance reduces it to delay-and-sum.

It takes in the whole recording, so below 0 dB it finds the noise or the late reverberation rather
than the echo.

A Hermitian matrix is packed into M*M reals: the diagonal, then real and imaginary parts of the
upper triangle, so that quadratic forms of a whole block are one real matrix product per bin.
"""

import sys
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy import fft

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import direction, far_field_delays
from echolearn.acoustics.types import Array, MicArray, Observation
from echolearn.localization.columns import COVARIANCE_BANDS
from echolearn.localization.silence import alike

CACHED = 4
"""Recordings whose covariances are inverted together."""

BINS = 64
"""Bins whose powers are computed together, for the same reason."""

SMALL = 6
"""Microphones up to which covariances are compiled: sums of larger ones go in another order."""


def azimuth_grid(azimuths: int) -> Array:
    """Return `azimuths` directions evenly over the circle, from -pi, in rad."""
    return -np.pi + 2 * np.pi * np.arange(azimuths) / azimuths


def direction_grid(
    azimuths: int, elevations: int = 1, *, below: bool = False
) -> tuple[Array, Array]:
    """Return azimuths and elevations of a grid, each of shape (A,), in rad.

    A planar array cannot tell up from down, so elevations run over (0, pi/2]; one elevation is the
    array's plane.

    Args:
        azimuths, elevations: sizes of the grid.
        below: whether several elevations run over (0, pi), for arrays that tell up from down.
    """
    elevation = np.pi / 2 * np.arange(elevations, 0, -1) / elevations
    if below and elevations > 1:
        elevation = np.pi * (np.arange(elevations) + 0.5) / elevations
    azimuth, elevation = np.meshgrid(azimuth_grid(azimuths), elevation)
    return azimuth.ravel(), elevation.ravel()


def covariance(spectra: Array) -> Array:
    """Return R = 1/T sum_t Y Y^H (Eq. 17), shape (..., F, M, M), from spectra (..., M, F, T)."""
    bins = np.moveaxis(spectra, -3, -2)
    return bins @ np.moveaxis(bins, -1, -2).conj() / spectra.shape[-1]


def recording_covariance(observation: Observation) -> Array:
    """Return R of the whole recording per STFT bin (Eq. 17), shape (B, F, M, M), complex64."""
    samples = observation.samples
    bins = signals.STFT_FRAME // 2 + 1
    found = np.empty((len(samples), bins, *2 * samples.shape[1:2]), dtype=np.complex64)
    of_one = compiled_covariance if _is_compiled(samples.shape[1]) else plain_covariance
    # One recording after the other: the spectra of one stay in the processor's cache.
    for row, recording in enumerate(samples):
        found[row] = of_one(recording)
    return found


def _is_compiled(microphones: int) -> bool:
    """Tell whether loops are compiled here, for arrays so small that they have the same bits."""
    return "numba" in sys.modules and microphones <= SMALL


def plain_covariance(recording: Array) -> Array:
    """Return R of one recording (M, N), shape (F, M, M)."""
    return covariance(signals.stft(recording.astype(np.float32)))


def compiled_covariance(recording: Array) -> Array:
    """Return R of one recording (M, N), shape (F, M, M), with loops that Numba compiles."""
    from echolearn.localization import covariance_loops

    windowed = covariance_loops.frames(recording, signals.hann(signals.STFT_FRAME))
    return covariance_loops.frames_covariance(fft.rfft(windowed))


def regularize(covariances: Array, gamma: float) -> Array:
    """Return (1 - gamma) R + gamma tr(R)/M I (Eq. 18); an all-zero R becomes a tiny identity."""
    loading = _loading(covariances, gamma)
    identity = np.eye(covariances.shape[-1], dtype=loading.dtype)
    return (1.0 - gamma) * covariances + loading[..., None, None] * identity


def _loading(covariances: Array, gamma: float) -> Array:
    """Return what Eq. 18 adds to the diagonal of (..., M, M), shape (...)."""
    level = np.trace(covariances, axis1=-2, axis2=-1).real / covariances.shape[-1]
    # Silence must have an inverse too, and a finite one.
    return np.asarray(gamma * level + np.finfo(level.dtype).tiny ** 0.5)


def pack_hermitian(matrices: Array) -> Array:
    """Return Hermitian matrices (..., M, M) as reals (..., M*M), see the module's header."""
    upper = np.triu_indices(matrices.shape[-1], 1)
    above = matrices[..., upper[0], upper[1]]
    diagonal = np.diagonal(matrices, axis1=-2, axis2=-1).real
    return np.concatenate([diagonal, above.real, above.imag], axis=-1)


def pack_steering(vectors: Array) -> Array:
    """Return w (..., M*M) of steering vectors d (..., M): w . pack_hermitian(R) = d^H R d."""
    packed = pack_hermitian(vectors.conj()[..., :, None] * vectors[..., None, :])
    microphones = vectors.shape[-1]
    # Each element above the diagonal stands for its mirror image too.
    half = microphones * (microphones - 1) // 2
    return packed * np.repeat([1.0, 2.0, -2.0], [microphones, half, half])


def quadratic(matrices: Array, weights: Array) -> Array:
    """Return d^H R d per bin, (F, B, A), for R (B, F, M, M) and packed steering (F, M*M, A)."""
    return np.moveaxis(pack_hermitian(matrices), -2, 0) @ weights


def invert(hermitian: Array) -> Array:
    """Return the inverses of positive definite matrices (..., M, M), by Gauss-Jordan steps.

    Pivoting is not needed for positive definite matrices, and M is small: M steps on contiguous
    planes of the whole block are far faster than one LAPACK call per matrix.
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


@lru_cache(maxsize=4)
def steering_weights(
    array: MicArray,
    *,
    azimuths: int,
    elevations: int,
    sample_rate: float,
    speed_of_sound: float,
    below: bool = False,
) -> Array:
    """Return packed steering of a grid for the bins of an STFT, shape (F, M*M, A), float32, cached.

    Args:
        array: M microphones.
        azimuths, elevations: sizes of `direction_grid`.
        sample_rate: in Hz.
        speed_of_sound: in m/s.
        below: as for `direction_grid`.
    """
    frequencies = np.fft.rfftfreq(signals.STFT_FRAME, 1.0 / sample_rate)
    toward = direction(*direction_grid(azimuths, elevations, below=below))
    delays = far_field_delays(array, toward, speed_of_sound=speed_of_sound)
    vectors = np.exp(-2j * np.pi * frequencies[:, None, None] * delays)
    return np.ascontiguousarray(np.moveaxis(pack_steering(vectors), -1, -2), dtype=np.float32)


def mpdr_power(covariances: Array, weights: Array, *, gamma: float) -> Array:
    """Return the MPDR beam power summed over bins (Eq. 16), shape (B, A).

    Args:
        covariances: R of Eq. 17, shape (B, F, M, M).
        weights: packed steering, shape (F, M*M, A), from `steering_weights`.
        gamma: regularisation of Eq. 18.
    """
    compiled = _is_compiled(covariances.shape[-1]) and covariances.dtype == np.complex64
    of_all = compiled_inverses if compiled else plain_inverses
    return sum_of_inverses(np.moveaxis(of_all(covariances, gamma), 0, -1), weights)


def plain_inverses(covariances: Array, gamma: float) -> Array:
    """Return packed inverses of regularised covariances (B, F, M, M), planes (M*M, F, B)."""
    real = covariances.real.dtype
    planes = np.empty((covariances.shape[-1] ** 2, *covariances.shape[:2]), dtype=real)
    packed = np.moveaxis(planes, 0, -1)
    # A few at a time stay in the processor's cache.
    for start in range(0, len(covariances), CACHED):
        part = covariances[start : start + CACHED]
        packed[start : start + CACHED] = pack_hermitian(invert(regularize(part, gamma)))
    return np.swapaxes(planes, 1, 2)


def compiled_inverses(covariances: Array, gamma: float) -> Array:
    """Return the same with loops that Numba compiles, from complex64."""
    from echolearn.localization import covariance_loops

    loading = _loading(covariances, gamma)
    planes = covariance_loops.packed_inverses(covariances, keep=1.0 - gamma, loading=loading)
    return np.swapaxes(planes, 1, 2)


def sum_of_inverses(packed: Array, weights: Array) -> Array:
    """Return the sum of 1 / (packed @ weights) over bins, (B, A), from (F, B, K) and (F, K, A)."""
    bins = np.empty((BINS + 1, packed.shape[1], weights.shape[-1]), dtype=weights.dtype)
    # What was summed is the first addend of the next bins: the order is that of one sum over all.
    total = bins[0]
    for start in range(0, len(packed), BINS):
        part = bins[1 : 1 + len(packed) - start]
        np.matmul(packed[start : start + BINS], weights[start : start + BINS], out=part)
        np.divide(1.0, part, out=part)
        total[:] = part.sum(axis=0) if start == 0 else bins[: 1 + len(part)].sum(axis=0)
    return total.copy()


@dataclass(frozen=True)
class Mpdr:
    """Whole-recording SRP-MPDR over a grid of directions.

    Attributes:
        azimuths, elevations: sizes of `direction_grid`.
        gamma: regularisation of Eq. 18.
        below: as for `direction_grid`.
    """

    azimuths: int = 180
    elevations: int = 1
    gamma: float = 0.1
    below: bool = False

    @property
    def directions(self) -> tuple[Array, Array]:
        """Azimuths and elevations, each of shape (A,), in rad."""
        return direction_grid(self.azimuths, self.elevations, below=self.below)

    def __call__(self, observation: Observation, covariances: Array | None = None) -> Array:
        """Return the power over directions (Eq. 16), shape (B, A), float32.

        Args:
            observation: recordings (B, M, N).
            covariances: `recording_covariance` of them, if it is known already.
        """
        if covariances is None:
            covariances = recording_covariance(observation)
        weights = steering_weights(
            observation.array,
            azimuths=self.azimuths,
            elevations=self.elevations,
            sample_rate=observation.probe.sample_rate,
            speed_of_sound=observation.speed_of_sound,
            below=self.below,
        )
        return mpdr_power(covariances, weights, gamma=self.gamma)

    def without(self, observation: Observation, silent: Array) -> Array:
        """Return the power with the silent microphones (B, M) of each recording left out."""
        if not silent.any():
            return self(observation)
        power = np.empty((len(silent), self.azimuths * self.elevations), dtype=np.float32)
        for rows, pattern in alike(silent):
            samples = observation.samples[rows][:, ~pattern]
            array = MicArray(observation.array.positions[~pattern])
            power[rows] = self(replace(observation, samples=samples, array=array))
        return power


def band_average(covariances: Array) -> Array:
    """Return covariances (B, F, M, M) averaged over equal bands: packed, trace M, without bin 0."""
    # Bin 0 holds no echo, only offsets of the microphones.
    bins = (covariances.shape[1] - 1) // COVARIANCE_BANDS
    used = covariances[:, 1 : 1 + bins * COVARIANCE_BANDS]
    banded = used.reshape(len(used), COVARIANCE_BANDS, bins, *used.shape[2:])
    packed = pack_hermitian(banded.mean(axis=2))
    microphones = covariances.shape[-1]
    trace = packed[..., :microphones].sum(axis=-1, keepdims=True)
    return (packed * microphones / np.maximum(trace, 1e-30)).astype(np.float32)
