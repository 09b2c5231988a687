"""The compiled half of the engine `Images`: images are spread onto a grid, the grid is filtered.

An image at a delay of t samples adds g / (4 pi d) phi(n - t) to a response, phi a sinc under a
Kaiser window of +-40 samples. Writing those 81 taps is what takes the time elsewhere. Here each
image is written with 8 taps, as in the non-uniform FFT (Dutt and Rokhlin 1993; Barnett, Magland and
af Klinteberg 2019): onto a grid at 2 fs, with a narrow kernel psi read from a table. One filter q,
whose spectrum is phi / psi, then turns every psi into phi and halves the rate. As q is short it
runs in the time domain: no circular wrap, and the rounding of a loud echo stays near that echo.

Errors: psi and its table -105 dB, phi against the ideal delay -89 dB up to 0.92 of Nyquist, float32
sums -130 dB.

Numba compiles the loops once and keeps the machine code beside the package's own byte code, or
where that cannot be written in the user's cache; where neither can, each process compiles anew, for
seconds. What is kept is made again when this file changes, and no other: all that is compiled
stands here, the constants too, but for `acoustics.lanes`. Numba takes a third of a second to
import, and a process that has it can no longer be forked (`runtime.processes`), so `Images` imports
this module when it is called.
"""

from contextlib import suppress
from functools import lru_cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from echolearn.acoustics.lanes import instructions, wide
from echolearn.acoustics.types import Array

HALF_WIDTH = 40
"""Half width of phi, in samples."""

REACH = HALF_WIDTH + 4
"""Half width of q, in samples, even: dividing by psi widens phi a little."""

TAPS = 8
"""Width of psi, in samples of the grid."""

INDEX = ir.IntType(32)
"""Type of places within a vector."""

STEP_BITS = 7
STEPS = 1 << STEP_BITS
"""Rows in the table of psi, for one sample of the grid."""

BLOCK = 1024
"""Samples of a response that stay in the processor's cache while all taps of q pass over them."""


def responses(axes: tuple[Array, Array, Array], length: int, *, reach: float) -> Array:
    """Return the sums of g / d phi over all images within reach, shape (M, length), float32.

    Args:
        axes: for each axis the squared offsets of the images from every microphone, nearest first,
            and their reflection products, shape (M, 2, K); lengths are samples of the grid.
        length: samples of a response.
        reach: largest distance of interest, in samples of the grid.
    """
    response = np.empty((len(axes[0]), length), np.float32)
    _respond(response, axes, kernel_table(), correction(), reach)
    return response


def fractional_delay(t: Array) -> Array:
    """Return phi at `t` samples from its centre: the sinc under a Kaiser window."""
    return np.sinc(t) * _kaiser(t, HALF_WIDTH, beta=9.0)


def spreading_kernel(t: Array) -> Array:
    """Return psi at `t` samples of the grid from its centre."""
    return _kaiser(t, TAPS / 2, beta=17.0)


def _kaiser(x: Array, half_width: float, *, beta: float) -> Array:
    """Return the Kaiser-Bessel bump I0(beta sqrt(1 - (x / half_width)^2)) / I0(beta), 0 outside."""
    height = np.sqrt(np.maximum(1.0 - (x / half_width) ** 2, 0.0))
    return np.where(np.abs(x) <= half_width, np.i0(beta * height) / np.i0(beta), 0.0)


