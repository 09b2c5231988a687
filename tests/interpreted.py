"""Loops that Numba compiles, run line by line as Python: what they say in Python is held against
the same independent sums as what was compiled of it, and the lines are counted as reached."""

from collections.abc import Callable
from types import ModuleType

import numpy as np
import pytest

from echolearn.simulation.image_loops import STEPS, TAPS


def interpret(
    module: ModuleType, patch: pytest.MonkeyPatch, **written: Callable[..., object] | int
) -> None:
    """Let all compiled functions of a module be the Python that they were written as.

    Args:
        module: with functions decorated by `njit`.
        patch: undoes it.
        written: Python for what is written as instructions of the processor, or other constants.
    """
    for name, value in list(vars(module).items()):
        if hasattr(value, "py_func"):
            patch.setattr(module, name, value.py_func)
    for name, instead in written.items():
        patch.setattr(module, name, instead)


AT_ONCE = 4


def lanes_at(place):
    """Return numbers of a flat array, as `lanes.lanes_at`."""
    array, at = place
    return array[at : at + AT_ONCE].copy()


def parts_at(place):
    """Return real and imaginary parts, as `lanes.parts_at`."""
    found = lanes_at(place)
    return found.real, found.imag


def write_lanes(written):
    """Write numbers, as `lanes.write_lanes`."""
    array, at, lanes = written
    array[at : at + AT_ONCE] = lanes


def fused_lanes(numbers):
    """Return a b + c, as `lanes.fused`."""
    return np.array(list(map(fused, zip(*numbers, strict=True))))


LANES = {
    "WIDTH": AT_ONCE,
    "wide": lambda: None,
    "no_lanes": lambda: np.zeros(AT_ONCE, np.float32),
    "lanes_at": lanes_at,
    "parts_at": parts_at,
    "write_lanes": write_lanes,
    "fused": fused_lanes,
    "fused_less": lambda numbers: fused_lanes((-numbers[0], *numbers[1:])),
}
"""Python for what `acoustics.lanes` writes as instructions, of so few numbers at once."""


def fused(numbers: tuple[np.float32, np.float32, np.float32]) -> np.float32:
    """Return a b + c, as `covariance_loops._fma`: of float32 the product is exact in double."""
    first, second, added = map(float, numbers)
    return np.float32(first * second + added)


def upper(first: np.uint64, second: np.uint64) -> np.uint64:
    """Return the upper half of a product, as `normal_loops._upper`."""
    return np.uint64(int(first) * int(second) >> 64)


def add_row(given):
    """Add a row of the table of psi and its rise, as `image_loops._add_row`."""
    grid, at, table, row, weight, slope = given
    taps = table.shape[1] // 2
    grid[at : at + taps] += weight * table[row, :taps] + slope * table[row, taps:]


def place_row(given):
    """Write steps, weight and slope of images that follow each other, as `image_loops`."""
    squares, products, first, square, product, steps, weight, slope = given
    some = slice(first, first + TAPS)
    delay = np.sqrt(square + squares[some])
    steps[some] = delay * STEPS
    weight[some] = product * products[some] / delay
    slope[some] = weight[some] * (delay * STEPS - steps[some])
