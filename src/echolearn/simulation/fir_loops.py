"""Short filters on long responses, compiled: faster than transforms while there are few taps.

As `image_loops`, this is imported where it is called: a process that has Numba cannot be forked.
"""

from contextlib import suppress
from typing import Any

import numpy as np
from numba import njit

from echolearn.acoustics.lanes import wide
from echolearn.acoustics.types import Array

BLOCK = 512
"""Samples that stay in the processor's cache while all taps pass over them."""

AT_ONCE = 8
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


def add(response: Array, first: Array, *, taps: Array, ahead: int = 0) -> None:
    """Add taps (P, M, T) from sample `first` (P, M) on; what lies outside (M, N) is left out.

    Args:
        response: is changed, shape (M, N).
        first: sample of each arrival's tap 0.
        taps: shape (P, M, T).
        ahead: how many of the last taps come before tap 0.
    """
    _add(response, first, taps, ahead)


def subtract_pulses(
    response: Array, first: Array, *, table: Array, place: Array, gain: Array
) -> None:
    """Take pulses out of a response; they are read from a table, linearly between its rows.

    Args:
        response: is changed, shape (M, N).
        first: sample at which each begins, shape (P, M).
        table: shape (R + 1, T).
        place: row of each pulse, fractional, shape (P, M).
        gain: of each, shape (P, M).
    """
    _subtract(response, first, table, place, gain)


def changed_spectra(
    table: Array,
    place: Array,
    *,
    gain: Array,
    low: Array,
    highs: Array,
    clusters: Array,
    microphones: Array,
) -> Array:
    """Return gain pulse (low + highs (1 - low)) cluster microphone, shape (P, M, F).

    Args:
        table: spectra of pulses, shape (R + 1, F).
        place: row of each pulse, fractional, shape (P, M).
        gain: shape (P, M).
        low: shape (F,).
        highs: shape (P, M).
        clusters: shape (P, F).
        microphones: shape (M, F).
    """
    spectra = np.empty((*place.shape, len(low)), dtype=complex)
    _change(table, place, gain, (low, highs, clusters, microphones), spectra)
    return spectra


def _backwards(taps: Array) -> Array:
    """Return taps (M, T) last first, with zeros before them up to a multiple of `AT_ONCE`."""
    missing = -taps.shape[1] % AT_ONCE
    padded = np.zeros((len(taps), missing + taps.shape[1]))
    padded[:, missing:] = taps[:, ::-1]
    return padded


@njit(error_model="numpy", nogil=True, fastmath={"contract"})
def _filter(padded: Any, taps: Any, result: Any) -> None:
    """Write result(n) = sum over j of taps(j) padded(n + j)."""
    wide()  # type: ignore[call-arg]
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
                    + taps[j + 4] * source[n + 4]
                    + taps[j + 5] * source[n + 5]
                    + taps[j + 6] * source[n + 6]
                    + taps[j + 7] * source[n + 7]
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
        # Number by number: a slice that is assigned takes seconds to compile.
        for n in range(length):
            here[n] = signals[m, n]
        # The last tap is that of the present sample, or of one a little ahead.
        _filter(padded[before + ahead + 1 - len(low) :], low, slow)
        for n in range(length):
            here[n] = slow[n] + share[n] * (here[n] - slow[n])
        _filter(padded[before + 1 - taps.shape[1] :], taps[m], result[m])


@njit(error_model="numpy", nogil=True)
def _add(response: Any, first: Any, taps: Any, ahead: Any) -> None:
    """Add taps to a response; see `add`."""
    length = taps.shape[2]
    for p in range(taps.shape[0]):
        for m in range(taps.shape[1]):
            start = first[p, m] - ahead
            for t in range(max(0, -start), min(length, response.shape[1] - start)):
                response[m, start + t] += taps[
                    p, m, t - ahead if t >= ahead else t - ahead + length
                ]


@njit(error_model="numpy", nogil=True)
def _subtract(response: Any, first: Any, table: Any, place: Any, gain: Any) -> None:
    """Take pulses out of a response; see `subtract_pulses`."""
    for p in range(place.shape[0]):
        for m in range(place.shape[1]):
            row = int(place[p, m])
            after = gain[p, m] * (place[p, m] - row)
            before = gain[p, m] - after
            start = first[p, m]
            for t in range(max(0, -start), min(table.shape[1], response.shape[1] - start)):
                pulse = table[row + 1, t] * after + table[row, t] * before
                response[m, start + t] -= pulse


@njit(error_model="numpy", nogil=True)
def _change(table: Any, place: Any, gain: Any, filters: Any, spectra: Any) -> None:
    """Write changed spectra; see `changed_spectra`."""
    low, highs, clusters, microphones = filters
    for p in range(place.shape[0]):
        for m in range(place.shape[1]):
            row = int(place[p, m])
            after = gain[p, m] * (place[p, m] - row)
            before = gain[p, m] - after
            for f in range(len(low)):
                pulse = table[row + 1, f] * after + table[row, f] * before
                share = low[f] + highs[p, m] * (1.0 - low[f])
                spectra[p, m, f] = pulse * share * (clusters[p, f] * microphones[m, f])


with suppress(RuntimeError):  # there is no place to keep it
    _filter_all.enable_caching()
    _add.enable_caching()
    _subtract.enable_caching()
    _change.enable_caching()
