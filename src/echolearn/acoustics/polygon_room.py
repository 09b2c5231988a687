"""A room of any outline: upright walls over a polygon, pillars, doors, floor and ceiling.

Sabine's formula turns the reverberation time into one absorption for all surfaces, as in a shoebox:

    a = 24 ln(10) V / (c S T60),   V = area height,   S = 2 area + perimeter height,

the area that of the outline without the pillars', the perimeter that of both. A door is an opening
from floor to ceiling: what meets it leaves the room, and T60 is that of the room with doors shut.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from echolearn.acoustics.sides import closed, crosses, distance_to_outline, encloses, twice_area
from echolearn.acoustics.types import SPEED_OF_SOUND, Array, Room, check_t60, reflections
from echolearn.checks import check, check_list, check_metres, check_number, check_whole

GAP = 0.01
"""m; least distance of a corner from sides that do not end there, and least width of a door."""

DOOR = -1
"""Number that stands for the wall of a face that is a door."""

Point = tuple[float, float]


@dataclass(frozen=True)
class PolygonRoom:
    """A room of any outline and one height; floor at z = 0.

    Attributes:
        corners: of the outline, (x, y) in m, in order, either way round; side k leads from corner k
            to the next one.
        height: in m.
        t60: reverberation time in s, doors shut.
        walls: factors (0 to 1) on the reflection coefficients of each side, the floor, the ceiling
            and each pillar, in this order; none for 1 everywhere.
        pillars: outlines of pillars from floor to ceiling, each like `corners`.
        doors: openings from floor to ceiling, (side, from, to): number of the side, and where on it
            the opening begins and ends, in m from the side's first corner.
    """

    corners: tuple[Point, ...]
    height: float
    t60: float
    walls: tuple[float, ...] = ()
    pillars: tuple[tuple[Point, ...], ...] = ()
    doors: tuple[tuple[int, float, float], ...] = ()

    def __post_init__(self) -> None:
        check_list("room.pillars", self.pillars)
        check_list("room.doors", self.doors)
        outlines = [_outline("room.corners", self.corners)]
        outlines += [_outline("room.pillars", pillar) for pillar in self.pillars]
        check_number("room.height", self.height, low=0.5, high=200.0, unit="m")
        object.__setattr__(self, "corners", _points(outlines[0]))
        object.__setattr__(self, "pillars", tuple(map(_points, outlines[1:])))
        _check_apart(outlines)
        self._set_walls()
        self._set_doors()
        check_t60(self.t60, shortest=self.shortest_t60(), dimensions=self.dimensions)

    def _set_walls(self) -> None:
        """Check the factors, and write them out where none are given."""
        count = len(self.corners) + 2 + len(self.pillars)
        check_list("room.walls", self.walls)
        sides = f"{len(self.corners)} sides, floor, ceiling, {len(self.pillars)} pillars"
        allowed = f"must be none, or {count} factors from 0 to 1: {sides}"
        check(len(self.walls) in (0, count), "room.walls", list(self.walls), allowed=allowed)
        for factor in self.walls:
            check_number("room.walls", factor, low=0.0, high=1.0)
        object.__setattr__(self, "walls", tuple(map(float, self.walls)) or (1.0,) * count)

    def _set_doors(self) -> None:
        """Check the openings: on a side, one after the other."""
        doors = []
        for door in self.doors:
            check_list("room.doors", door, length=3, allowed="must be (side, from, to) each")
            side, start, end = door
            check_whole("room.doors", side, low=0, high=len(self.corners) - 1, hint="which side?")
            length = math.dist(self.corners[side], self.corners[(side + 1) % len(self.corners)])
            check_number("room.doors", start, low=0.0, high=length, unit="m")
            check_number("room.doors", end, low=start + GAP, high=length, unit="m")
            doors.append((int(side), float(start), float(end)))
        doors.sort()
        for (side, _, end), (other, start, _) in zip(doors, doors[1:], strict=False):
            apart = side != other or start >= end + GAP
            allowed = f"must begin {GAP:g} m after the one before it on that side"
            check(apart, "room.doors", f"{start:g} m", allowed=allowed)
        object.__setattr__(self, "doors", tuple(doors))

    @property
    def dimensions(self) -> str:
        """Size in words, as in 6-cornered 27.5 m^2 x 2.6 m."""
        return f"{len(self.corners)}-cornered {self.area:.4g} m^2 x {self.height:g} m"

    @cached_property
    def area(self) -> float:
        """Floor without pillars, in m^2."""
        outline, *pillars = (abs(twice_area(np.array(o))) / 2 for o in self._outlines)
        return outline - sum(pillars)

    @property
    def volume(self) -> float:
        """Air in the room, in m^3."""
        return self.area * self.height

    @property
    def surface(self) -> float:
        """Floor, ceiling, walls and pillars, in m^2."""
        perimeter = sum(
            math.dist(corner, other)
            for outline in self._outlines
            for corner, other in zip(outline, (*outline[1:], outline[0]), strict=True)
        )
        return 2.0 * self.area + perimeter * self.height

    def shortest_t60(self, speed_of_sound: float = SPEED_OF_SOUND) -> float:
        """Return the T60 in s at which Sabine's absorption reaches 1: 24 ln(10) V / (c S)."""
        return 24.0 * math.log(10.0) * self.volume / (speed_of_sound * self.surface)

    def sabine_absorption(self, speed_of_sound: float = SPEED_OF_SOUND) -> float:
        """Return the energy absorption coefficient that Sabine's formula gives for `t60`."""
        return self.shortest_t60(speed_of_sound) / self.t60

    def reflection(self, speed_of_sound: float = SPEED_OF_SOUND) -> Array:
        """Return pressure reflection coefficients in the order of `walls`, shape (W,)."""
        return reflections(self.walls, self.sabine_absorption(speed_of_sound))

    @property
    def _outlines(self) -> tuple[tuple[Point, ...], ...]:
        return (self.corners, *self.pillars)

    @cached_property
    def faces(self) -> tuple[Array, Array]:
        """Upright faces: sides (F, 2, 2) in m with the room to their left, and their walls (F,).

        A wall is its number in `walls`, or `DOOR`; a wall with doors has several faces.
        """
        count = len(self.corners)
        parts = []
        numbers: list[int] = []
        for number, outline in enumerate(self._outlines):
            pieces = closed(np.array(outline))
            walls = np.full(len(pieces), number + count + 1)
            if number == 0:
                pieces, walls = self._opened(pieces)
            # The outline runs anticlockwise around the room, a pillar clockwise.
            if (twice_area(np.array(outline)) > 0) != (number == 0):
                pieces, walls = pieces[::-1, ::-1], walls[::-1]
            parts.append(pieces)
            numbers += walls.tolist()
        return np.concatenate(parts), np.array(numbers)

    def _opened(self, sides: Array) -> tuple[Array, Array]:
        """Cut sides (S, 2, 2) at their doors; return the pieces, and the wall of each."""
        pieces = []
        walls = []
        for number, (start, end) in enumerate(sides):
            ahead = (end - start) / np.linalg.norm(end - start)
            at = start
            for _, first, last in (door for door in self.doors if door[0] == number):
                opening = start + np.outer([first, last], ahead)
                pieces += [np.stack([at, opening[0]]), opening]
                walls += [number, DOOR]
                at = opening[1]
            pieces.append(np.stack([at, end]))
            walls.append(number)
        # A door in a corner leaves nothing of the wall on one side of it.
        whole = [bool(np.linalg.norm(piece[1] - piece[0]) > GAP / 2) for piece in pieces]
        return np.array(pieces)[whole], np.array(walls)[whole]