@lru_cache
def kernel_table() -> Array:
    """Return psi for each step of the fractional delay, shape (STEPS, 2 TAPS).

    A row has the values, then their rise to the next row, for linear interpolation.
    """
    fraction = np.arange(STEPS + 1)[:, None] / STEPS
    values = spreading_kernel(np.arange(TAPS) - (TAPS // 2 - 1) - fraction)
    return np.hstack([values[:-1], np.diff(values, axis=0)]).astype(np.float32)


@lru_cache
def correction() -> Array:
    """Return q, shape (4 REACH + 1,), centred: the filter that turns psi into phi."""
    at = np.arange(-512, 512)
    phi = np.fft.fft(np.fft.ifftshift(fractional_delay(at / 2))).real
    psi = np.fft.fft(np.fft.ifftshift(spreading_kernel(at))).real
    q = np.fft.fftshift(np.fft.ifft(phi / psi).real)
    return q[np.abs(at) <= 2 * REACH].astype(np.float32)


@intrinsic
def _add_row(_: Any, given: Any) -> Any:
    """Add weight * table[row, :8] + slope * table[row, 8:] to the 8 samples of the grid from `at`.

    As one vector: left to itself, the compiler does this one sample after the other, which makes
    the whole engine two thirds slower.

    Args:
        given: grid, at, table, row, weight, slope.
    """

    def write(builder: Any, *given: Any) -> None:
        """Read the samples, add both products to them, write them."""
        grid, at, table, row, *factors = given
        place = _eight(builder, grid, at)
        parts = _eight(builder, table, builder.mul(row, row.type(2 * TAPS)))
        total = builder.load(place, align=4)
        for part, factor in enumerate(factors):
            values = builder.load(builder.gep(parts, [INDEX(part)]), align=4)
            product = builder.fmul(_alike(builder, factor), values, flags=("contract",))
            total = builder.fadd(total, product, flags=("contract",))
        builder.store(total, place, align=4)

    return instructions(types.void(given), write)


@intrinsic
def _place_row(_: Any, given: Any) -> Any:
    """Write steps, weight and slope of `TAPS` images that follow each other on the last axis.

    Args:
        given: squared offsets and products on that axis, index of the first image; squared offset
            and product that all have from the other axes; where the three are written.
    """

    def write(builder: Any, *given: Any) -> None:
        """Do for all at once: delay = sqrt(square), weight = product / delay, and so on."""
        squares, products, first, square, product, *written = given
        single, double, whole = (
            ir.VectorType(kind, TAPS) for kind in (ir.FloatType(), ir.DoubleType(), INDEX)
        )
        own = [builder.load(_eight(builder, each, first), align=8) for each in (squares, products)]
        kind = ir.FunctionType(double, [double])
        root = builder.module.declare_intrinsic(f"llvm.sqrt.v{TAPS}f64", (), kind)
        delay = builder.call(root, [builder.fadd(_alike(builder, square), own[0])])
        fine = builder.fmul(delay, ir.Constant(double, [float(STEPS)] * TAPS))
        steps = builder.fptosi(fine, whole)
        rest = builder.fptrunc(builder.fsub(fine, builder.sitofp(steps, double)), single)
        gain = builder.fptrunc(builder.fmul(_alike(builder, product), own[1]), single)
        weight = builder.fdiv(gain, builder.fptrunc(delay, single))
        found = (steps, weight, builder.fmul(weight, rest))
        for array, numbers in zip(written, found, strict=True):
            builder.store(numbers, _eight(builder, array, first), align=4)

    return instructions(types.void(given), write)


def _eight(builder: Any, *place: Any) -> Any:
    """Return the address of `TAPS` numbers of an array, as one vector, from an index on."""
    first = builder.gep(place[0], [place[1]])
    return builder.bitcast(first, ir.VectorType(first.type.pointee, TAPS).as_pointer())


def _alike(builder: Any, number: Any) -> Any:
    """Return a vector whose `TAPS` numbers are all this one."""
    nothing = ir.Constant(ir.VectorType(number.type, TAPS), ir.Undefined)
    single = builder.insert_element(nothing, number, INDEX(0))
    return builder.shuffle_vector(
        single, single, ir.Constant(ir.VectorType(INDEX, TAPS), [0] * TAPS)
    )


@njit(error_model="numpy", nogil=True)
def _spread(grid: Any, axes: Any, table: Any, reach: Any) -> None:
    """Add psi to the grid for all images within `reach` of one microphone."""
    x, y, z = axes
    # Whole rows of images: what is computed beyond those within reach is not used.
    rows = -(-z.shape[1] // TAPS) * TAPS
    squares = np.zeros(rows)
    products = np.zeros(rows)
    # Number by number: a slice that is assigned takes seconds to compile.
    for k in range(z.shape[1]):
        squares[k] = z[0, k]
        products[k] = z[1, k]
    weight = np.empty(rows, np.float32)
    slope = np.empty(rows, np.float32)
    steps = np.empty(rows, np.int32)
    for i in range(x.shape[1]):
        count = z.shape[1]
        for j in range(y.shape[1]):
            square = x[0, i] + y[0, j]
            product = x[1, i] * y[1, j]

            # Both lists ascend, so the images within reach are a prefix of z that only shrinks.
            while count > 0 and square + squares[count - 1] > reach * reach:
                count -= 1

            # Apart from the spreading, so that several square roots are taken at a time.
            for k in range(0, count, TAPS):
                row_places = (squares, products, k, square, product, steps, weight, slope)
                _place_row(row_places)  # type: ignore[call-arg]
            for k in range(count):
                at = steps[k] >> STEP_BITS
                row = steps[k] & (STEPS - 1)
                _add_row((grid, at, table, row, weight[k], slope[k]))  # type: ignore[call-arg]


@njit(error_model="numpy", nogil=True, fastmath={"contract"})
def _filter_down(grid: Any, q: Any, response: Any) -> None:
    """Write response(n) = sum over j of q(j) grid(2 n + j)."""
    wide()  # type: ignore[call-arg]
    # Even and odd samples apart: numbers that follow each other are multiplied several at a time.
    even = grid[0::2].copy()
    odd = grid[1::2].copy()
    half = len(q) // 2
    for start in range(0, len(response), BLOCK):
        block = response[start : start + BLOCK]
        ahead = even[start + half :]
        for n in range(len(block)):
            block[n] = q[2 * half] * ahead[n]
        # Four at a time, in the order of one at a time: a block is read and written less often.
        for j in range(0, half, 4):
            first = even[start + j :]
            second = odd[start + j :]
            for n in range(len(block)):
                total = block[n]
                total += q[2 * j] * first[n] + q[2 * j + 1] * second[n]
                total += q[2 * j + 2] * first[n + 1] + q[2 * j + 3] * second[n + 1]
                total += q[2 * j + 4] * first[n + 2] + q[2 * j + 5] * second[n + 2]
                total += q[2 * j + 6] * first[n + 3] + q[2 * j + 7] * second[n + 3]
                block[n] = total


@njit(error_model="numpy", nogil=True)
def _respond(response: Any, axes: Any, table: Any, q: Any, reach: Any) -> None:
    """Write the responses of all microphones; see `responses`."""
    x, y, z = axes
    grid = np.empty(2 * (response.shape[1] + (len(q) + TAPS) // 2), np.float32)
    # Time 0 is where the middle of q stands, and psi begins TAPS / 2 - 1 samples before a delay.
    first = 2 * REACH - TAPS // 2 + 1
    for m in range(len(response)):
        grid[:] = 0.0
        _spread(grid[first:], (x[m], y[m], z[m]), table, reach)
        _filter_down(grid, q, response[m])


with suppress(RuntimeError):  # there is no place to keep it
    _respond.enable_caching()
