"""Where the robot of a study stands: in corners of the room, or along walks through it.

| places  | poses                                                                            |
|---------|----------------------------------------------------------------------------------|
| corners | the walls of some corner at given distances, in either order, random heading     |
| walk    | of several walks through the room (`simulation.walk`), those 1 to 2 m from a wall |

Every pose of `walk` can give a point of the map, so a share of points on walls is there the share
of the attainable.
"""

import numpy as np

from echolearn.acoustics.polygon_room import AnyRoom
from echolearn.acoustics.rooms import outline
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Pose, Room
from echolearn.checks import check
from echolearn.evaluation.coverage import feet
from echolearn.simulation.walk import trajectory

PLACES = ("corners", "walk")

WALKS = 4
"""Walks that poses are taken from, their starts evenly spaced around the room."""


def corner_pose(room: Room, *, walls: tuple[float, float], seed: int, number: int) -> Pose:
    """Return a pose in some corner of the room, at mid-height.

    Args:
        room: a shoebox.
        walls: distances of the corner's two walls in m, met in either order.
        seed: of the study.
        number: of the pose; with `seed` it gives corner, order and heading.
    """
    rng = stream(seed, "place", number)
    distances = rng.permutation(walls)
    size = np.array(room.size)
    is_far = rng.integers(2, size=2).astype(bool)
    place = np.where(is_far, size[:2] - distances, distances)
    heading = float(rng.uniform(-np.pi, np.pi))
    return Pose(np.append(place, size[2] / 2), heading)


def walk_poses(room: AnyRoom, *, count: int, seed: int) -> list[Pose]:
    """Return poses along walks, evenly chosen of those with a wall 1 to 2 m away.

    Args:
        room: one that can hold the walk.
        count: number of poses.
        seed: gives the polar angle at which the first walk starts.

    Raises:
        BadValue: a room too small for the walk, or more poses than the walks have.
    """
    first = stream(seed, "place").uniform(0.0, 2 * np.pi / WALKS)
    poses: list[Pose] = []
    for number in range(WALKS):
        start = first + 2 * np.pi * number / WALKS
        poses += trajectory(room, start=float(start))

    # A pose without a wall in the window can give no true point, so it would lower every share.
    places = np.array([pose.position[:2] for pose in poses])
    _, gives_echo = feet(outline(room), places)
    useful = np.flatnonzero(gives_echo.any(axis=1))
    check(
        count <= len(useful),
        "positions",
        count,
        allowed=f"must be at most {len(useful)} in this room",
        hint=f"its {WALKS} walks have no more poses with a wall 1 to 2 m away",
    )
    return [poses[useful[number * len(useful) // count]] for number in range(count)]
