"""The compiled half of `beams`: the beams of one order of reflection, split where they meet sides.

A beam is what an image of the source sends through the part of a side that sends it back, its
aperture from p to q, anticlockwise as seen from the image I. A point X of the plan has in it

    depth = n . (X - I) / n . (p - I),   n normal to q - p,
    along = depth * place,   place = where the ray from I to X passes from p to q, 0 to 1,

both linear in X. What the beam meets has a depth over 1 and a place between 0 and 1; comparing
places and depths needs no angle, and rarely a division. Sides do not cross, so between the places
of neighbouring ends one side is the nearest: the beam is split exactly, and no part of the plan is
looked at that its sound does not reach (Heckbert and Hanrahan 1984, in two dimensions).

Numba keeps the machine code as it does that of `image_loops`.
"""

from contextlib import suppress
from typing import Any

import numpy as np
from numba import njit

THIN = 1e-12
"""Share of a beam, and length of an aperture in m, below which nobody stands in it."""


@njit(error_model="numpy", nogil=True)
def _project(beam: Any, points: Any, seen: Any) -> None:
    """Write depth and along of points (K, 2) in a beam (8,), shape (K, 2)."""
    start_x = beam[2] - beam[0]
    start_y = beam[3] - beam[1]
    ahead_x = beam[4] - beam[2]
    ahead_y = beam[5] - beam[3]
    scale = 1.0 / (ahead_x * start_y - ahead_y * start_x)
    for k in range(len(points)):
        x = points[k, 0] - beam[0]
        y = points[k, 1] - beam[1]
        seen[k, 0] = scale * (ahead_x * y - ahead_y * x)
        seen[k, 1] = scale * (x * start_y - y * start_x)


@njit(error_model="numpy", nogil=True)
def _met(side_before: int, ends: Any, seen: Any, found: Any) -> tuple[int, bool]:
    """Write the sides that a beam may meet, a row each: depth, along of both ends, side.

    Args:
        side_before: number of the side from which the beam comes.
        ends: corners where each side starts and ends, shape (F, 2).
        seen: depth and along of the corners, shape (C, 2).
        found: rows to be written, shape (F, 5).

    Returns:
        Their number, and whether one of them ends within the beam.
    """
    count = 0
    divided = False
    for side in range(len(ends)):
        near = seen[ends[side, 0], 0]
        first = seen[ends[side, 0], 1]
        far = seen[ends[side, 1], 0]
        last = seen[ends[side, 1], 1]
        # From its back nobody sees a side without seeing another before it.
        if side == side_before or (near <= 1.0 and far <= 1.0) or last * near <= first * far:
            continue
        # What lies before the aperture is on the other side of a wall.
        if near < 1.0:
            first += (1.0 - near) / (far - near) * (last - first)
            near = 1.0
        if far < 1.0:
            last += (1.0 - far) / (near - far) * (first - last)
            far = 1.0
        if last <= 0.0 or first >= near:
            continue
        divided |= first > 0.0 or last < far
        found[count, 0] = near
        found[count, 1] = first
        found[count, 2] = far
        found[count, 3] = last
        found[count, 4] = side
        count += 1
    return count, divided


@njit(error_model="numpy", nogil=True)
def _depth(found: Any, row: int, place: float) -> float:
    """Return the depth of the line of a side at a place."""
    left = found[row, 1] - place * found[row, 0]
    right = found[row, 3] - place * found[row, 2]
    depth: float = found[row, 0] + left / (left - right) * (found[row, 2] - found[row, 0])
    return depth


@njit(error_model="numpy", nogil=True)
def _nearest(found: Any, count: int, place: float) -> int:
    """Return the row of the side that a beam meets first at a place, or -1."""
    best = -1
    least = np.inf
    for row in range(count):
        starts_before = found[row, 1] <= place * found[row, 0]
        if starts_before and found[row, 3] >= place * found[row, 2]:
            depth = _depth(found, row, place)
            if depth < least:
                least = depth
                best = row
    return best


