"""Rooms: their outline on the floor, first-order images of a point, and true echoes."""

import numpy as np

from echolearn.acoustics.geometry import microphone_positions, turned, wrap
from echolearn.acoustics.types import SPEED_OF_SOUND, Array, MicArray, Pose, Room, Truth
from echolearn.checks import check


def first_order_images(room: Room, position: Array) -> Array:
    """Return the mirror images of `position` (3,) in the reflecting walls, shape (W, 3), in m."""
    images = np.tile(np.asarray(position, dtype=float), (6, 1))
    for axis, length in enumerate(room.size):
        # A wall at 0 mirrors x to -x, one at the room's end to 2 size - x.
        images[2 * axis : 2 * axis + 2, axis] = [0.0, 2.0 * length] - images[0, axis]
    return images[np.array(room.walls) > 0]


def true_echoes(
    room: Room, pose: Pose, *, array: MicArray, speed_of_sound: float = SPEED_OF_SOUND
) -> Truth:
    """Return TOA and DOA of each reflecting wall's first-order echo, in the project's wall order.

    Directions are seen from the array's centre.

    Args:
        room: with its walls.
        pose: where the robot stands.
        array: its first microphone is the reference.
        speed_of_sound: in m/s.
    """
    images = first_order_images(room, pose.position)
    reference = microphone_positions(array, pose)[0]
    toward = images - pose.position - turned(array.centre, pose.heading)
    distance = np.linalg.norm(toward, axis=1)
    azimuth = np.arctan2(toward[:, 1], toward[:, 0]) - pose.heading
    return Truth(
        toa=np.linalg.norm(images - reference, axis=1) / speed_of_sound,
        azimuth=wrap(azimuth),
        elevation=np.arccos(toward[:, 2] / distance),
    )


def check_inside(room: Room, pose: Pose, *, array: MicArray) -> None:
    """Raise `BadValue` unless the loudspeaker and every microphone lie inside the room.

    Args:
        room: with its walls.
        pose: where the robot stands.
        array: what it carries.
    """
    points = np.vstack([microphone_positions(array, pose), pose.position])
    check(
        ((points > 0) & (points < np.array(room.size))).all(),
        "pose.position",
        "({:g}, {:g}, {:g}) m".format(*pose.position),
        allowed=f"the array of radius {array.radius:g} m must be inside the {room.dimensions} room",
        hint="is the margin to the walls smaller than the array's radius?",
    )


def outline(room: Room) -> Array:
    """Return the corners of the room's floor plan, anticlockwise from the origin, (4, 2), in m."""
    x, y, _ = room.size
    return np.array([[0.0, 0.0], [x, 0.0], [x, y], [0.0, y]])


def distance_to_outline(points: Array, corners: Array) -> Array:
    """Return the distance of points (..., 2) to the nearest edge of a polygon (C, 2), in m."""
    edge = np.roll(corners, -1, axis=0) - corners
    offset = np.asarray(points)[..., None, :] - corners
    along = np.clip((offset * edge).sum(-1) / (edge**2).sum(-1), 0.0, 1.0)
    return np.linalg.norm(offset - along[..., None] * edge, axis=-1).min(axis=-1)
