"""Marks of lost samples: runs of equal ones, and stretches that come twice, which no sound does."""

import numpy as np

from echolearn.acoustics.types import Array

LOST = 32
"""Samples in a row that are equal, or exactly as others before, which no sound is."""

ANY_ODD = np.uint64(0x9E3779B97F4A7C15)
FOLLOWING = 8
COMPARED = 256
"""A factor that spreads the bits of samples; samples that are compared first; pairs of places that
are looked at."""


def still(channel: Array) -> int:
    """Return the longest run of equal samples between loud ones of a channel (N,).

    Exact zeros, or what an offset or a recorder that holds its last sample makes of them. Silence
    before the first sound, after the last, or where sound fades is no loss; rails are clipping.
    """
    same = channel[1:] == channel[:-1]
    if np.count_nonzero(same) < LOST - 1:
        return 0
    silent = np.append(same, False) | np.append(False, same)
    silent &= (channel > channel.min()) & (channel < channel.max())
    if silent[:LOST].all() or silent[-LOST:].all():
        return 0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], silent, [False]]).astype(int)))
    starts = edges[::2]
    ends = edges[1::2]
    loud = 0.3 * channel.std()
    runs = [
        end - start
        for start, end in zip(starts, ends, strict=True)
        if end - start >= LOST
        and min(_level(channel[max(start - LOST, 0) : start]), _level(channel[end : end + LOST]))
        > loud
    ]
    return int(max(runs, default=0))


def _level(samples: Array) -> float:
    return float(np.sqrt(np.mean(samples**2))) if len(samples) else 0.0


def repeated_alone(samples: Array) -> int:
    """Return the longest stretch of one of (M, N) that is exactly as one before it, 0 if short.

    Devices of their own have buffers of their own. One sample in 32 or so, chosen by its value, is
    compared with others like it by those that follow.
    """
    bits = np.ascontiguousarray(samples).view(np.uint64)
    chosen = (bits * ANY_ODD >> np.uint64(59) == 0) & (bits != 0)
    chosen[:, -FOLLOWING:] = False
    flat = np.flatnonzero(chosen)
    rows, places = np.divmod(flat, samples.shape[-1])
    near = samples.ravel()[flat[:, None] + np.arange(FOLLOWING)]
    changing = (near != near[:, :1]).any(axis=1)
    # A number that equal ones of one channel share: samples by any factors, summed in one order.
    marks = rows * np.pi
    for factor, sample in zip(np.sqrt(np.arange(2, 2 + FOLLOWING)), near.T, strict=True):
        marks += factor * sample
    order = np.argsort(marks, kind="stable")
    order = order[changing[order]]
    twice = np.flatnonzero(np.diff(marks[order]) == 0)[:COMPARED]
    pairs = zip(order[twice].tolist(), order[twice + 1].tolist(), strict=True)
    found = [_as_before(samples[rows[i]], int(places[i]), second=int(places[j])) for i, j in pairs]
    longest = max(found, default=0)
    return longest if longest >= LOST else 0


def _as_before(channel: Array, first: int, *, second: int) -> int:
    """Return how many samples around two places of a channel (N,) are equal, in a row."""
    count = len(channel) - second
    after = channel[first : first + count] != channel[second:]
    before = channel[:first][::-1] != channel[second - first : second][::-1]
    # An end of the recording ends the stretch, too.
    return sum(int(np.append(each, True).argmax()) for each in (after, before))


def repeated(samples: Array) -> int:
    """Return the longest stretch of (M, N) that is exactly as one before it, 0 if below `LOST`."""
    # One number for all channels of a sample: equal samples have equal numbers.
    keys = np.random.default_rng(0).integers(1, 1 << 62, len(samples), dtype=np.uint64)
    bits = np.ascontiguousarray(samples).view(np.uint64)
    marks = (bits * (keys[:, None] | np.uint64(1))).sum(axis=0, dtype=np.uint64)
    ordered = np.sort(marks)
    # Most recordings hold no two equal samples, which is known sooner than where they are.
    if np.count_nonzero(ordered[1:] == ordered[:-1]) < LOST:
        return 0
    order = np.argsort(marks, kind="stable")
    same = marks[order][1:] == marks[order][:-1]
    before = np.zeros(len(marks), dtype=int)
    before[order[1:][same]] = order[1:][same] - order[:-1][same]
    # A sound that stands still repeats its last sample; a block comes back as a whole.
    before[before <= 1] = 0
    edges = np.flatnonzero(np.diff(before, prepend=0, append=0))
    lengths = np.diff(edges)
    inside = before[edges[:-1]] > 0 if len(edges) else np.zeros(0, dtype=bool)
    longest = int(lengths[inside].max(initial=0))
    return longest if longest >= LOST else 0
