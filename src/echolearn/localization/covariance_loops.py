"""Frames and covariances of one recording, compiled: all that the transforms between them leave.

    frame_m(t, n) = float32(y_m(t hop + n)) w(n),        R(f) = 1/T sum_t Y_m(f, t) conj(Y_n(f, t))

The sums go from frame to frame, each product added without rounding of its own,

    re += im_m im_n,  re += re_m re_n,      im += im_m re_n,  im -= re_m im_n,

which is what OpenBLAS does for few microphones on processors with AVX-512: there every bit is that
of `beamforming`'s product of matrices. Numba takes a third of a second to import, and a process
that has it cannot be forked, so only who has it already uses this: simulations do.
"""

from contextlib import suppress
from typing import Any

import numpy as np
from numba import njit

from echolearn.acoustics.types import Array


def frames(recording: Array, window: Array) -> Array:
    """Return half-overlapping frames of a recording (M, N), shape (M, T, frame), float32."""
    hop = len(window) // 2
    count = (recording.shape[1] - len(window)) // hop + 1
    found = np.empty((len(recording), count, len(window)), np.float32)
    _frame(recording, window.astype(np.float32), hop, found)
    return found


def frames_covariance(spectra: Array) -> Array:
    """Return R from spectra (M, T, F), complex64, shape (F, M, M), complex64."""
    microphones, count, bins = spectra.shape
    sums = np.empty((bins, microphones, microphones), np.complex64)
    _sum(spectra, sums)
    return sums / count


@njit(error_model="numpy", nogil=True)
def _frame(recording: Any, window: Any, hop: Any, found: Any) -> None:
    """Write windowed frames; see `frames`."""
    for m in range(found.shape[0]):
        single = recording[m].astype(np.float32)
        for t in range(found.shape[1]):
            source = single[t * hop : t * hop + len(window)]
            target = found[m, t]
            for n in range(len(window)):
                target[n] = source[n] * window[n]


@njit(error_model="numpy", nogil=True, fastmath={"contract"})
def _add(re: Any, im: Any, re_n: Any, im_n: Any, sum_re: Any, sum_im: Any) -> None:
    """Add the products of two microphones in one frame to their sums, each shape (F,).

    Args:
        re, im: real and imaginary part of Y_m.
        re_n, im_n: those of Y_n.
        sum_re, sum_im: those of the sum.
    """
    for f in range(len(re)):
        # One product after the other goes into the sum, unrounded.
        total = sum_re[f] + im[f] * im_n[f]
        sum_re[f] = total + re[f] * re_n[f]
        total = sum_im[f] + im[f] * re_n[f]
        sum_im[f] = total - re[f] * im_n[f]


@njit(error_model="numpy", nogil=True)
def _sum(spectra: Any, sums: Any) -> None:
    """Write the sums over frames; see `frames_covariance`."""
    microphones, count, bins = spectra.shape
    re = np.empty((microphones, bins), np.float32)
    im = np.empty((microphones, bins), np.float32)
    sum_re = np.zeros((microphones, microphones, bins), np.float32)
    sum_im = np.zeros((microphones, microphones, bins), np.float32)
    for t in range(count):
        for m in range(microphones):
            frame = spectra[m, t]
            for f in range(bins):
                re[m, f] = frame[f].real
                im[m, f] = frame[f].imag
        for m in range(microphones):
            for n in range(microphones):
                _add(re[m], im[m], re[n], im[n], sum_re[m, n], sum_im[m, n])
    for m in range(microphones):
        for n in range(microphones):
            for f in range(bins):
                sums[f, m, n] = complex(sum_re[m, n, f], sum_im[m, n, f])


with suppress(RuntimeError):  # there is no place to keep it
    _frame.enable_caching()
    _sum.enable_caching()
