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

AT_ONCE = 4
"""Taps of one pass over a block: each sample of it is read and written once for all of them."""


def filtered_signals(signals: Array, taps: Array, *, low: Array, share: Array) -> Array:
    """Return signals of which a share of the high frequencies is left, filtered, shape (M, N).

        y_m = h_m * (low * x_m + share (x_m - low * x_m))

    Args:
        signals: x, shape (M, N); zero before and after.
        taps: h, shape (M, T).
        low: symmetric low-pass, an odd number of taps, centred.
        share: of what it takes, which is left, over time, shape (N,).
    """
    result = np.empty(signals.shape)
    _filter_all(signals, _backwards(taps), _backwards(low[None])[0], len(low) // 2, share, result)
    return result


def add(response: Array, first: Array, taps: Array) -> None:
    """Add taps (P, M, T) from sample `first` (P, M) on; what lies outside (M, N) is left out."""
    _add(response, first, taps)


def _backwards(taps: Array) -> Array:
    """Return taps (M, T) last first, with zeros before them up to a multiple of `AT_ONCE`."""
    missing = -taps.shape[1] % AT_ONCE
    return np.ascontiguousarray(np.pad(taps[:, ::-1], [(0, 0), (missing, 0)]))


@njit(error_model="numpy", nogil=True, fastmath={"contract"})
def _filter(padded: Any, taps: Any, result: Any) -> None:
    """Write result(n) = sum over j of taps(j) padded(n + j)."""
    for start in range(0, len(result), BLOCK):
        block = result[start : start + BLOCK]
        block[:] = 0.0
        for j in range(0, len(taps), AT_ONCE):
            source = padded[start + j :]
            for n in range(len(block)):
                block[n] += (
                    taps[j] * source[n]
                    + taps[j + 1] * source[n + 1]
                    + taps[j + 2] * source[n + 2]
                    + taps[j + 3] * source[n + 3]
                )


@njit(error_model="numpy", nogil=True, fastmath={"contract"})
def _filter_all(signals: Any, taps: Any, low: Any, ahead: int, share: Any, result: Any) -> None:
    """Write the filtered signals of all microphones; see `filtered_signals`."""
    length = signals.shape[1]
    before = max(len(low), taps.shape[1])
    padded = np.zeros(length + 2 * before)
    here = padded[before : before + length]
    slow = np.empty(length)
    for m in range(len(signals)):
        here[:] = signals[m]
        # The last tap is that of the present sample, or of one a little ahead.
        _filter(padded[before + ahead + 1 - len(low) :], low, slow)
        for n in range(length):
            here[n] = slow[n] + share[n] * (here[n] - slow[n])
        _filter(padded[before + 1 - taps.shape[1] :], taps[m], result[m])


@njit(error_model="numpy", nogil=True)
def _add(response: Any, first: Any, taps: Any) -> None:
    """Add taps to a response; see `add`."""
    for p in range(taps.shape[0]):
        for m in range(taps.shape[1]):
            start = first[p, m]
            for t in range(max(0, -start), min(taps.shape[2], response.shape[1] - start)):
                response[m, start + t] += taps[p, m, t]


with suppress(RuntimeError):  # there is no place to keep it
    _filter_all.enable_caching()
    _add.enable_caching()
