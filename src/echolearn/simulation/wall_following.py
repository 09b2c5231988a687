"""A walk through a room of any outline: along all its walls, then around its middle.

With d(x) the distance to the nearest wall, pillar or door, the robot follows a contour of d as a
wall follower does, walls to its right: a step along the tangent, then back onto the contour. The
tangent is that at the step's end, so an inner corner is turned where the next wall comes near. From
the outer contour, at `CLEARANCE`, it weaves inward wherever there is room, and no wall keeps one
distance. Then it crosses to the contour halfway between there and the deepest place of the room,
where the two come nearest to each other: no wall is in between.
"""

import math

import numpy as np

from echolearn.acoustics.polygon_room import PolygonRoom
from echolearn.acoustics.sides import encloses, twice_area
from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check

STEP = 0.05
"""m, along a contour."""

LONGEST = 20_000
"""Steps of a contour, a kilometre."""


def followed(
    room: PolygonRoom, *, start: float, clearance: float, weave: float, swings: float
) -> Array:
    """Return the path as a dense polyline, shape (any, 2), in m.

    Args:
        room: with walls and pillars.
        start: direction in which the walk begins, seen from the deepest place, in rad.
        clearance: distance from all walls that is kept, in m.
        weave: how far the path swings away from that, in m.
        swings: on the way around.

    Raises:
        BadValue: no place is far enough from all walls.
    """
    sides, _ = room.faces
    deepest, depth = _deepest(sides)
    least = clearance + weave / 2
    allowed = f"must leave a place at least {least:g} m from all walls, for a walk"
    check(depth >= least, "room.corners", f"{depth:.2f} m", allowed=allowed)

    outer = _around(sides, deepest, level=clearance, start=start)
    inner = _around(sides, deepest, level=(clearance + depth) / 2, start=start)
    woven = _woven(outer, sides, clearance=clearance, weave=weave, swings=swings)

    # Once around, on to where the inner contour is nearest, and once around that.
    away = np.linalg.norm(outer[:, None] - inner, axis=-1)
    leave, enter = np.unravel_index(away.argmin(), away.shape)
    path = np.concatenate([woven, outer[: leave + 1], np.roll(inner, -enter, axis=0)])
    apart = np.linalg.norm(np.diff(path, axis=0), axis=1) > 1e-9
    return path[np.append(True, apart)]


def _nearest(place: Array, sides: Array) -> tuple[float, Array]:
    """Return how far a place (2,) is from the nearest side, in m, and in which direction."""
    edge = sides[:, 1] - sides[:, 0]
    along = ((place - sides[:, 0]) * edge).sum(axis=1) / (edge**2).sum(axis=1)
    offset = place - sides[:, 0] - np.clip(along, 0.0, 1.0)[:, None] * edge
    distance = np.hypot(offset[:, 0], offset[:, 1])
    first = int(distance.argmin())
    return float(distance[first]), offset[first] / distance[first]


def _deepest(sides: Array) -> tuple[Array, float]:
    """Return the place farthest from all sides, of a grid, and its distance in m."""
    low, high = sides.min(axis=(0, 1)), sides.max(axis=(0, 1))
    axes = [np.linspace(*ends, 80)[1:-1] for ends in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    places = grid[encloses(sides, grid)]
    distances = [_nearest(place, sides)[0] for place in places]
    best = int(np.argmax(distances))
    return places[best], distances[best]


def _around(sides: Array, deepest: Array, *, level: float, start: float) -> Array:
    """Return the outer contour of a distance in m, from a direction in rad on, shape (any, 2).

    Raises:
        BadValue: it does not close, as where a passage is just as narrow as the distance asks for.
    """
    for quarter in range(4):
        angle = start + quarter * math.pi / 2
        place = deepest
        toward = np.array([math.cos(angle), math.sin(angle)])
        # Nobody is nearer to a wall than the distance that is left.
        for _ in range(1000):
            place = place + max(_nearest(place, sides)[0] - level, 0.0) * toward
        contour = _contour(sides, place, level=level)
        # The contour around a pillar runs clockwise, and is not what leads along the walls.
        if len(contour) > 2 and twice_area(contour) > 0:
            return contour
    raise BadValue(f"room.corners: no way leads around {level:.2f} m from all walls")


def _contour(sides: Array, first: Array, *, level: float) -> Array:
    """Follow a contour of the distance from a place on it until it closes; empty if it does not."""
    places = [first]
    for step in range(LONGEST):
        here = places[-1]
        trial = here + STEP * _ahead(_nearest(here, sides)[1])
        there = here + STEP * _ahead(_nearest(trial, sides)[1])
        # Around a corner of the wall the contour bends, so one step back onto it is not enough.
        for _ in range(3):
            distance, away = _nearest(there, sides)
            there = there + (level - distance) * away
        # It begins near its beginning, too.
        if step > 3 and np.linalg.norm(there - first) < STEP:
            return np.array(places)
        places.append(there)
    return np.empty((0, 2))


def _ahead(away: Array) -> Array:
    """Return the direction in which a wall lies to the right."""
    return np.array([away[1], -away[0]])


def _woven(contour: Array, sides: Array, *, clearance: float, weave: float, swings: float) -> Array:
    """Move a contour inward and back, where no other wall is near.

    Args:
        contour: shape (P, 2), in m.
        sides: of the room, shape (S, 2, 2), in m.
        clearance: distance from all walls that is kept, in m.
        weave: how far inward, in m.
        swings: on the way around.
    """
    woven = []
    for place, turn in zip(contour, np.linspace(0.0, 1.0, len(contour)), strict=True):
        _, away = _nearest(place, sides)
        # Halved until no other wall is nearer than the path's own; a centimetre is no way aside.
        inward = weave * math.sin(math.pi * swings * turn) ** 2
        while inward > 0.01 and _nearest(place + inward * away, sides)[0] < clearance - 0.01:
            inward /= 2
        woven.append(place + inward * away)
    return np.array(woven)
