"""The floor plan of a survey, `walls` of `survey.yaml`: as a stranger draws it, and as sides.

[[x, y], ...]          the corners of the outline, which closes by itself;
[[[x, y], ...], ...]   lines: outlines, pillars, walls between doors. One whose last corner is
its first is closed, any other ends where it ends: a gap is a door.
"""

from typing import Any

import numpy as np

from echolearn.acoustics.sides import closed, polylines, twice_area
from echolearn.acoustics.types import Array
from echolearn.checks import check, check_list, check_metres

IN_ROOM = 10_000.0
"""m from the origin that something in a room may be."""

MOST = 1000
"""Corners of a plan, all lines together."""

CORNERS = "must be null, or 3 to 1000 distinct corners in order around an area"

LINE = "must be lines of at least two corners, each apart from the one before it"


def check_walls(name: str, value: Any) -> None:
    """Raise `BadValue` unless a value is the floor plan of a survey."""
    if not _is_lines(value):
        check_outline(name, value)
        return
    check_list(name, value)
    count = sum(map(len, value))
    allowed = f"must have at most {MOST}, all lines together"
    check(count <= MOST, name, f"{count} corners", allowed=allowed)
    for number, line in enumerate(value):
        _check_line(f"{name}.{number}", line)


def floor_size(walls: Array | None) -> Array:
    """Return how far a floor plan, sides (S, 2, 2), reaches along x and y, in m; else 0."""
    return np.zeros(2) if walls is None else np.ptp(walls, axis=(0, 1))


def check_outline(name: str, value: object) -> None:
    """Raise `BadValue` unless corners (C, 2) are those of a polygon.

    Twice the area of a polygon is the sum of x_k y_(k+1) - x_(k+1) y_k.
    """
    corners = check_metres(name, value, shape=(-1, 2), most=IN_ROOM)
    count = len(corners)
    check(3 <= count <= MOST, name, f"{count} corners", allowed=CORNERS)
    twice = count - len(np.unique(corners, axis=0))
    hint = "it closes by itself"
    check(twice == 0, name, f"{twice} corners twice", allowed=CORNERS, hint=hint)

    area = abs(twice_area(corners)) / 2
    hint = "do its sides cross each other?"
    check(area >= 0.01, name, f"an area of {area:.2g} m^2", allowed=CORNERS, hint=hint)


def _is_lines(value: Any) -> bool:
    """Tell whether a plan is given as lines: its first corner is two brackets deep, or deeper."""
    deep = isinstance(value, list) and value and isinstance(value[0], list) and value[0]
    return bool(deep and isinstance(value[0][0], list) and all(isinstance(p, list) for p in value))


def _check_line(name: str, value: object) -> None:
    """Raise `BadValue` unless corners (C, 2) are those of a line; a closed one has an area."""
    corners = check_metres(name, value, shape=(-1, 2), most=IN_ROOM)
    check(len(corners) >= 2, name, f"{len(corners)} corners", allowed=LINE)
    if len(corners) > 3 and (corners[0] == corners[-1]).all():
        check_outline(name, corners[:-1])
        return
    apart = (np.diff(corners, axis=0) != 0).any(axis=1).all()
    check(apart, name, "a corner twice in a row", allowed=LINE)


def sides(walls: Any) -> Array:
    """Return the sides of a floor plan that has been checked, shape (S, 2, 2), in m."""
    if not _is_lines(walls):
        return closed(np.array(walls, dtype=float))
    lines = [np.array(line, dtype=float) for line in walls]
    return np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines])


def plain_walls(walls: Array) -> list[Any]:
    """Return sides (S, 2, 2) as `survey.yaml` has them: a single outline as its corners."""
    lines = polylines(walls)
    if len(lines) == 1 and len(lines[0]) > 3 and (lines[0][0] == lines[0][-1]).all():
        return list(lines[0][:-1].tolist())
    return [line.tolist() for line in lines]