@njit(error_model="numpy", nogil=True)
def _split(found: Any, count: int, divided: bool, parts: Any) -> int:
    """Write the parts of a beam, a row each: first and last place, row of the side that is met.

    Args:
        found: sides that the beam may meet, see `_met`.
        count: their number.
        divided: whether one of them ends within the beam.
        parts: rows to be written, shape (at least 2 count + 2, 4); the last column is scratch.

    Returns:
        Their number.
    """
    ends = parts[:2, 3]
    ends[0] = 0.0
    ends[1] = 1.0
    if divided:
        ends = parts[: 2 * count + 2, 3]
        for row in range(count):
            ends[2 * row + 2] = min(max(found[row, 1] / found[row, 0], 0.0), 1.0)
            ends[2 * row + 3] = min(max(found[row, 3] / found[row, 2], 0.0), 1.0)
        ends.sort()
    made = 0
    for k in range(len(ends) - 1):
        row = _nearest(found, count, 0.5 * (ends[k] + ends[k + 1]))
        if ends[k + 1] - ends[k] <= THIN or row < 0:
            continue
        if made and parts[made - 1, 2] == row:
            parts[made - 1, 1] = ends[k + 1]
            continue
        parts[made, 0] = ends[k]
        parts[made, 1] = ends[k + 1]
        parts[made, 2] = row
        made += 1
    return made


@njit(error_model="numpy", nogil=True)
def _is_heard(depth: float, along: float, cut: tuple[Any, Any, int]) -> bool:
    """Tell whether who stands at a depth is in a beam, before the side that it meets there."""
    found, parts, count = cut
    if depth < 1.0 or along < 0.0 or along >= depth:
        return False
    place = along / depth
    for k in range(count):
        # Of neighbouring parts one alone has the place between them.
        if parts[k, 0] <= place < parts[k, 1]:
            return bool(depth <= _depth(found, int(parts[k, 2]), place))
    return False


@njit(error_model="numpy", nogil=True)
def _hear(beam: Any, cut: Any, microphones: Any, seen: Any, heard: Any) -> int:
    """Write what microphones hear of a beam, a row each: microphone, square distance, gain.

    Args:
        beam: shape (8,).
        cut: sides that it may meet, see `_met`, its parts, see `_split`, and their number.
        microphones: shape (M, 2), in m.
        seen: their depth and along, shape (M, 2).
        heard: rows to be written, shape (at least M, 3).

    Returns:
        Number of those that hear it.
    """
    told = 0
    for m in range(len(microphones)):
        if _is_heard(seen[m, 0], seen[m, 1], cut):
            away_x = microphones[m, 0] - beam[0]
            away_y = microphones[m, 1] - beam[1]
            heard[told, 0] = m
            heard[told, 1] = away_x * away_x + away_y * away_y
            heard[told, 2] = beam[6]
            told += 1
    return told


@njit(error_model="numpy", nogil=True)
def _turn(beam: Any, cut: Any, k: int, after: Any) -> bool:
    """Write the aperture of the beam that part k gives rise to; tell whether it has a width."""
    found, parts, _ = cut
    for end in range(2):
        # It runs the other way round: what was first is last in a mirror.
        place = parts[k, 1 - end]
        depth = _depth(found, int(parts[k, 2]), place)
        for axis in range(2):
            passed = beam[2 + axis] + place * (beam[4 + axis] - beam[2 + axis])
            after[2 + 2 * end + axis] = beam[axis] + depth * (passed - beam[axis])
    wide = (after[4] - after[2]) ** 2 + (after[5] - after[3]) ** 2
    return bool(wide > THIN * THIN)


