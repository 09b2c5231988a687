"""Rooms that `ScatteredPlan` draws, of one outline or another, and a place in one of them.

    box            the four sides of a box
    l_shape        a box without one of its corners, of each side 30 to 50 %
    five_corners   corners on the ellipse that touches the sides of a box, a fifth of a turn from
                   one another and up to 0.15 rad off: no two walls are parallel

In each the place is uniform where it is at least the margin from every wall, floor and ceiling
among them. Of the shorter side a margin of 25 % leaves some such places, whatever is drawn.
"""

import numpy as np

from echolearn.acoustics.polygon_room import AnyRoom, PolygonRoom
from echolearn.acoustics.rooms import bounds, inside
from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.types import Array, Room

ECHOES = {"box": 6, "l_shape": 8, "five_corners": 7}
"""Most first-order echoes of a room, by the name of its outline: its walls, floor and ceiling."""

ROOMY = 0.25
"""Share of the shorter side of the floor that a margin may be, in rooms that are no boxes."""

CUT = (0.3, 0.5)
"""Share of each side that the missing corner of an L takes, from and to."""

OFF = 0.15
"""rad by which a corner may be off a fifth of a turn from the others."""


def drawn_room(
    outline: str,
    size: Array,
    *,
    t60: float,
    wall_factor: tuple[float, float],
    rng: np.random.Generator,
) -> AnyRoom:
    """Draw a room.

    Args:
        outline: one of `ECHOES`.
        size: of the box around it, shape (3,), in m.
        t60: reverberation time in s.
        wall_factor: range of the factor on each wall's reflection coefficient.
        rng: draws it.
    """
    if outline == "box":
        return Room(tuple(size.tolist()), t60, tuple(rng.uniform(*wall_factor, 6).tolist()))
    draw = {"l_shape": _l_shape, "five_corners": _five_corners}[outline]
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
