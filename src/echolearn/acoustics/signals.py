"""Signals: the probe, framing, matched filtering, signal-to-noise ratio.

The matched filter r_m(tau) = sum_n y_m(n + tau) s(n) is the heart of every estimator. Only the lags
of the search window are wanted and the burst is short, so one short FFT over the samples it touches
replaces the sums of the paper (Eqs. 10-13) without approximation.
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array, Probe
from echolearn.checks import check, check_finite, check_whole, real_array

AT_ONCE = 2**14
"""Samples of spectra that are convolved together."""

STFT_FRAME = 882
"""Samples per STFT frame as printed in the paper (40 ms at 22.05 kHz; the text says 20 ms); hop is
half of it."""


def noise_probe(
    *, seed: int = 0, burst: int = 1500, length: int = 20000, sample_rate: float = 22050.0
) -> Probe:
    """Draw the paper's probe: a burst of white Gaussian noise, zero-padded.

    Its samples are exact in a float32 WAV.

    Args:
        seed: of the burst; a robot's probe is known and always the same.
        burst: L, samples drawn from N(0, 1).
        length: N, samples recorded.
        sample_rate: in Hz.

    Raises:
        BadValue: sizes that are not whole, or a burst longer than the recording.
    """
    check_whole("probe.seed", seed, low=0)
    check_whole("probe.burst", burst, low=16, unit="samples")
    # Rounded before anything else sees it, so that the burst and its WAV file are one.
    samples = np.random.default_rng(seed).standard_normal(burst).astype(np.float32)
    return Probe(samples, sample_rate, length)


def matched_filter(samples: Array, probe: Probe, *, first: int, last: int) -> Array:
    """Correlate recordings with the probe: r(tau) = sum_n y(n + tau) s(n).

    Args:
        samples: recordings y, shape (..., N).
        probe: its burst s has L samples.
        first, last: lags wanted, both inclusive, 0 <= first <= last.

    Returns:
        Correlation, shape (..., last - first + 1); samples beyond the recording count as zero.
    """
    lags = last - first + 1
    burst = len(probe.samples)
    # Long enough that what wraps around is not among the lags wanted.
    size = fft.next_fast_len(lags + burst - 1, real=True)
    touched = samples[..., first : last + burst]
    spectrum = fft.rfft(touched, size) * fft.rfft(probe.samples, size).conj()
    return fft.irfft(spectrum, size)[..., :lags]


def energy_under_probe(samples: Array, probe: Probe, *, first: int, last: int) -> Array:
    """Return the energy of recordings under the delayed burst, shape (..., last - first + 1).

    Args:
        samples: recordings, shape (..., N); those beyond the recording count as zero.
        probe: its burst has L samples.
        first, last: lags wanted, both inclusive.
    """
    burst = len(probe.samples)
    touched = samples[..., first : last + burst]
    missing = max(last + burst - first - touched.shape[-1], 0)
    square = np.pad(touched**2, [(0, 0)] * (samples.ndim - 1) + [(1, missing)])
    # A running sum serves all lags at once; the zero before it makes lag 0 like the others.
    total = np.cumsum(square, axis=-1)
    return total[..., burst:] - total[..., : last - first + 1]


def stft(samples: Array, *, frame: int = STFT_FRAME) -> Array:
    """Return short-time spectra of (..., N): Hann window, half overlap, shape (..., F, T)."""
    hop = frame // 2
    frames = np.lib.stride_tricks.sliding_window_view(samples, frame, axis=-1)[..., ::hop, :]
    windowed = frames * hann(frame).astype(samples.dtype)
    return np.moveaxis(fft.rfft(windowed, axis=-1), -1, -2)


def hann(frame: int) -> Array:
    """Return the periodic Hann window: its half-overlapping copies add up to a constant."""
    return np.hanning(frame + 1)[:-1]


def convolve(samples: Array, response: Array, *, length: int, skip: int = 0) -> Array:
    """Return the beginning of the convolution of a burst with responses, shape (..., length).

    Args:
        samples: the burst, shape (L,).
        response: shape (..., K).
        length: number of samples wanted.
        skip: samples left out before them.
    """
    # As long as the whole convolution, so that its end does not wrap around to the beginning.
    size = fft.next_fast_len(len(samples) + response.shape[-1] - 1, real=True)
    burst = burst_spectrum(samples, size)
    result = np.empty((*response.shape[:-1], length))
    flat = result.reshape(-1, length)
    kept = min(size - skip, length)
    responses = response.reshape(-1, response.shape[-1])
    # Two at a time share the processor's vectors; more, if short, still stay in its cache.
    together = max(2, AT_ONCE // size)
    for first in range(0, len(flat), together):
        some = slice(first, first + together)
        spectra = fft.rfft(responses[some], size)
        np.multiply(burst, spectra, out=spectra)
        whole = fft.irfft(spectra, size, overwrite_x=True)
        flat[some, :kept] = whole[:, skip : skip + kept]
    flat[:, kept:] = 0.0
    return result


def burst_spectrum(samples: Array, size: int) -> Array:
    """Return the spectrum of a burst (L,) of float64, padded to `size`; those used last are kept.

    All rows of a set share one, in rooms of other reverberation one for each of some fifty sizes.
    """
    return _burst_spectrum(samples.tobytes(), size)


@lru_cache(maxsize=64)
def _burst_spectrum(samples: bytes, size: int) -> Array:
    return fft.rfft(np.frombuffer(samples), size)


def noise_psd(recording: Array, *, frame: int = STFT_FRAME) -> Array:
    """Return the power spectral density of noise (..., N), shape (..., frame // 2 + 1).

    Welch's mean over half-overlapping Hann frames, scaled so that white noise of variance v has the
    density v at every frequency: the mean over frequencies is the power.

    Raises:
        BadValue: a recording shorter than two frames, or not finite.
    """
    return _density(_noise_spectra(recording, frame), frame)


def noise_covariance(recording: Array, *, frame: int = STFT_FRAME) -> Array:
    """Return the covariance between microphones of noise (M, N), shape (frame // 2 + 1, M, M).

    E Y Y^H of each bin by Welch's mean, Hermitian; its diagonal is `noise_psd`.

    Raises:
        BadValue: a recording shorter than two frames, or not finite.
    """
    return _covariance(_noise_spectra(recording, frame), frame)


def noise_statistics(recording: Array, *, frame: int = STFT_FRAME) -> tuple[Array, Array]:
    """Return `noise_psd` and `noise_covariance` of noise (M, N), from the same spectra."""
    spectra = _noise_spectra(recording, frame)
    return _density(spectra, frame), _covariance(spectra, frame)


def pooled(measured: Sequence[tuple[Array, Array]], lengths: Sequence[int]) -> tuple[Array, Array]:
    """Return the statistics of pieces of one recording, each weighted by its length."""
    # Of a single piece, which most are, this is exactly what was measured.
    shares = np.array(lengths) / sum(lengths)
    psd, covariance = (
        sum(share * each for share, each in zip(shares, parts, strict=True))
        for parts in zip(*measured, strict=True)
    )
    return psd, covariance


def _density(spectra: Array, frame: int) -> Array:
    return np.mean(np.abs(spectra) ** 2, axis=-1) / np.sum(np.hanning(frame + 1)[:-1] ** 2)


def _covariance(spectra: Array, frame: int) -> Array:
    bins = np.moveaxis(spectra, -3, -2)
    return bins @ bins.conj().mT / (bins.shape[-1] * np.sum(np.hanning(frame + 1)[:-1] ** 2))


def _noise_spectra(recording: Array, frame: int) -> Array:
    """Return the short-time spectra of a recording of noise, or raise `BadValue`."""
    name = "noise.recording"
    recording = np.atleast_1d(real_array(name, recording, allowed="samples must be real numbers"))
    hint = "record the noise for some seconds"
    check_whole(name, recording.shape[-1], low=2 * frame, unit="samples", hint=hint)
    check_finite(name, recording, allowed="samples must be finite")
    return stft(recording, frame=frame)


def whitening_taps(psd: Array) -> Array:
    """Return the symmetric filter of gain 1 / sqrt(psd), shape (2 F - 1,), for a density (F,).

    Densities are floored 60 dB below their mean, so that an empty band is not all that is left.

    Raises:
        BadValue: a density that is negative, not finite, or zero everywhere.
    """
    psd = np.asarray(psd, dtype=float)
    fine = np.isfinite(psd).all() and (psd >= 0).all() and (psd.max(axis=-1) > 0).all()
    check(
        fine and psd.shape[-1] > 1,
        "observation.noise_psd",
        f"shape {psd.shape}",
        allowed="densities must be finite and 0 or more, not all 0",
    )
    # Cut by a window, the response is short, and the gain its smooth likeness.
    level = np.maximum(psd, 1e-6 * psd.mean(axis=-1, keepdims=True))
    size = 2 * (psd.shape[-1] - 1)
    taps = np.roll(fft.irfft(1.0 / np.sqrt(level), size), size // 2, axis=-1)
    return np.concatenate([taps, taps[..., :1]], axis=-1) * np.hanning(size + 3)[1:-1]


def whiten(samples: Array, psd: Array) -> Array:
    """Divide the spectrum of `samples` (..., N) by the square root of a density (F,).

    The result is F - 1 samples late. The filter is symmetric and its whole response is kept, shape
    (..., N + 2 (F - 1)). A probe and a recording whitened alike are late alike, so lags between
    them stay what they were, and a correlation of the two is ifft(Y conj(S) / psd).
    """
    # It takes half a second to import, and most noise is white.
    from scipy.signal import oaconvolve

    taps = whitening_taps(psd)
    return oaconvolve(samples, np.broadcast_to(taps, (*samples.shape[:-1], len(taps))), axes=-1)


def power(samples: Array) -> Array:
    """Return the mean square of `samples` (..., N) over time, shape (...)."""
    return np.mean(np.square(samples), axis=-1)


def joint_db(*levels_db: float | Array | None) -> Array:
    """Return the ratio in dB of a signal to a sum of noises, each at its own; None is no noise."""
    given = [np.asarray(level, dtype=float) for level in levels_db if level is not None]
    total = sum((10.0 ** (-level / 10.0) for level in given), start=np.zeros(()))
    return np.where(total > 0, -decibel(total), np.inf)


def decibel(ratio: Array) -> Array:
    """Return 10 log10 of a power ratio, floored at -300 dB."""
    return 10.0 * np.log10(np.maximum(ratio, 1e-30))
