"""The two loops of `images`, written for Numba; arrays are pointers to numbers that follow each
other.

Nothing here allocates, raises or calls Python, so their machine code needs nothing of Numba and can
    be kept: see
`machine`, which alone imports this module, and only where no process before has compiled it.
"""

import math
from functools import partial
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from echolearn.simulation.rir.machine import STEP_BITS, STEPS, TAPS

compiler: Any = partial(njit, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)
pointer_to: Any = types.CPointer
FLOATS, DOUBLES, WHOLES = (pointer_to(kind) for kind in (types.float32, types.float64, types.int32))
WHOLE, NUMBER = types.int64, types.float64
AXIS = (DOUBLES, WHOLE)


def _after(_: Any, pointer: Any, count: Any) -> Any:
    """Return the pointer to what stands `count` numbers after the one at `pointer`."""

    def generate(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        return builder.gep(
            arguments[0], [arguments[1]], source_etype=context.get_value_type(pointer.dtype)
        )

    return pointer(pointer, count), generate


after: Any = intrinsic(_after)


def _add_row(_: Any, target: Any, row: Any, weight: Any, slope: Any) -> Any:
    """Add weight * row[:8] + slope * row[8:] to the 8 floats at `target`.

    Left to itself, the compiler does this one float at a time, which makes the whole engine three
    times slower.
    """
    vector, index = ir.VectorType(ir.FloatType(), TAPS), ir.IntType(32)

    def fill(builder: Any, value: Any) -> Any:
        single = builder.insert_element(
            ir.Constant(vector, ir.Undefined), value, ir.Constant(index, 0)
        )
        return builder.shuffle_vector(
            single, single, ir.Constant(ir.VectorType(index, TAPS), [0] * TAPS)
        )

    def generate(context: Any, builder: Any, _: Any, arguments: Any) -> Any:
        to, at, *factors = arguments
        pointer, rows = (builder.bitcast(place, vector.as_pointer()) for place in (to, at))
        total = builder.load(pointer, align=4)
        for part, factor in enumerate(factors):
            values = builder.load(builder.gep(rows, [index(part)]), align=4)
            product = builder.fmul(fill(builder, factor), values, flags=("contract",))
            total = builder.fadd(total, product, flags=("contract",))
        builder.store(total, pointer, align=4)
        return context.get_dummy_value()

    return types.void(target, row, weight, slope), generate


add_row: Any = intrinsic(_add_row)


def _spread(
    grid: Any,
    table: Any,
    reach: Any,
    x: Any,
    nx: Any,
    y: Any,
    ny: Any,
    z: Any,
    nz: Any,
    numbers: Any,
    steps: Any,
) -> None:
    """Add psi for all images within `reach` of one microphone; see `respond`."""
    gx, gy, gz, weight, slope = (
        after(x, nx),
        after(y, ny),
        after(z, nz),
        numbers,
        after(numbers, nz),
    )
    for i in range(nx):
        count = nz
        for j in range(ny):
            r2, g = x[i] + y[j], gx[i] * gy[j]
            while count > 0 and r2 + z[count - 1] > reach * reach:
                count -= 1
            for k in range(count):
                delay = math.sqrt(r2 + z[k])
                steps[k] = np.int32(delay * STEPS)
                weight[k] = np.float32(g * gz[k]) / np.float32(delay)
                slope[k] = weight[k] * np.float32(delay * STEPS - steps[k])
            for k in range(count):
                row = after(table, (steps[k] & (STEPS - 1)) * (2 * TAPS))
                add_row(after(grid, steps[k] >> STEP_BITS), row, weight[k], slope[k])


spread: Any = compiler(_spread)


def _filter_down(grid: Any, q: Any, taps: Any, response: Any, length: Any, even: Any) -> None:
    """Write response(n) = sum over j of q(j) grid(2 n + j), in blocks that stay in the cache; see
    `respond`.
    """
    half = length + (taps + TAPS) // 2
    odd = after(even, half)
    for n in range(half):
        even[n] = grid[2 * n]
        odd[n] = grid[2 * n + 1]
    for start in range(0, length, 512):
        stop = min(start + 512, length)
        for n in range(start, stop):
            response[n] = q[taps - 1] * even[n + taps // 2]
        for j in range(taps // 2):
            for n in range(start, stop):
                response[n] += q[2 * j] * even[n + j] + q[2 * j + 1] * odd[n + j]


filter_down: Any = compiler(_filter_down, fastmath={"contract"})


def respond(
    response: Any,
    count: Any,
    length: Any,
    table: Any,
    q: Any,
    taps: Any,
    lead: Any,
    reach: Any,
    x: Any,
    nx: Any,
    y: Any,
    ny: Any,
    z: Any,
    nz: Any,
    room: Any,
    numbers: Any,
    steps: Any,
) -> None:
    """Write the responses of all microphones, but for their scale.

    Args:
        response: written, (count, length).
        count, length: microphones, samples.
        table: of psi, (STEPS, 2 TAPS).
        q, taps: the filter, an odd number of taps.
        lead: where in the grid the first tap of a delay of 0 goes.
        reach: largest distance of interest, in samples of the grid.
        x, nx: squared offsets and reflection products on an axis, nearest first, (count, 2, nx); so
            y and z.
        room: for the grid, and once more for its halves, see `images.grid_length`.
        numbers: room for what is computed of the images of one row, 2 nz.
        steps: the same, whole, nz.
    """
    size = 2 * (length + (taps + TAPS) // 2)
    for m in range(count):
        for n in range(size):
            room[n] = np.float32(0.0)
        axes = (after(x, 2 * nx * m), after(y, 2 * ny * m), after(z, 2 * nz * m))
        spread(
            after(room, lead), table, reach, axes[0], nx, axes[1], ny, axes[2], nz, numbers, steps
        )
        filter_down(room, q, taps, after(response, length * m), length, after(room, size))


def translated() -> tuple[str, str]:
    """Return the symbol of `respond`, and all in the language of LLVM, optimised for this
    processor.
    """
    kinds = (
        FLOATS,
        WHOLE,
        WHOLE,
        FLOATS,
        FLOATS,
        WHOLE,
        WHOLE,
        NUMBER,
        *AXIS,
        *AXIS,
        *AXIS,
        FLOATS,
        FLOATS,
        WHOLES,
    )
    loop = compiler(kinds)(respond)
    [result], [text] = loop.overloads.values(), loop.inspect_llvm().values()
    return result.fndesc.llvm_func_name, text
