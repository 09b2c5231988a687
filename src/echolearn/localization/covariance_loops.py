"""Frames and covariances of recordings and their inverses, compiled: what transforms leave to do.

    frame_m(t, n) = float32(y_m(t hop + n)) w(n),        R(f) = 1/T sum_t Y_m(f, t) conj(Y_n(f, t))

The sums go from frame to frame, each product added without rounding of its own,

    re += im_m im_n,  re += re_m re_n,      im += im_m re_n,  im -= re_m im_n,

which is what OpenBLAS does for few microphones on processors with AVX-512: there every bit is that
of `beamforming`'s product of matrices. Inverses repeat the steps of `beamforming.invert`, with the
roundings of NumPy's complex product where the processor multiplies and adds at once,

    re = fma(re_a, re_b, -(im_a im_b)),     im = fma(re_a, im_b, im_a re_b).

Numba takes a third of a second to import, and a process that has it cannot be forked, so only who
has it already uses this: simulations do.
"""

from contextlib import suppress
from typing import Any

import numpy as np
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from echolearn.acoustics.lanes import (
    WIDTH,
    fused,
    fused_less,
    lanes_at,
    no_lanes,
    parts_at,
    wide,
    write_lanes,
)
from echolearn.acoustics.types import Array

BLOCK = 112
"""Bins whose matrices stay in the processor's cache while they are inverted."""


def frames(recording: Array, window: Array) -> Array:
    """Return half-overlapping frames of a recording (M, N), shape (M, T, frame), float32."""
    hop = len(window) // 2
    count = (recording.shape[1] - len(window)) // hop + 1
    found = np.empty((len(recording), count, len(window)), np.float32)
    _frame(recording, window.astype(np.float32), hop, found)
    return found


def frames_covariance(spectra: Array) -> Array:
    """Return R from spectra (M, T, F), complex64, F at least `WIDTH`: (F, M, M), complex64."""
    microphones, count, bins = spectra.shape
    means = np.empty((bins, microphones, microphones), np.complex64)
    _sum(spectra, means)
    return means


def packed_inverses(covariances: Array, *, keep: float, loading: Array) -> Array:
    """Return packed inverses of keep R + loading I, planes of shape (M*M, B, F), float32.

    Args:
        covariances: R, shape (B, F, M, M), complex64.
        keep: factor on R.
        loading: added to the diagonal, shape (B, F), float32.
    """
    planes = np.empty((covariances.shape[-1] ** 2, *loading.shape), np.float32)
    _invert_all((covariances, np.float32(keep), loading), planes)
    return planes


@intrinsic
def _fma(_: Any, numbers: Any) -> Any:
    """Return a b + c of a tuple (a, b, c), rounded once."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """Write the instructions of one call.

        Args:
            context, signature: not needed.
            builder: place where they are written.
            arguments: values of the call.
        """
        values = cgutils.unpack_tuple(builder, arguments[0])  # type: ignore[no-untyped-call]
        return builder.fma(*values)

    triple = types.UniTuple(types.float32, 3)  # type: ignore[no-untyped-call]
    return types.float32(triple), generate


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


@njit(error_model="numpy", nogil=True)
def _share(total: Any, count: Any) -> Any:
    """Return a sum's parts over a count as NumPy divides: times one over it, zeros signed."""
    re, im = total
    part = np.float32(1.0) / np.float32(count)
    nothing = np.float32(0.0)
    return complex((re + im * nothing) * part, (im - re * nothing) * part)


@njit(error_model="numpy", nogil=True)
def _sum(spectra: Any, means: Any) -> None:
    """Write the means over frames; see `frames_covariance`."""
    wide()  # type: ignore[call-arg]
    microphones, count, bins = spectra.shape
    flat = spectra.ravel()
    re = np.empty(microphones * count * WIDTH, np.float32)
    im = np.empty(microphones * count * WIDTH, np.float32)
    sums = np.empty(3 * WIDTH, np.float32)
    for block in range(0, bins, WIDTH):
        # The last ones overlap those before, so that all are whole.
        first = min(block, bins - WIDTH)
        for row in range(microphones * count):
            parts: Any = parts_at((flat, row * bins + first))
            write_lanes((re, row * WIDTH, parts[0]))
            write_lanes((im, row * WIDTH, parts[1]))
        # Of (m, n) and (n, m) the real parts are one, while the imaginary ones are rounded apart.
        for m in range(microphones):
            for n in range(m, microphones):
                _sum_products((re, im, m * count, n * count, count), sums)
                for f in range(WIDTH):
                    means[first + f, m, n] = _share((sums[f], sums[WIDTH + f]), count)
                    means[first + f, n, m] = _share((sums[f], sums[2 * WIDTH + f]), count)