@njit(error_model="numpy", nogil=True)
def _mirror(beam: Any, side: Any, after: Any) -> float:
    """Write the mirror image of a beam's image; return its square distance from the new aperture.

    Args:
        beam: shape (8,).
        side: the mirror, shape (2, 2), in m.
        after: the next beam, shape (8,), of which p and q are there.
    """
    ahead_x = side[1, 0] - side[0, 0]
    ahead_y = side[1, 1] - side[0, 1]
    height = ahead_x * (beam[1] - side[0, 1]) - ahead_y * (beam[0] - side[0, 0])
    height *= 2.0 / (ahead_x * ahead_x + ahead_y * ahead_y)
    after[0] = beam[0] + height * ahead_y
    after[1] = beam[1] - height * ahead_x

    # Nothing of it is nearer than the nearest point of its aperture.
    wide_x = after[4] - after[2]
    wide_y = after[5] - after[3]
    to_x = after[0] - after[2]
    to_y = after[1] - after[3]
    along = (to_x * wide_x + to_y * wide_y) / (wide_x * wide_x + wide_y * wide_y)
    along = min(max(along, 0.0), 1.0)
    square: float = (to_x - along * wide_x) ** 2 + (to_y - along * wide_y) ** 2
    return square


@njit(error_model="numpy", nogil=True)
def _reflect(beam: Any, cut: Any, plan: Any, limits: tuple[float, float], after: Any) -> int:
    """Write the beams that sides send back of one.

    Args:
        beam: shape (8,).
        cut: as that of `_hear`.
        plan: sides (F, 2, 2) and their gains (F,).
        limits: reach and least gain, see `trace`.
        after: rows to be written, shape (at least as many as there are parts, 8).

    Returns:
        Their number.
    """
    sides, gains = plan
    reach, faint = limits
    found, parts, count = cut
    made = 0
    for k in range(count):
        side = int(found[int(parts[k, 2]), 4])
        gain = beam[6] * gains[side]
        if gain < faint or not _turn(beam, cut, k, after[made]):
            continue
        if _mirror(beam, sides[side], after[made]) <= reach * reach:
            after[made, 6] = gain
            after[made, 7] = side
            made += 1
    return made


@njit(error_model="numpy", nogil=True)
def trace(
    beams: Any, plan: tuple[Any, Any, Any], *, gains: Any, microphones: Any, limits: Any
) -> tuple[Any, Any]:
    """Follow all beams of one order to the sides that they meet.

    Args:
        beams: shape (B, 8): image, p, q (2 each, in m), gain, number of the side it comes from.
        plan: sides with the room to their left, shape (F, 2, 2); corners, shape (C, 2), in m; which
            of them are the ends of each side, shape (F, 2).
        gains: reflection coefficients of the sides, shape (F,).
        microphones: shape (M, 2), in m.
        limits: distance in m beyond which nothing is heard, gain below which nothing is followed.

    Returns:
        Beams of the next order, shape (any, 8), and what is heard of these, see `_hear`.
    """
    sides, corners, ends = plan
    points = np.concatenate((corners, microphones))
    seen = np.empty((len(points), 2))
    stands = seen[len(corners) :]
    found = np.empty((len(sides), 5))
    parts = np.empty((2 * len(sides) + 2, 4))
    after = np.empty((2 * len(beams) + len(parts), 8))
    heard = np.empty((2 * len(beams) + len(microphones), 3))
    made = 0
    told = 0
    for b in range(len(beams)):
        beam = beams[b]
        # Rows of these are written below, without a look at how many there are.
        if told + len(microphones) > len(heard):
            heard = np.concatenate((heard, np.empty_like(heard)))
        if made + len(parts) > len(after):
            after = np.concatenate((after, np.empty_like(after)))
        _project(beam, points, seen)
        met, divided = _met(int(beam[7]), ends, seen, found)
        cut = (found, parts, _split(found, met, divided, parts))
        told += _hear(beam, cut, microphones, stands, heard[told:])
        made += _reflect(beam, cut, (sides, gains), limits, after[made:])
    return after[:made], heard[:told]


with suppress(RuntimeError):  # there is no place to keep it
    trace.enable_caching()
