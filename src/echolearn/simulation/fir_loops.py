"""Short filters on long responses, compiled: faster than transforms while there are few taps.

As `image_loops`, this is imported where it is called: a process that has Numba cannot be forked.
"""

from contextlib import suppress
from typing import Any

import numpy as np
from numba import njit

from echolearn.acoustics.types import Array

BLOCK = 512
"""Samples that stay in the processor's cache while all taps pass over them."""


def filtered(signals: Array, taps: Array, *, ahead: int = 0) -> Array:
    """Return y_m(n) = sum over j of h_m(j) x_m(n + ahead - j), shape (M, N).

    Args:
        signals: x, shape (M, N); zero before and after.
        taps: h, shape (M, T), or (1, T) for all alike.
        ahead: samples by which the filter looks ahead, such as half of a symmetric one.
    """
    count = taps.shape[1]
    padded = np.pad(signals, [(0, 0), (count - 1 - ahead, ahead)])
    result = np.zeros(signals.shape)
    backwards = np.broadcast_to(taps[:, ::-1], (len(signals), count))
    _filter(padded, np.ascontiguousarray(backwards), result)
    return result


@njit(error_model="numpy", nogil=True, fastmath={"contract"})
def _filter(padded: Any, taps: Any, result: Any) -> None:
    """Add the products of taps and samples that follow each other to the result."""
    for m in range(len(result)):
        for start in range(0, result.shape[1], BLOCK):
            block = result[m, start : start + BLOCK]
            for j in range(taps.shape[1]):
                source = padded[m, start + j :]
                for n in range(len(block)):
                    block[n] += taps[m, j] * source[n]


with suppress(RuntimeError):  # there is no place to keep it
    _filter.enable_caching()
