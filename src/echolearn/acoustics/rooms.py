"""Rooms, boxes or of any outline: their walls, what is inside, true echoes, engines for sound."""

import numpy as np

from echolearn.acoustics.geometry import microphone_positions, turned, wrap
from echolearn.acoustics.polygon_room import DOOR, AnyRoom, PolygonRoom
from echolearn.acoustics.sides import closed, encloses, first_echoes, mirror_images
from echolearn.acoustics.types import SPEED_OF_SOUND, Array, MicArray, Pose, Room, Truth
from echolearn.checks import check


def bounds(room: AnyRoom) -> tuple[Array, Array]:
    """Return the lowest and the highest corner of the box around a room, (3,) each, in m."""
    if isinstance(room, Room):
        return np.zeros(3), np.array(room.size)
    corners = np.array(room.corners)
    return np.append(corners.min(axis=0), 0.0), np.append(corners.max(axis=0), room.height)


def size_of(room: AnyRoom) -> tuple[float, float, float]:
    """Return length, width and height of a room, or of the box around it, in m."""
    low, high = bounds(room)
    length, width, height = (high - low).tolist()
    return length, width, height


def outline(room: AnyRoom) -> Array:
    """Return the walls of the floor plan, shape (S, 2, 2), in m: pillars too, but no doors.

    They run anticlockwise, those of a shoebox from the origin; those of pillars clockwise.
    """
    if isinstance(room, PolygonRoom):
        sides, walls = room.faces
        return sides[walls != DOOR]
    x, y, _ = room.size
    return closed(np.array([[0.0, 0.0], [x, 0.0], [x, y], [0.0, y]]))


def most_echoes(room: AnyRoom) -> int:
    """Return how many first-order echoes a place in the room can have, at least 6."""
    return 6 if isinstance(room, Room) else max(6, len(outline(room)) + 2)


def inside(room: AnyRoom, points: Array) -> Array:
    """Tell which points (P, 3) lie in the room; those on the walls of a box do."""
    low, high = bounds(room)
    within: Array = np.asarray(((points >= low) & (points <= high)).all(axis=1))
    if isinstance(room, PolygonRoom):
        within &= encloses(room.faces[0], points[:, :2])
    return within


def check_inside(room: AnyRoom, pose: Pose, *, array: MicArray) -> None:
    """Raise `BadValue` unless the loudspeaker and every microphone lie inside the room.

    Args:
        room: with its walls.
        pose: where the robot stands.
        array: what it carries.
    """
    points = np.vstack([microphone_positions(array, pose), pose.position])
    low, high = bounds(room)
    off_walls = ((points > low) & (points < high)).all()
    if off_walls and inside(room, points).all():
        return
    check(
        False,
        "pose.position",
        "({:g}, {:g}, {:g}) m".format(*pose.position),
        allowed=f"the array of radius {array.radius:g} m must be inside the {room.dimensions} room",
        hint="is the margin to the walls smaller than the array's radius?",
    )


def first_order_images(room: Room, position: Array) -> Array:
    """Return the mirror images of `position` (3,) in the reflecting walls, shape (W, 3), in m."""
    images = np.tile(np.asarray(position, dtype=float), (6, 1))
    for axis, length in enumerate(room.size):
        # A wall at 0 mirrors x to -x, one at the room's end to 2 size - x.
        images[2 * axis : 2 * axis + 2, axis] = [0.0, 2.0 * length] - images[0, axis]
    return images[np.array(room.walls) > 0]


def visible_images(room: PolygonRoom, position: Array, *, microphone: Array) -> Array:
    """Return the first-order images that a microphone hears, shape (W, 3), in m.

    Sides come first, then pillars, floor, ceiling. One that does not reflect has none, nor has one
    whose sound would leave by a door or meet another wall.

    Args:
        room: with its walls.
        position: of the source, shape (3,), in m.
        microphone: shape (3,), in m.
    """
    sides, walls = room.faces
    factors = np.append(room.walls, 0.0)
    heard = np.isfinite(first_echoes(sides, position, microphones=microphone[None])[0])
    places = mirror_images(sides, position[:2])[heard & (factors[walls] > 0)]
    upright = np.column_stack([places, np.full(len(places), position[2])])

    # Floor and ceiling are everywhere, and the array is small: nothing stands in their way.
    count = len(room.corners)
    heights = np.array([-position[2], 2.0 * room.height - position[2]])
    level = heights[factors[count : count + 2] > 0]
    above = np.column_stack([np.tile(position[:2], (len(level), 1)), level])
    return np.concatenate([upright, above])


def true_echoes(
    room: AnyRoom, pose: Pose, *, array: MicArray, speed_of_sound: float = SPEED_OF_SOUND
) -> Truth:
    """Return TOA and DOA of each reflecting wall's first-order echo, in the project's wall order.

    Directions are seen from the array's centre.

    Args:
        room: with its walls.
        pose: where the robot stands.
        array: its first microphone is the reference.
        speed_of_sound: in m/s.
    """
    reference = microphone_positions(array, pose)[0]
    if isinstance(room, Room):
        images = first_order_images(room, pose.position)
    else:
        images = visible_images(room, pose.position, microphone=reference)
    toward = images - pose.position - turned(array.centre, pose.heading)
    distance = np.linalg.norm(toward, axis=1)
    azimuth = np.arctan2(toward[:, 1], toward[:, 0]) - pose.heading
    return Truth(
        toa=np.linalg.norm(images - reference, axis=1) / speed_of_sound,
        azimuth=wrap(azimuth),
        elevation=np.arccos(toward[:, 2] / distance),
    )
