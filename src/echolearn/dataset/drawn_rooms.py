"""Rooms that plans draw, of one outline or another: with a place in them, or around a path.

    box            the four sides of a box
    l_shape        a box without one of its corners, of each side 30 to 50 %
    five_corners   corners on the ellipse that touches the sides of a box, a fifth of a turn from
                   one another and up to 0.15 rad off: no two walls are parallel

In each the place is uniform where it is at least the margin from every wall, floor and ceiling
among them. Of the shorter side a margin of 25 % leaves some such places, whatever is drawn.

*Around a path* that was there before, each side is at a distance of its own. The box around the
path is widened by an independent margin on each of its four sides. That is the room, or an outline
is drawn in it, of those above or

    door           a box with a door of 0.9 m
    pillars        a box with a door and two pillars

A room in which the path would come nearer than `CLEARANCE` to a wall is drawn again, with margins a
tenth wider at every other time.
"""

from typing import Any

import numpy as np

from echolearn.acoustics.polygon_room import AnyRoom, PolygonRoom
from echolearn.acoustics.rooms import bounds, inside, outline
from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.types import Array, Room
from echolearn.checks import BadValue

ECHOES = {"box": 6, "l_shape": 8, "five_corners": 7}
"""Most first-order echoes of a room, by the name of its outline: its walls, floor and ceiling."""

ROOMY = 0.25
"""Share of the shorter side of the floor that a margin may be, in rooms that are no boxes."""

CUT = (0.3, 0.5)
"""Share of each side that the missing corner of an L takes, from and to."""

OFF = 0.15
"""rad by which a corner may be off a fifth of a turn from the others."""

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


def drawn_room(
    outline_name: str,
    size: Array,
    *,
    t60: float,
    wall_factor: tuple[float, float],
    rng: np.random.Generator,
) -> AnyRoom:
    """Draw a room.

    Args:
        outline_name: one of `ECHOES`.
        size: of the box around it, shape (3,), in m.
        t60: reverberation time in s.
        wall_factor: range of the factor on each wall's reflection coefficient.
        rng: draws it.
    """
    if outline_name == "box":
        return Room(tuple(size.tolist()), t60, tuple(rng.uniform(*wall_factor, 6).tolist()))
    draw = {"l_shape": _l_shape, "five_corners": _five_corners}[outline_name]
    corners = size[:2] * draw(rng)
    factors = rng.uniform(*wall_factor, len(corners) + 2)
    points = tuple((float(x), float(y)) for x, y in corners)
    return PolygonRoom(points, float(size[2]), t60, tuple(factors.tolist()))


def _l_shape(rng: np.random.Generator) -> Array:
    """Return the corners of an L in a square of side 1, shape (6, 2)."""
    x, y = 1.0 - rng.uniform(*CUT, 2)
    corners = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, y], [x, y], [x, 1.0], [0.0, 1.0]])
    # Any of the four corners may be the one that is missing.
    mirrored: Array = np.where(rng.integers(2, size=2) == 1, 1.0 - corners, corners)
    return mirrored


def _five_corners(rng: np.random.Generator) -> Array:
    """Return five corners on the circle in a square of side 1, shape (5, 2)."""
    turn = 0.4 * np.pi * np.arange(5) + rng.uniform(0.0, 2.0 * np.pi) + rng.uniform(-OFF, OFF, 5)
    return 0.5 + 0.5 * np.stack([np.cos(turn), np.sin(turn)], axis=1)


def drawn_place(room: AnyRoom, margin: float, *, rng: np.random.Generator) -> Array:
    """Draw a place in a room, shape (3,), in m.

    Args:
        room: with its walls.
        margin: least distance from every wall, in m; there must be such a place.
        rng: draws, as often as places fall outside.
    """
    low, high = bounds(room)
    while True:
        place: Array = rng.uniform(low + margin, high - margin)
        if isinstance(room, Room):
            return place
        away = float(distance_to_outline(place[:2], room.faces[0]))
        if away >= margin and inside(room, place[None])[0]:
            return place


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