AnyRoom = Room | PolygonRoom


def _outline(name: str, corners: object) -> Array:
    """Return the corners of an outline (C, 2), checked one by one."""
    places = check_metres(name, corners, shape=(-1, 2), most=1000.0)
    allowed = "must be 3 to 100 distinct corners, in order"
    check(3 <= len(places) <= 100, name, f"{len(places)} corners", allowed=allowed)
    twice = len(places) - len(np.unique(places, axis=0))
    hint = "it closes by itself"
    check(twice == 0, name, f"{twice} corners twice", allowed=allowed, hint=hint)
    return places


def _points(corners: Array) -> tuple[Point, ...]:
    return tuple((float(x), float(y)) for x, y in corners)


def _check_apart(outlines: Sequence[Array]) -> None:
    """Refuse outlines that cross or touch themselves or each other, or lie where they cannot."""
    name = "room.corners" if len(outlines) == 1 else "room.corners and room.pillars"
    sides = np.concatenate([closed(corners) for corners in outlines])
    for corner in np.concatenate(outlines):
        # The two sides that end here are closed together elsewhere, and left out.
        others = sides[~(sides == corner).all(axis=2).any(axis=1)]
        alone = len(others) == len(sides) - 2
        free = alone and float(distance_to_outline(corner, others)) >= GAP
        allowed = f"must be at least {GAP:g} m from every side that does not end there"
        hint = "does a side run back?"
        check(free, name, f"{corner.tolist()} m", allowed=allowed, hint=hint)
    first, second = np.nonzero(crosses(sides, sides) & _strangers(sides))
    where = sides[first[0]].tolist() if len(first) else ""
    check(len(first) == 0, name, f"{where} m", allowed="must be sides that do not cross others")

    span = float(np.ptp(outlines[0], axis=0).max())
    check(span <= 200.0, "room.corners", f"{span:g} m", allowed="must span at most 200 m")

    for number, pillar in enumerate(outlines[1:], start=1):
        around = [outline for other, outline in enumerate(outlines) if other != number]
        within = encloses(np.concatenate([closed(other) for other in around]), pillar[:1])[0]
        allowed = "must lie inside the outline, and not in another pillar"
        check(within, "room.pillars", f"{pillar[0].tolist()} m", allowed=allowed)


def _strangers(sides: Array) -> Array:
    """Tell which pairs of sides have no corner in common, shape (S, S)."""
    shared = (sides[:, None, :, None] == sides[None, :, None, :]).all(axis=-1)
    return ~shared.any(axis=(2, 3))
