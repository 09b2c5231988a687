"""A robot's walk through a room.

The walk is a spiral in polar form around the room's middle,

    position(u) = middle + inward(u) r(theta) (cos theta, sin theta),   theta = start + 2 pi u,
    r(theta) = (|cos theta / a|^8 + |sin theta / b|^8)^(-1/8),          (a, b) = room / 2 - margin(u),

a rectangle with round corners. During the first turn inward = 1: the robot follows the walls,
weaving between `clearance` and `clearance + weave` so that no wall keeps one distance (a constant
TOA could be memorised). During the next two, inward(u) = 1 / (1 + ((u - 1) / 0.8)^2) takes it into
the middle, where the larger rooms have no wall within 2 m and every echo in the search window is
spurious.
"""

import math

import numpy as np

from echolearn.acoustics.types import Array, Pose, Room
from echolearn.checks import check, check_number, check_whole

WEAVES = 3.3
"""Swings of the wall distance in one turn; not whole, so that opposite walls are passed
differently."""


TURNS = 3.0
"""Length of the walk in turns around the middle; the first follows the walls."""


FALL = 0.8
"""Turns after which the spiral has fallen to half the size of the lap."""


def trajectory(
    room: Room,
    *,
    poses: int = 160,
    clearance: float = 1.05,
    weave: float = 0.4,
    start: float = 0.6,
    height: float | None = None,
) -> list[Pose]:
    """Walk along the walls, then into the middle of the room.

    Args:
        room: a shoebox whose shorter side holds the margins to both walls.
        poses: P, evenly spaced along the path.
        clearance: smallest distance from the walls the lap aims at, in m.
        weave: how far the lap swings away from that, in m.
        start: polar angle of the first pose, in rad; another start gives another walk.
        height: of the loudspeaker, in m; half the room's height unless given.

    Returns:
        P poses, heading along the path's tangent.

    Raises:
        BadValue: fewer than 2 poses, or margins or a height that the room cannot hold.
    """
    height = room.size[2] / 2 if height is None else height
    _check_walk(room, poses=poses, clearance=clearance, weave=weave, start=start, height=height)
    dense = _spiral(room, clearance=clearance, weave=weave, start=start)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(dense, axis=0), axis=1))])
    places = np.linspace(0.0, length[-1], poses)
    x, y = (np.interp(places, length, column) for column in dense.T)
    ahead_x, ahead_y = (
        np.interp(places, length, column) for column in np.gradient(dense, length, axis=0).T
    )
    heading = np.arctan2(ahead_y, ahead_x)
    return [Pose(np.array([x[i], y[i], height]), float(heading[i])) for i in range(poses)]


def _check_walk(
    room: Room, *, poses: int, clearance: float, weave: float, start: float, height: float
) -> None:
    check_whole("poses", poses, low=2)
    check_number("start", start, low=-10.0, high=10.0, unit="rad")
    check_number("weave", weave, low=0.0, high=100.0, unit="m")
    check_number("clearance", clearance, low=0.1, high=100.0, unit="m")
    least = 2 * (clearance + weave + 0.1)
    shape = " x ".join(f"{length:g}" for length in room.size)
    allowed = f"two sides of at least {least:g} m, for a walk {clearance:g} to {clearance + weave:g} m from the walls"
    check(min(room.size[:2]) > least - 1e-9, "room.size", f"{shape} m", allowed=allowed)
    ceiling = room.size[2] - 0.1
    check_number("height", height, low=0.1, high=ceiling, unit="m", hint="is it below the ceiling?")


def _spiral(room: Room, *, clearance: float, weave: float, start: float) -> Array:
    """Return the path as a dense polyline, shape (30001, 2), in m."""
    turn = np.linspace(0.0, TURNS, 30_001)
    theta = start + 2 * math.pi * turn
    margin = clearance + weave * np.sin(math.pi * WEAVES * turn) ** 2
    inward = 1 / (1 + (np.maximum(turn - 1, 0.0) / FALL) ** 2)
    half = np.array(room.size[:2]) / 2
    toward = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    radius = inward * (np.abs(toward / (half - margin[:, None])) ** 8).sum(axis=-1) ** -0.125
    path: Array = half + radius[:, None] * toward
    return path
