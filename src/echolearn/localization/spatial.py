"""The noise-weighted matched filter: microphones weighed by the noise's inverse covariance.

    y = g s d(tau, phi) + v,    E v v^H = Phi,    d_m = exp(-j omega (tau + eta_m(phi)))
    J(tau, phi) = Re sum_omega conj(s) d^H Phi^-1 y,    E(phi) = sum_omega |s|^2 d^H Phi^-1 d
    (tau, phi) = argmax J / sqrt(E),    g = J / E

the maximum likelihood estimate of one plane wave in Gaussian noise that the microphones share, as
they share that of rotors below a few hundred hertz (Kay, "Fundamentals of Statistical Signal
Processing" II, 1998, ch. 13). Plain pre-whitening knows the noise of each microphone only; this one
also subtracts what the other microphones tell of it. With Phi = I it is `joint`.

Phi = P Gamma. The densities P are divided out of y and s beforehand (`whitening.whitened`), so what
is inverted is Gamma, the coherence. Noise reaches two microphones d apart at most d / c after one
another, so Gamma has no longer lags: an estimate from some seconds of noise is cut to `REACH` of
the largest d / c and tapered, which averages the estimation errors of neighbouring bins. `LOADING`
on its diagonal bounds what is gained where Gamma is nearly singular.

What there is to gain depends on the field. Where noise comes from all sides alike, Gamma is the
mean of d d^H over directions, and the mean of d^H Gamma^-1 d is M, as in independent noise: the
weights win back what sharing has cost plain pre-whitening, up to a factor of M at low frequencies
and next to nothing where microphones are many wavelengths apart. Noise of fewer sources than
microphones leaves directions in which there is none.

Everything is one product per bin of spectra over `size` points, more than all responses are long.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy import fft

from echolearn.acoustics.geometry import direction, relative_delays
from echolearn.acoustics.types import Array, MicArray, Observation
from echolearn.localization.correlations import bins

REACH = 2.0
"""Lags of the coherence that are kept, in travel times across the array; at least `LEAST`."""

LEAST = 32
"""Fewest lags of the coherence that are kept."""

LOADING = 0.03
"""Addition to the diagonal of the coherence, relative to its mean: no frequency gains more than 15
dB. Where noise is removed better than that, reverberation is what is left, of which the covariance
knows nothing."""


@dataclass(frozen=True)
class Spatial:
    """The noise between M microphones, for echoes of one probe.

    Attributes:
        array: microphones.
        scale: samples per metre of path.
        root: Gamma^-1/2, Hermitian, 0 for microphones left out, shape (size // 2 + 1, M, M).
        probe: spectrum of the whitened burst, shape (size // 2 + 1,).
        size: number of points of the transforms.
    """

    array: MicArray
    scale: float
    root: Array
    probe: Array
    size: int

    @cached_property
    def inverse(self) -> Array:
        """Gamma^-1, shape (size // 2 + 1, M, M)."""
        return self.root @ self.root

    def whiten(self, samples: Array) -> Array:
        """Return Gamma^-1/2 y of recordings (B, M, N): noise independent between microphones."""
        return self._apply(self.root, samples)[..., : samples.shape[-1]]

    def correlate(self, samples: Array, *, first: int, last: int) -> Array:
        """Return conj(s) Gamma^-1 y at lags from `first` to `last`, shape (B, M, lags).

        Args:
            samples: recordings y, shape (B, M, N).
            first, last: lags wanted, both inclusive, also negative ones.
        """
        matrices = self.probe.conj()[:, None, None] * self.inverse
        return self._apply(matrices, samples)[..., np.arange(first, last + 1)]

    def _apply(self, matrices: Array, samples: Array) -> Array:
        spectra = np.moveaxis(fft.rfft(samples, self.size), -1, 0)  # (F, B, M)
        return fft.irfft(np.moveaxis(spectra @ matrices.mT, 0, -1), self.size)

    def strength(self, azimuth: Array, elevation: Array) -> Array:
        """Return E(phi) of directions (A,): the energy of a whitened echo of gain 1, shape (A,)."""
        toward = direction(azimuth, elevation)
        eta = relative_delays(self.array, toward, scale=self.scale)
        omega, count = bins(self.size)
        turned = np.exp(-1j * omega[:, None, None] * eta.T)  # (F, M, A)
        energy = np.square(np.abs(self.root @ turned)).sum(axis=1)
        return np.asarray((np.square(np.abs(self.probe)) * count) @ energy)

    def grid_strength(self, azimuth: Array, elevation: Array) -> Array:
        """Return E(phi) of a grid of directions (A,), which is computed once, shape (A,)."""
        key = azimuth.tobytes() + elevation.tobytes()
        if key not in self._grids:
            self._grids[key] = self.strength(azimuth, elevation)
        return self._grids[key]

    @cached_property
    def _grids(self) -> dict[bytes, Array]:
        return {}

    def model(self, delays: Array, *, size: int) -> Array:
        """Return the correlations of echoes of gain 1, shape (B, M, size).

        Args:
            delays: of each microphone, in samples after the first correlation, shape (B, M).
            size: number of correlations.
        """
        omega, _ = bins(self.size)
        wave = np.exp(-1j * omega[:, None, None] * delays)  # (F, B, M)
        matrices = np.square(np.abs(self.probe))[:, None, None] * self.inverse
        return fft.irfft(np.moveaxis(wave @ matrices.mT, 0, -1), self.size)[..., :size]


def spatial(white: Observation, coherence: Array, *, silent: Array) -> Spatial:
    """Return the spatial weighting for recordings that have passed the whitening filter.

    Args:
        white: recordings (B, M, N) and probe after `whitening.whitened`.
        coherence: of the noise, shape (F, M, M), from `whitening.noise_coherence`.
        silent: which microphones to leave out, shape (M,), bool.
    """
    # Without noise a microphone has no coherence, and with silence no echo.
    used = ~silent & (np.diagonal(coherence, axis1=-2, axis2=-1).real.mean(axis=0) > 0)
    burst = white.probe.samples
    length = white.samples.shape[-1] + len(burst)
    return _spatial(
        white.array,
        coherence[:, used][:, :, used].tobytes(),
        used=used.tobytes(),
        burst=burst.tobytes(),
        scale=white.probe.sample_rate / white.speed_of_sound,
        size=fft.next_fast_len(length + length // 2, real=True),
    )


@lru_cache(maxsize=4)
def _spatial(
    array: MicArray, coherence: bytes, *, used: bytes, burst: bytes, scale: float, size: int
) -> Spatial:
    mask = np.frombuffer(used, dtype=bool)
    count = int(mask.sum())
    gamma = np.frombuffer(coherence, dtype=complex).reshape(-1, count, count)

    places = array.positions[mask]
    distances = np.linalg.norm(places[:, None] - places, axis=-1)
    lags = max(LEAST, round(REACH * float(distances.max(initial=0.0)) * scale))
    root = np.zeros((size // 2 + 1, len(mask), len(mask)), dtype=complex)
    root[np.ix_(np.arange(len(root)), mask, mask)] = inverse_root(
        shorten(gamma, lags=lags, size=size)
    )
    return Spatial(array, scale, root, fft.rfft(np.frombuffer(burst), size), size)


def shorten(coherence: Array, *, lags: int, size: int) -> Array:
    """Return coherences cut to some lags by a Hann taper, of mean level 1, (size // 2 + 1, M, M).

    Args:
        coherence: shape (F, M, M).
        lags: kept on either side.
        size: number of points of the result's transform.
    """
    # An inverse spectrum of F bins has 2 (F - 1) lags, half of them negative.
    full = 2 * (len(coherence) - 1)
    lags = min(lags, full // 2 - 1)
    kept = fft.irfft(coherence, full, axis=0)[np.arange(-lags, lags + 1)]
    kept *= np.hanning(2 * lags + 3)[1:-1, None, None]
    placed = np.zeros((size, *kept.shape[1:]))
    placed[np.arange(-lags, lags + 1)] = kept
    level = np.trace(placed[0]) / len(placed[0])
    return fft.rfft(placed, axis=0) / level


def inverse_root(coherence: Array) -> Array:
    """Return ((Gamma + `LOADING` I) / (1 + `LOADING`))^-1/2, Hermitian, of coherences (F, M, M)."""
    # Rounding leaves an estimate not quite Hermitian, and eigenvalues a little below 0.
    values, vectors = np.linalg.eigh((coherence + coherence.conj().mT) / 2)
    loaded = (np.maximum(values, 0.0) + LOADING) / (1.0 + LOADING)
    return (vectors / np.sqrt(loaded)[:, None]) @ vectors.conj().mT
