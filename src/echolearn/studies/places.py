"""Where the robot of a study stands: in corners of the room, or along its walks.

| places  | poses                                                                                              |
|---------|----------------------------------------------------------------------------------------------------|
| corners | the two walls of some corner at the distances `walls`, in either order, under a random heading        |
| low     | `walls` away from those at x = 0 and y = 0, microphone 1 of the paper's array at 90 degrees, at        |
|         | heights from 1 to 2 m, where the floor is as near as the walls                                       |
| walk    | of several walks through the room (`mapping.trajectory`), those from which a wall is 1 to 2 m away  |

Every pose of `walk` can give a point of the map, so a share of points on walls is there the share
of the attainable.
"""

import numpy as np

from echolearn.acoustics.geometry import outline
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Pose, Room
from echolearn.checks import check
from echolearn.evaluation.coverage import feet
from echolearn.simulation.walk import trajectory

PLACES = ("corners", "low", "walk")

WALKS = 4
"""Walks that poses are taken from, their starts evenly spaced around the room."""


def corner(room: Room, walls: tuple[float, float], *, seed: int, position: int) -> Pose:
    """Return a pose in a corner, its walls at the distances `walls` in either order, in m, at
    mid-height.
    """
    rng = stream(seed, "place", position)
    away = rng.permutation(walls)
    size, far = np.array(room.size), rng.integers(2, size=2).astype(bool)
    place = np.append(np.where(far, size[:2] - away, away), size[2] / 2)
    return Pose(place, float(rng.uniform(-np.pi, np.pi)))


def low(walls: tuple[float, float], count: int) -> list[Pose]:
    """Return poses in the corner at the origin, facing along y, at heights evenly from 1 to 2 m."""
    heights = 1.0 + (np.arange(count) + 0.5) / count
    return [Pose(np.array([*walls, height]), np.pi / 2) for height in heights]


def walked(room: Room, count: int, *, seed: int) -> list[Pose]:
    """Return poses along walks, evenly chosen of those from which the foot on some wall is 1 to 2 m
    away.

    Args:
        room: a shoebox that can hold the walk.
        count: how many poses.
        seed: gives the polar angle at which the first walk starts.

    Raises:
        BadValue: a room too small for the walk, or more poses than the walks have.
    """
    first = stream(seed, "place").uniform(0.0, 2 * np.pi / WALKS)
    starts = first + 2 * np.pi * np.arange(WALKS) / WALKS
    poses = [pose for start in starts for pose in trajectory(room, start=float(start))]
    _, heard = feet(outline(room), np.array([pose.position[:2] for pose in poses]))
    useful = [poses[number] for number in np.flatnonzero(heard.any(axis=1))]
    hint = f"{WALKS} walks have so many poses with a wall 1 to 2 m away"
    check(
        count <= len(useful),
        "positions",
        count,
        allowed=f"at most {len(useful)} in this room",
        hint=hint,
    )
    return [useful[number * len(useful) // count] for number in range(count)]
