"""Sides on the floor plan: outlines, pillars and gaps, and the first echoes that they send back.

Sides have shape (S, 2, 2): S lines in m, each from its start to its end, such as the four of a
shoebox, or those of an outline with pillars and doors. The first echo of a side seems to come from
the mirror image of its source,

    image = source - 2 h n,     h = (source - start) . n,     n the side's normal,

and is heard where the line from the image meets the side between its ends, and no other side stands
in its way. As walls are upright, the plan alone decides that.
"""

import numpy as np

from echolearn.acoustics.types import Array

BLOCK = 4096
"""Lines that are held against all sides at a time."""


def closed(corners: Array) -> Array:
    """Return the sides of a polygon with corners (C, 2), shape (C, 2, 2)."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def twice_area(corners: Array) -> float:
    """Return twice the area of a polygon (C, 2) in m^2, negative if it runs clockwise."""
    # From the first corner, lest a room far from the origin lose digits.
    x, y = (corners - corners[0]).T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def polylines(sides: Array) -> list[Array]:
    """Join sides that follow each other to lines (P, 2); a closed one repeats its first corner."""
    apart = (sides[1:, 0] != sides[:-1, 1]).any(axis=1)
    runs = np.split(sides, np.flatnonzero(apart) + 1)
    return [np.concatenate([run[:, 0], run[-1:, 1]]) for run in runs if len(run)]


def distance_to_outline(points: Array, sides: Array) -> Array:
    """Return the distance of points (..., 2) to the nearest of sides (S, 2, 2), in m."""
    edge = sides[:, 1] - sides[:, 0]
    offset = np.asarray(points)[..., None, :] - sides[:, 0]
    along = np.clip((offset * edge).sum(-1) / (edge**2).sum(-1), 0.0, 1.0)
    return np.linalg.norm(offset - along[..., None] * edge, axis=-1).min(axis=-1)


def encloses(sides: Array, points: Array) -> Array:
    """Tell which points (P, 2) lie within closed sides: a ray from there crosses an odd number."""
    start, end = np.moveaxis(sides, 1, 0)
    x, y = points[:, None, 0], points[:, None, 1]
    spans = (start[:, 1] > y) != (end[:, 1] > y)
    rise = np.where(end[:, 1] == start[:, 1], 1.0, end[:, 1] - start[:, 1])
    crossing = start[:, 0] + (y - start[:, 1]) / rise * (end[:, 0] - start[:, 0])
    odd: Array = (spans & (x < crossing)).sum(axis=1) % 2 == 1
    return odd


def crosses(lines: Array, sides: Array) -> Array:
    """Tell which lines (K, 2, 2) cross which sides (S, 2, 2), shape (K, S)."""
    start, end = lines[:, None, 0], lines[:, None, 1]
    apart = _left_of(start, end, sides[:, 0]) != _left_of(start, end, sides[:, 1])
    through = _left_of(sides[:, 0], sides[:, 1], start) != _left_of(sides[:, 0], sides[:, 1], end)
    return apart & through


def _left_of(start: Array, end: Array, point: Array) -> Array:
    """Tell whether points lie to the left of whoever goes from start to end."""
    ahead = end - start
    toward = point - start
    left: Array = ahead[..., 0] * toward[..., 1] > ahead[..., 1] * toward[..., 0]
    return left


def mirror_images(sides: Array, source: Array) -> Array:
    """Return the mirror images of a point (2,) in the lines of sides, shape (S, 2), in m."""
    edge = sides[:, 1] - sides[:, 0]
    normal = np.stack([-edge[:, 1], edge[:, 0]], axis=-1)
    normal /= np.linalg.norm(edge, axis=1)[:, None]
    height = np.sum((source - sides[:, 0]) * normal, axis=-1)
    return source - 2.0 * height[:, None] * normal


def first_echoes(sides: Array, source: Array, *, microphones: Array) -> Array:
    """Return the ways of first echoes, shape (M, S), in m; NaN where a side sends none back.

    Args:
        sides: of the plan, shape (S, 2, 2), in m.
        source: shape (3,), in m.
        microphones: shape (M, 3), in m.
    """
    along = sides[:, 1] - sides[:, 0]
    length = np.linalg.norm(along, axis=1)
    along = along / length[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=-1)

    # Of each side's line: distances from it, and places along it from its start.
    here = np.sum((source[:2] - sides[:, 0]) * across, axis=-1)
    start = np.sum((source[:2] - sides[:, 0]) * along, axis=-1)
    offset = microphones[:, :2] - source[:2]
    there = here + offset @ across.T
    beside = offset @ along.T
    up = (microphones[:, 2] - source[2])[:, None]
    way = np.sqrt((here + there) ** 2 + beside**2 + up**2)

    # The sound moves along the side in the ratio of the distances before and after it.
    heard = here * there > 0
    place = start + beside * here / np.where(heard, here + there, 1.0)
    heard &= (place >= 0) & (place <= length)
    m, s = np.nonzero(heard)
    met = sides[s, 0] + place[m, s, None] * along[s]
    before = blocked(source[:2], met, side=s, sides=sides)
    heard[m, s] = ~(before | blocked(microphones[m, :2], met, side=s, sides=sides))
    return np.where(heard, way, np.nan)


def blocked(place: Array, met: Array, *, side: Array, sides: Array) -> Array:
    """Tell where another side stands between places and points of sides, shape (K,).

    Args:
        place: shape (K, 2) or (2,), in m.
        met: points on sides, shape (K, 2), in m.
        side: their numbers, shape (K,).
        sides: shape (S, 2, 2), in m.
    """
    lines = np.stack([np.broadcast_to(place, met.shape), met], axis=1)
    found = np.zeros(len(lines), dtype=bool)
    # Some at a time: a long walk past a stranger's thousand sides would not fit into memory.
    for start in range(0, len(lines), BLOCK):
        part = slice(start, start + BLOCK)
        crossed = crosses(lines[part], sides)
        crossed[np.arange(len(crossed)), side[part]] = False
        found[part] = crossed.any(axis=1)
    return found
