"""The sums of `evidence` over poses, compiled.

For each normal and pose the offsets in the window are one stretch of the grid, so the innermost
loop runs along it, and along the pose's matched filters: memory is read in order.
"""

from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from echolearn.acoustics.types import Array


class Lines(NamedTuple):
    """Lines of a grid as the poses of a walk have them.

    Attributes:
        offsets: of the poses along each normal, shape (T, P), in m.
        nearest, farthest: ends of the window, in m.
        low, step: least offset of the grid, and from one to the next, in m.
        total: number R of offsets.
    """

    offsets: Array
    nearest: float
    farthest: float
    low: float
    step: float
    total: int


class Filters(NamedTuple):
    """Matched filters of a walk, and how they are read.

    Attributes:
        fine: shape (P, M, F), float32.
        directions: of each normal as each pose sees it, shape (T, P), in rad.
        microphones: shape (M, 3), in m.
        scale: places in `fine` per metre of path.
        start: path that the first place stands for, in places.
    """

    fine: Array
    directions: Array
    microphones: Array
    scale: float
    start: float


class Table(NamedTuple):
    """Tabled evidence of the poses, and how it is read.

    Attributes:
        z: shape (P, A, D), float32.
        rows: azimuth nearest to each normal as each pose sees it, shape (T, P).
        step: from one distance to the next, in m.
    """

    z: Array
    rows: Array
    step: float


def sum_exact(filters: Filters, lines: Lines) -> tuple[Array, Array]:
    """Return the sums of J, and the numbers of poses in them, each (T, R)."""
    sums, counts = _sum_exact(filters, lines)
    return sums, counts


def sum_tabled(table: Table, lines: Lines) -> tuple[Array, Array]:
    """Return the sums of tabled z, and the numbers of poses in them, each (T, R)."""
    sums, counts = _sum_tabled(table, lines)
    return sums, counts


@njit(error_model="numpy", nogil=True)
def _stretch(lines: Any, along: Any) -> Any:
    """Return the first offset that a pose has in its window, and the one after the last."""
    here = along - lines.low
    # The edges belong to the window, whatever rounding makes of them.
    first = int(np.ceil((lines.nearest + here) / lines.step - 1e-9))
    after = int(np.floor((lines.farthest + here) / lines.step + 1e-9)) + 1
    return max(first, 0), min(after, lines.total)


@njit(error_model="numpy", nogil=True)
def _sum_exact(filters: Any, lines: Any) -> Any:
    """Return the sums; see `sum_exact`."""
    sums = np.zeros((len(lines.offsets), lines.total), np.float32)
    counts = np.zeros_like(sums)
    # In single precision throughout: a double among them would make all of it slower.
    scale = np.float32(filters.scale)
    start = np.float32(filters.start)
    step = np.float32(lines.step)
    four = np.float32(4.0)
    places = np.empty(lines.total, np.float32)
    for t in range(lines.offsets.shape[0]):
        for p in range(lines.offsets.shape[1]):
            along = lines.offsets[t, p]
            first, after = _stretch(lines, along)
            nearest = np.float32(lines.low + first * lines.step - along)
            cos, sin = np.cos(filters.directions[t, p]), np.sin(filters.directions[t, p])
            cells = sums[t, first:after]
            # Number by number: a slice that is assigned takes seconds to compile.
            for j in range(first, after):
                counts[t, j] += np.float32(1.0)
            for m in range(len(filters.microphones)):
                x, y, z = filters.microphones[m]
                toward = np.float32(x * cos + y * sin)
                square = np.float32(x * x + y * y + z * z)
                row = filters.fine[p, m]
                # Places by themselves, which are computed several at a time.
                for j in range(len(cells)):
                    distance = nearest + np.float32(j) * step
                    way = np.sqrt(four * distance * (distance - toward) + square)
                    places[j] = way * scale - start
                for j in range(len(cells)):
                    here = np.uint32(np.int32(places[j]))
                    part = places[j] - np.float32(here)
                    cells[j] += row[here] + part * (row[here + 1] - row[here])
    return sums, counts


@njit(error_model="numpy", nogil=True)
def _sum_tabled(table: Any, lines: Any) -> Any:
    """Return the sums; see `sum_tabled`."""
    sums = np.zeros((len(lines.offsets), lines.total), np.float32)
    counts = np.zeros_like(sums)
    last = table.z.shape[2] - 1
    for t in range(lines.offsets.shape[0]):
        for p in range(lines.offsets.shape[1]):
            along = lines.offsets[t, p]
            first, after = _stretch(lines, along)
            nearest = lines.low - along - lines.nearest
            row = table.z[p, table.rows[t, p]]
            # Number by number: a slice that is assigned takes seconds to compile.
            for j in range(first, after):
                counts[t, j] += np.float32(1.0)
            for j in range(first, after):
                column = int(np.rint((nearest + j * lines.step) / table.step))
                # A distance at the edge may be rounded beyond it.
                sums[t, j] += row[min(max(column, 0), last)]
    return sums, counts


with suppress(RuntimeError):  # there is no place to keep it
    _sum_exact.enable_caching()
    _sum_tabled.enable_caching()
