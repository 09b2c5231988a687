"""A robot's walk through a room.

The walk is a spiral in polar form around the room's middle,

    position(u) = middle + inward(u) r(theta) (cos theta, sin theta),   theta = start + 2 pi u,
    r(theta) = (|cos theta / a|^8 + |sin theta / b|^8)^(-1/8),   (a, b) = room / 2 - margin(u),

a rectangle with round corners. During the first turn inward = 1: the robot follows the walls,
weaving between `CLEARANCE` and `CLEARANCE + WEAVE` so that no wall keeps one distance (a constant
TOA could be memorised). During the next two, inward(u) = 1 / (1 + ((u - 1) / 0.8)^2) takes it into
the middle, where the larger rooms have no wall within 2 m and every echo in the search window is
spurious. In a room that is no box the robot follows its walls (`wall_following`).
"""

import math

import numpy as np

from echolearn.acoustics.polygon_room import AnyRoom
from echolearn.acoustics.rooms import size_of
from echolearn.acoustics.types import Array, Pose, Room
from echolearn.checks import check, check_number, check_whole
from echolearn.simulation.wall_following import followed

CLEARANCE = 1.05
"""Smallest distance from the walls that the first turn aims at, in m."""

WEAVE = 0.4
"""How far the first turn swings away from that, in m."""

SWINGS = 3.3
"""Swings in one turn; not whole, so that opposite walls are passed differently."""

TURNS = 3.0
"""Length of the walk in turns around the middle; the first follows the walls."""

FALL = 0.8
"""Turns after which the spiral has fallen to half the size of the first turn."""

MOST = 1_000_000
"""Poses of a walk, about 300 bytes each."""

LEAST = 2 * (CLEARANCE + WEAVE + 0.1)
"""Shortest side of a room that holds the margins to both walls, in m."""


def trajectory(room: AnyRoom, *, poses: int = 160, start: float = 0.6) -> list[Pose]:
    """Walk along the walls, then into the middle of the room, at half its height.

    Args:
        room: a box whose shorter side holds the margins to both walls, or one of any outline with a
            place for them.
        poses: number P of poses, evenly spaced along the path.
        start: polar angle of the first pose, in rad; another start gives another walk.

    Returns:
        P poses, heading along the path's tangent.

    Raises:
        BadValue: fewer than 2 poses or more than `MOST`, or margins that the room cannot hold.
    """
    check_whole("poses", poses, low=2, high=MOST)
    check_number("start", start, low=-10.0, high=10.0, unit="rad")
    if isinstance(room, Room):
        path = _spiral(room, start)
    else:
        path = followed(room, start=start, clearance=CLEARANCE, weave=WEAVE, swings=SWINGS)

    # Even steps along the path, and the direction of its tangent there.
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    tangent = np.gradient(path, length, axis=0)
    places = np.linspace(0.0, length[-1], poses)
    x, y, ahead_x, ahead_y = (
        np.interp(places, length, column) for column in np.hstack([path, tangent]).T
    )
    heading = np.arctan2(ahead_y, ahead_x)
    positions = np.stack([x, y, np.full(poses, size_of(room)[2] / 2)], axis=1)
    return [Pose(place, float(turn)) for place, turn in zip(positions, heading, strict=True)]


def _spiral(room: Room, start: float) -> Array:
    """Return the path as a dense polyline, shape (30001, 2), in m.

    Raises:
        BadValue: margins that the room cannot hold.
    """
    far = f"{CLEARANCE:g} to {CLEARANCE + WEAVE:g} m"
    check(
        min(room.size[:2]) > LEAST - 1e-9,
        "room.size",
        room.dimensions,
        allowed=f"must have two sides of at least {LEAST:g} m, for a walk {far} from the walls",
    )
    turn = np.linspace(0.0, TURNS, 30_001)
    theta = start + 2 * math.pi * turn
    margin = CLEARANCE + WEAVE * np.sin(math.pi * SWINGS * turn) ** 2
    inward = 1 / (1 + (np.maximum(turn - 1, 0.0) / FALL) ** 2)
    half = np.array(room.size[:2]) / 2
    toward = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    radius = inward * (np.abs(toward / (half - margin[:, None])) ** 8).sum(axis=-1) ** -0.125
    path: Array = half + radius[:, None] * toward
    return path
