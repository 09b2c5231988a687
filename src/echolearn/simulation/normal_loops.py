"""White noise and recordings, compiled: the very samples of NumPy's generator, three times as fast.

`standard_normal` repeats, number for number, what `Generator.standard_normal` does with the
generator PCG64 (O'Neill, "PCG: a family of simple fast space-efficient statistically good
algorithms", 2014, variant XSL-RR of 128 bits): a ziggurat of 256 layers of equal area (Marsaglia
and Tsang, "The ziggurat method for generating random variables", 2000), whose tables Numba has.
NumPy calls a function for each random number; here all is one loop.

As `image_loops`, this is imported where it is called: a process that has Numba cannot be forked.
"""

import math
from contextlib import suppress
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic
from numba.np.random import _constants as ziggurat

from echolearn.acoustics.types import Array

WORD = (1 << 64) - 1
"""Ones in all bits of a number of 64."""

HIGH = np.uint64(2549297995355413924)
LOW = np.uint64(4865540595714422341)
"""Upper and lower half of the factor by which PCG64's state is multiplied."""

TAIL = 3.6541528853610088
"""Where the lowest layer of the ziggurat ends in a tail; beyond it an exponential is drawn."""

RATE = 0.27366123732975828
"""One over it: the mean of that exponential."""

UNIT = 1.0 / 9007199254740992.0
"""Step between numbers of 53 bits in [0, 1)."""

MANTISSA = np.uint64(0x000FFFFFFFFFFFFF)
ONE = np.uint64(1)


def standard_normal(rng: np.random.Generator, shape: tuple[int, ...]) -> Array:
    """Return `rng.standard_normal(shape)`, and leave the generator as that does."""
    if not isinstance(rng.bit_generator, np.random.PCG64):
        return rng.standard_normal(shape)
    state = rng.bit_generator.state
    numbers: Any = state["state"]
    words = [numbers["state"] >> 64, numbers["state"], numbers["inc"] >> 64, numbers["inc"]]
    halves = np.array([word & WORD for word in words], dtype=np.uint64)
    drawn = np.empty(shape)
    _fill(drawn.ravel(), halves, (ziggurat.wi_double, ziggurat.ki_double, ziggurat.fi_double))
    numbers["state"] = int(halves[0]) << 64 | int(halves[1])
    rng.bit_generator.state = state
    return drawn


def coloured(white: Array, before: Array, *, falls: float, taps: tuple[float, float]) -> Array:
    """Return x(n) = falls x(n - 1) + taps_0 w(n) + taps_1 w(n - 1), in place of the white noise w.

    Args:
        white: w, shape (M, N).
        before: falls x(-1) + taps_1 w(-1), shape (M, 1).
        falls: share of a sample that is left in the next.
        taps: factors on this sample of w and the last.
    """
    _colour(white, (before.ravel(), falls, *taps))
    return white


def noisy_recording(
    received: Array, direct: Array, *, noise: Array, gain: float, out: Array | None = None
) -> Array:
    """Return (received - direct + noise) * gain, shape (M, N), in place of the noise or in `out`.

    Args:
        received, noise: shape (M, N).
        direct: shape (M, at most N), 0 behind that.
        gain: factor on all.
        out: where it is written, shape (M, N).
    """
    written = noise if out is None else out
    _record((received, direct, noise), gain, written)
    return written


@intrinsic
def _upper(_: Any, first: Any, second: Any) -> Any:
    """Return the upper half of the product of two numbers of 64 bits."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        """Write the instructions of one call.

        Args:
            context, signature: not needed.
            builder: place where they are written.
            arguments: values of the call.
        """
        wide = ir.IntType(128)
        product = builder.mul(*(builder.zext(number, wide) for number in arguments))
        return builder.trunc(builder.lshr(product, ir.Constant(wide, 64)), ir.IntType(64))

    return types.uint64(types.uint64, types.uint64), generate


@njit(error_model="numpy", nogil=True)
def _step(high: Any, low: Any, halves: Any) -> Any:
    """Return the next state of PCG64: times the factor, plus the increment, modulo 2^128."""
    product = low * LOW
    carried = product + halves[3]
    carry = np.uint64(carried < product)
    upper: Any = _upper(low, LOW)  # type: ignore[call-arg]
    return upper + high * LOW + low * HIGH + halves[2] + carry, carried


@njit(error_model="numpy", nogil=True)
def _bits(high: Any, low: Any) -> Any:
    """Return the 64 random bits of a state: its halves exclusive-or, rotated by its top bits."""
    turn = high >> np.uint64(58)
    mixed = high ^ low
    return mixed >> turn | mixed << (np.uint64(64) - turn & np.uint64(63))


@njit(error_model="numpy", nogil=True)
def _uniform(high: Any, low: Any) -> Any:
    """Return the number in [0, 1) of a state."""
    return (_bits(high, low) >> np.uint64(11)) * UNIT


@njit(error_model="numpy", nogil=True)
def _fill(drawn: Any, halves: Any, tables: Any) -> None:
    """Draw normal numbers; `halves` are those of the state, which changes, and of the increment."""
    width, inside, height = tables
    high = halves[0]
    low = halves[1]
    n = 0
    while n < len(drawn):
        high, low = _step(high, low, halves)
        bits = _bits(high, low)
        layer = bits & np.uint64(255)
        place = bits >> np.uint64(9) & MANTISSA
        x = place * width[layer]
        if bits & np.uint64(256):
            x = -x

        # Nearly all points lie in the part of a layer that is wholly under the curve.
        kept = place < inside[layer]
        if not kept and layer > 0:
            high, low = _step(high, low, halves)
            rise = height[layer - ONE] - height[layer]
            kept = rise * _uniform(high, low) + height[layer] < math.exp(-0.5 * x * x)
        # Half the square of what lies beyond is compared with another exponential.
        while layer == 0 and not kept:
            high, low = _step(high, low, halves)
            beyond = -RATE * math.log1p(-_uniform(high, low))
            high, low = _step(high, low, halves)
            kept = -2.0 * math.log1p(-_uniform(high, low)) > beyond * beyond
            x = TAIL + beyond
            if place >> np.uint64(8) & ONE:
                x = -x
        if kept:
            drawn[n] = x
            n += 1
    halves[0] = high
    halves[1] = low


@njit(error_model="numpy", nogil=True)
def _colour(noise: Any, given: Any) -> None:
    """Colour noise in place; see `coloured`."""
    last, falls, now, past = given
    # Each sample waits for the one before it: meanwhile those of other microphones are computed.
    for n in range(noise.shape[1]):
        for m in range(len(noise)):
            drawn = noise[m, n]
            noise[m, n] = last[m] + now * drawn
            last[m] = past * drawn + falls * noise[m, n]


@njit(error_model="numpy", nogil=True)
def _record(parts: Any, gain: Any, written: Any) -> None:
    """Write a recording; see `noisy_recording`."""
    received, direct, noise = parts
    for m in range(len(noise)):
        # A response that reaches beyond the recording is no part of it.
        for n in range(direct.shape[1]):
            written[m, n] = (received[m, n] - direct[m, n] + noise[m, n]) * gain
        for n in range(direct.shape[1], noise.shape[1]):
            written[m, n] = (received[m, n] + noise[m, n]) * gain


with suppress(RuntimeError):  # there is no place to keep it
    _fill.enable_caching()
    _colour.enable_caching()
    _record.enable_caching()