@njit(error_model="numpy", nogil=True)
def _sum_products(given: Any, sums: Any) -> None:
    """Write the sums over frames of Y_m conj(Y_n): real, imaginary, and that of Y_n conj(Y_m).

    Args:
        given: real and imaginary parts of the spectra, flat; rows, of `WIDTH` bins each, where
            frames of microphones m and n begin, and the number of frames.
        sums: room for 3 times `WIDTH`, flat.
    """
    res, ims, first_m, first_n, count = given
    wide()  # type: ignore[call-arg]
    real: Any = no_lanes()
    here = real
    back = real
    # One product after the other goes into a sum, unrounded, and the sums stay in registers.
    for t in range(count):
        at = (first_m + t) * WIDTH
        there = (first_n + t) * WIDTH
        re_m: Any = lanes_at((res, at))
        im_m: Any = lanes_at((ims, at))
        re_n: Any = lanes_at((res, there))
        im_n: Any = lanes_at((ims, there))
        real = fused((re_m, re_n, fused((im_m, im_n, real))))
        here = fused_less((re_m, im_n, fused((im_m, re_n, here))))
        back = fused_less((re_n, im_m, fused((im_n, re_m, back))))
    for part, lanes in enumerate((real, here, back)):
        write_lanes((sums, part * WIDTH, lanes))


@njit(error_model="numpy", nogil=True)
def _product(factors: Any, added: Any) -> Any:
    """Return a b + c of float32, rounded once, the factors as a tuple."""
    result: Any = _fma((factors[0], factors[1], added))  # type: ignore[call-arg]
    return result


@njit(error_model="numpy", nogil=True)
def _load(given: Any, parts: Any) -> None:
    """Write keep R + loading I of some bins, given as (R, keep, loading), as parts (M, M, F)."""
    covariances, keep, loading = given
    re, im = parts
    nothing = np.float32(0.0)
    for m in range(len(re)):
        for n in range(len(re)):
            for f in range(len(loading)):
                real = covariances[f, m, n].real
                imaginary = covariances[f, m, n].imag
                added = loading[f] if m == n else nothing
                # Products with nothing and sums with it decide the signs of zeros.
                re[m, n, f] = _product((keep, real), -(nothing * imaginary)) + added
                im[m, n, f] = _product((keep, imaginary), nothing * real) + nothing


@njit(error_model="numpy", nogil=True)
def _eliminate(k: int, work: Any) -> None:
    """Do Gauss-Jordan step k on matrices (M, M, F) in place; row and column (2, M, F) are room."""
    re, im, row, column = work
    one = np.float32(1.0)
    nothing = np.float32(0.0)
    for m in range(len(re)):
        for f in range(re.shape[2]):
            column[0, m, f] = re[m, k, f] if m != k else nothing
            column[1, m, f] = im[m, k, f] if m != k else nothing
    for n in range(len(re)):
        for f in range(re.shape[2]):
            pivot = one / re[k, k, f]
            real = re[k, n, f] if n != k else one
            imaginary = im[k, n, f] if n != k else nothing
            row[0, n, f] = _product((real, pivot), -(imaginary * nothing))
            row[1, n, f] = _product((real, nothing), imaginary * pivot)
    _replace(k, re, row[0])
    _replace(k, im, row[1])
    for m in range(len(re)):
        for n in range(len(re)):
            for f in range(re.shape[2]):
                re[m, n, f] -= _product(
                    (column[0, m, f], row[0, n, f]), -(column[1, m, f] * row[1, n, f])
                )
                im[m, n, f] -= _product(
                    (column[0, m, f], row[1, n, f]), column[1, m, f] * row[0, n, f]
                )


@njit(error_model="numpy", nogil=True)
def _replace(k: int, part: Any, row: Any) -> None:
    """Write zeros into column k of matrices (M, M, F), and then a row (M, F) into row k."""
    # Number by number: a slice that is assigned takes seconds to compile, for its error message.
    for n in range(len(part)):
        for f in range(part.shape[2]):
            part[n, k, f] = np.float32(0.0)
    for n in range(len(part)):
        for f in range(part.shape[2]):
            part[k, n, f] = row[n, f]


@njit(error_model="numpy", nogil=True)
def _pack(parts: Any, planes: Any) -> None:
    """Write Hermitian matrices (M, M, F) as planes (M*M, F); see `beamforming.pack_hermitian`."""
    re, im = parts
    used = planes.shape[1]
    place = len(re)
    half = place * (place - 1) // 2
    for m in range(len(re)):
        for f in range(used):
            planes[m, f] = re[m, m, f]
        for n in range(m + 1, len(re)):
            for f in range(used):
                planes[place, f] = re[m, n, f]
                planes[place + half, f] = im[m, n, f]
            place += 1


@njit(error_model="numpy", nogil=True)
def _invert_all(given: Any, planes: Any) -> None:
    """Write packed inverses; see `packed_inverses`."""
    covariances, keep, loading = given
    microphones = covariances.shape[2]
    # Whole blocks, the last one too: numbers that follow each other are taken several at a time.
    re = np.zeros((microphones, microphones, BLOCK), np.float32)
    im = np.zeros((microphones, microphones, BLOCK), np.float32)
    row = np.empty((2, microphones, BLOCK), np.float32)
    column = np.empty((2, microphones, BLOCK), np.float32)
    for b in range(len(covariances)):
        for first in range(0, covariances.shape[1], BLOCK):
            last = min(first + BLOCK, covariances.shape[1])
            part = (covariances[b, first:last], keep, loading[b, first:last])
            _load(part, (re, im))
            for k in range(microphones):
                _eliminate(k, (re, im, row, column))
            _pack((re, im), planes[:, b, first:last])


with suppress(RuntimeError):  # there is no place to keep it
    _frame.enable_caching()
    _sum.enable_caching()
    _invert_all.enable_caching()
