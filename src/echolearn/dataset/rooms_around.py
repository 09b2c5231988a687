"""Rooms around a path that was there before: each side at a distance of its own.

The box around the path is widened by an independent margin on each of its four sides. That is the
room, or an outline is drawn in it:

    box, l_shape, five_corners     as `drawn_rooms` draws them
    door                           a box with a door of 0.9 m
    pillars                        a box with a door and two pillars

A room in which the path would come nearer than `CLEARANCE` to a wall is drawn again, each time with
margins a tenth wider. The robot is as high as some place between 35 and 65 % of the room's height.
"""

from typing import Any

import numpy as np

from echolearn.acoustics.polygon_room import AnyRoom, PolygonRoom
from echolearn.acoustics.rooms import inside, outline
from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.types import Array, Room
from echolearn.checks import BadValue
from echolearn.dataset.drawn_rooms import drawn_room

OUTLINES = {"box": 4, "l_shape": 6, "five_corners": 5, "door": 5, "pillars": 13}
"""Most sides of a room, by the name of its outline; a pillar has four, a door makes two of one."""

CLEARANCE = 0.5
"""m that the robot keeps from every wall and pillar."""

DOOR = 0.9
"""m, width of a door."""

PILLAR = (0.3, 0.6)
"""m, sides of a pillar, from and to."""

TRIES = 200
"""Rooms that are drawn around a path before it is given up."""

LONGER = 1.2
"""By how much the reverberation of a box is longer than Sabine's least, if it is drawn shorter."""


def room_around(
    path: Array,
    outline_name: str,
    *,
    margin: tuple[float, float],
    height: float,
    t60: float,
    wall_factor: tuple[float, float],
    rng: np.random.Generator,
) -> tuple[AnyRoom, Array]:
    """Draw a room around a path, and return it with the path's places in it, shape (P, 2).

    Args:
        path: places, shape (P, 2), in m.
        outline_name: one of `OUTLINES`.
        margin: range of the distance from the path to each side of the box, in m.
        height: of the room, in m.
        t60: reverberation time in s; a small room may take a longer one.
        wall_factor: range of the factor on each wall's reflection coefficient.
        rng: draws the room.

    Raises:
        BadValue: no room around the path was found.
    """
    low, high = path.min(axis=0), path.max(axis=0)
    for trial in range(TRIES):
        before, after = 1.1 ** (trial // 2) * rng.uniform(*margin, (2, 2))
        places = path - low + before
        size = np.append(high - low + before + after, height)
        least = LONGER * Room((*size.tolist(),), 10.0).shortest_t60()
        how: Any = {"t60": max(t60, least), "wall_factor": wall_factor, "rng": rng}
        room: AnyRoom | None
        if outline_name in ("door", "pillars"):
            room = _opened(size, places, pillars=2 * (outline_name == "pillars"), **how)
        else:
            room = drawn_room(outline_name, size, **how)
        if room is not None and _fits(room, places):
            return room, places
    hint = "are the path's rectangle and the margins too small for it?"
    raise BadValue(f"plan.rooms={outline_name}: no such room was found around a path; {hint}")


def _fits(room: AnyRoom, places: Array) -> bool:
    """Tell whether a path (P, 2) in m keeps its distance from everything in a room."""
    points = np.column_stack([places, np.full(len(places), 0.1)])
    sides = room.faces[0] if isinstance(room, PolygonRoom) else outline(room)
    away = distance_to_outline(places, sides)
    return bool(inside(room, points).all() and (away >= CLEARANCE).all())


def _opened(
    size: Array,
    places: Array,
    *,
    pillars: int,
    t60: float,
    wall_factor: tuple[float, float],
    rng: np.random.Generator,
) -> PolygonRoom | None:
    """Draw a box with a door and pillars; None where the path leaves no place for them.

    Args:
        size: of the box, shape (3,), in m.
        places: of the path, shape (P, 2), in m.
        pillars: how many.
        t60, wall_factor, rng: as those of `room_around`.
    """
    length, width, height = size.tolist()
    corners = ((0.0, 0.0), (length, 0.0), (length, width), (0.0, width))
    side = int(rng.integers(4))
    start = float(rng.uniform(0.3, (length, width)[side % 2] - DOOR - 0.3))
    standing = [_pillar(size, places, rng=rng) for _ in range(pillars)]
    factors = rng.uniform(*wall_factor, 6 + pillars)
    try:
        return PolygonRoom(
            corners,
            height,
            t60,
            walls=tuple(factors.tolist()),
            pillars=tuple(standing),
            doors=((side, start, start + DOOR),),
        )
    except BadValue:
        # Two pillars that touch, or too much absorption: another draw will do.
        return None


def _pillar(
    size: Array, places: Array, *, rng: np.random.Generator
) -> tuple[tuple[float, float], ...]:
    """Draw a square pillar off the walls, and off the path if a few draws allow it."""
    for _ in range(20):
        half = rng.uniform(*PILLAR) / 2.0
        middle = rng.uniform(half + 0.2, size[:2] - half - 0.2)
        if np.abs(places - middle).max(axis=1).min() >= half + CLEARANCE:
            break
    (x, y), d = middle.tolist(), float(half)
    return ((x - d, y - d), (x + d, y - d), (x + d, y + d), (x - d, y + d))
