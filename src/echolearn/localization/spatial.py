"""The noise-weighted matched filter: microphones weighed together, bin by bin, by the noise's
inverse covariance.

    y = g s d(tau, phi) + v,    E v v^H = Phi,    d_m = exp(-j omega (tau + eta_m(phi)))
    J(tau, phi) = Re sum_omega conj(s) d^H Phi^-1 y,    E(phi) = sum_omega |s|^2 d^H Phi^-1 d
    (tau, phi) = argmax J / sqrt(E),    g = J / E

the maximum likelihood estimate of one plane wave in Gaussian noise that the microphones share, as
they share that of rotors below a few hundred hertz (Kay, "Fundamentals of Statistical Signal
Processing" II, 1998, ch. 13). Plain pre-whitening knows the noise of each microphone only; this one
also subtracts what the others hear of it. With Phi = I it is `joint`.

Phi = P Gamma. The densities P are divided out of y and s beforehand (`whitening.whitened`), so what
is inverted is Gamma, the coherence. Noise reaches two microphones d apart at most d / c after one
another, so Gamma has no longer
lags: an estimate from some seconds of noise is cut to `REACH` of the largest d / c and tapered,
    which averages the
estimation errors of neighbouring bins. `LOADING` on its diagonal bounds what is gained where Gamma
is nearly singular.

What there is to gain depends on the field. Where noise comes from all sides alike, Gamma is the
mean of d d^H over directions, and the mean of d^H Gamma^-1 d is M, as in independent noise: the
weights win back what sharing has cost plain pre-whitening, up to a factor of M at low frequencies
and next to nothing where microphones are many wavelengths apart. Noise of fewer sources than
microphones leaves directions in which there is none.

Everything is one product per bin of spectra over `size` points, more than all responses are long.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from scipy import fft

from echolearn.acoustics.geometry import relative_delays
from echolearn.acoustics.types import Array, MicArray, Observation
from echolearn.checks import check
from echolearn.localization import beamforming
from echolearn.localization.whitening import colour

REACH = 2.0
"""Lags of the coherence that are kept, in travel times across the array; at least `LEAST`."""

LEAST = 32
"""Samples."""

LOADING = 0.03
"""Added to the diagonal of the coherence, relative to its mean: no frequency gains more than 15 dB.
Where noise is removed better than that, reverberation is what is left, of which the covariance
knows nothing."""


@dataclass(frozen=True)
class Spatial:
    """The noise between M microphones, seen by one probe.

    Attributes:
        array: microphones.
        scale: samples per metre of path.
        root: Gamma^-1/2, Hermitian, 0 for microphones left out, shape (size // 2 + 1, M, M).
        probe: spectrum of the whitened burst, shape (size // 2 + 1,).
        size: of the transforms.
    """

    array: MicArray
    scale: float
    root: Array
    probe: Array
    size: int

    @cached_property
    def omega(self) -> Array:
        """Angular frequencies, rad per sample, shape (size // 2 + 1,)."""
        return 2 * np.pi * np.fft.rfftfreq(self.size)

    @cached_property
    def inverse(self) -> Array:
        """Gamma^-1, shape (size // 2 + 1, M, M)."""
        return self.root @ self.root

    def whiten(self, samples: Array) -> Array:
        """Return recordings (B, M, N) with noise that is independent between microphones,
        Gamma^-1/2 y.
        """
        return self._apply(self.root, samples)[..., : samples.shape[-1]]

    def correlate(self, samples: Array, *, first: int, last: int) -> Array:
        """Return conj(s) Gamma^-1 y at lags `first` to `last`, also negative ones, shape (B, M,
        lags).
        """
        full = self._apply(self.probe.conj()[:, None, None] * self.inverse, samples)
        return full[..., np.arange(first, last + 1)]

    def _apply(self, matrices: Array, samples: Array) -> Array:
        bins = np.moveaxis(fft.rfft(samples, self.size), -1, 0)  # (F, B, M)
        return fft.irfft(np.moveaxis(bins @ matrices.mT, 0, -1), self.size)

    def strength(self, azimuth: Array, elevation: Array) -> Array:
        """Return E(phi) of directions (A,): the energy of a whitened echo of gain 1, shape (A,)."""
        late = relative_delays(self.array, azimuth, elevation, 1.0) * self.scale
        turned = np.exp(-1j * self.omega[:, None, None] * late.T)  # (F, M, A)
        energy = np.square(np.abs(self.root @ turned)).sum(axis=1)
        return np.asarray(self._weights @ energy)

    def grid_strength(self, azimuth: Array, elevation: Array) -> Array:
        """Return E(phi) of a grid of directions (A,), which is computed once, shape (A,)."""
        key = azimuth.tobytes() + elevation.tobytes()
        if key not in self._grids:
            self._grids[key] = self.strength(azimuth, elevation)
        return self._grids[key]

    @cached_property
    def _grids(self) -> dict[bytes, Array]:
        return {}

    @cached_property
    def _weights(self) -> Array:
        """|s|^2 of each bin, twice where it stands for a negative frequency too, shape (size // 2 + 1,)."""
        count = np.where((self.omega == 0) | (self.omega >= np.pi), 1.0, 2.0) / self.size
        return np.square(np.abs(self.probe)) * count

    def heard(self, gain: Array, delays: Array, size: int) -> Array:
        """Return the correlations that echoes have with the probe, shape (B, M, size).

        Args:
            gain: shape (B,).
            delays: of each microphone, in samples after the window's first lag, shape (B, M).
            size: of the correlations, which begin `PAD` lags before the window.
        """
        wave = np.exp(-1j * self.omega[:, None, None] * (delays + beamforming.PAD))  # (F, B, M)
        matrices = np.square(np.abs(self.probe))[:, None, None] * self.inverse
        full = fft.irfft(np.moveaxis(wave @ matrices.mT, 0, -1), self.size)
        return gain[:, None, None] * full[..., :size]


def spatial(white: Observation, raw: Observation, *, heard: Array) -> Spatial:
    """Return the spatial weighting for recordings that have passed the whitening filter.

    Args:
        white: the recordings (B, M, N) and the probe after `whitening.whitened`.
        raw: as recorded, with `noise_covariance` (F, M, M).
        heard: which microphones take part, shape (M,), bool.

    Raises:
        BadValue: no covariance, or one that does not fit the array.
    """
    covariance = check_covariance(raw)
    psd = np.diagonal(covariance, axis1=-2, axis2=-1).real.T
    heard = heard & (psd.mean(axis=-1) > 0)
    burst = white.probe.samples
    length = white.samples.shape[-1] + len(burst)
    scale = white.probe.sample_rate / white.speed_of_sound
    gamma = covariance[:, heard][:, :, heard] / np.maximum(colour(psd), 1e-6)[:, None, None]
    key = (
        white.array.positions.tobytes(),
        gamma.tobytes(),
        heard.tobytes(),
        np.asarray(burst, float).tobytes(),
    )
    return _spatial(*key, scale, fft.next_fast_len(length + length // 2, real=True))


def with_density(observation: Observation) -> Observation:
    """Return an observation that knows the densities of its noise: the covariance's, where it has
    no others.
    """
    covariance = check_covariance(observation)
    psd = np.diagonal(covariance, axis1=-2, axis2=-1).real.T
    return observation if observation.noise_psd is not None else replace(observation, noise_psd=psd)


def check_covariance(observation: Observation) -> Array:
    """Return `noise_covariance` (F, M, M), which must be known and fit the array.

    Raises:
        BadValue: it does not.
    """
    name, count = "observation.noise_covariance", len(observation.array)
    known, hint = (
        observation.noise_covariance is not None,
        "record the noise alone and give signals.noise_covariance",
    )
    check(known, "localizer.whiten", "spatial", allowed=f"only with {name}", hint=hint)
    found = np.asarray(observation.noise_covariance, dtype=complex)
    fits = found.ndim == 3 and found.shape[1:] == (count, count) and len(found) > 1
    check(fits, name, found.shape, allowed=f"shape (F, {count}, {count})")
    check(bool(np.isfinite(found).all()), name, "NaN or infinity", allowed="finite numbers")
    level = np.abs(found).max()
    hermitian = bool((np.abs(found - found.conj().mT) <= 1e-6 * level).all())
    positive = bool((np.diagonal(found, axis1=-2, axis2=-1).real >= 0).all())
    check(
        hermitian and positive,
        name,
        "not Hermitian, or a density below 0",
        allowed="covariances E Y Y^H",
    )
    return found


@lru_cache(maxsize=4)
def _spatial(
    positions: bytes, gamma: bytes, heard: bytes, burst: bytes, scale: float, size: int
) -> Spatial:
    array = MicArray(np.frombuffer(positions).reshape(-1, 3))
    mask = np.frombuffer(heard, dtype=bool)
    count = int(mask.sum())
    coherence = np.frombuffer(gamma, dtype=complex).reshape(-1, count, count)
    places = array.positions[mask]
    apart = float(np.linalg.norm(places[:, None] - places, axis=-1).max(initial=0.0)) * scale
    smooth = shorten(coherence, lags=max(LEAST, round(REACH * apart)), size=size)
    root = np.zeros((size // 2 + 1, len(mask), len(mask)), dtype=complex)
    root[np.ix_(np.arange(len(root)), mask, mask)] = inverse_root(smooth)
    return Spatial(array, scale, root, fft.rfft(np.frombuffer(burst), size), size)


def shorten(coherence: Array, *, lags: int, size: int) -> Array:
    """Return coherences (F, M, M) cut to `lags` on either side by a Hann taper, over `size` points,
    of mean level 1.
    """
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
    values, vectors = np.linalg.eigh((coherence + coherence.conj().mT) / 2)
    loaded = (np.maximum(values, 0.0) + LOADING) / (1.0 + LOADING)
    return (vectors / np.sqrt(loaded)[:, None]) @ vectors.conj().mT
