"""Ways of sound in a room of any outline: by one wall to the microphones, and out to the walls."""

import numpy as np

from echolearn.acoustics.polygon_room import AnyRoom, PolygonRoom
from echolearn.acoustics.rooms import bounds, first_order_images, outline
from echolearn.acoustics.sides import first_echoes, mirror_images
from echolearn.acoustics.types import Array, Room


def free_path(room: AnyRoom) -> float:
    """Return the mean way between two reflections, 4 V / S, in m."""
    # Both kinds of room know 24 ln(10) V / (c S), which Sabine's formula needs.
    return room.shortest_t60(1.0) / (6.0 * np.log(10.0))


def first_ways(
    room: AnyRoom, source: Array, *, microphones: Array, speed_of_sound: float
) -> tuple[Array, Array, Array]:
    """Return what arrives by one wall.

    Args:
        room: with its walls.
        source: shape (3,), in m.
        microphones: shape (M, 3), in m.
        speed_of_sound: in m/s.

    Returns:
        From the source to the image of each wall, (W, 3), and the length of the way to each
        microphone, (W, M), both in m; the reflection coefficients (W, M), 0 where none is heard.
    """
    reflection = room.reflection(speed_of_sound)
    if isinstance(room, Room):
        images = first_order_images(room, source)
        coefficients = reflection[np.array(room.walls) > 0]
        heard = np.ones((len(images), len(microphones)), dtype=bool)
    else:
        images, coefficients, heard = _of_polygon(
            room, source, microphones=microphones, reflection=reflection
        )
    way = np.linalg.norm(images[:, None] - microphones, axis=-1)
    return images - source, way, coefficients[:, None] * heard


def _of_polygon(
    room: PolygonRoom, source: Array, *, microphones: Array, reflection: Array
) -> tuple[Array, Array, Array]:
    """Return images (W, 3), reflection coefficients (W,), and who hears them (W, M).

    Args:
        room: with its walls.
        source, microphones: as those of `first_ways`.
        reflection: coefficients in the order of `room.walls`.
    """
    sides, walls = room.faces
    plan = mirror_images(sides, source[:2])
    upright = np.column_stack([plan, np.full(len(plan), source[2])])
    heights = np.array([-source[2], 2.0 * room.height - source[2]])
    level = np.column_stack([np.tile(source[:2], (2, 1)), heights])

    # A door, which is no wall, reflects nothing.
    count = len(room.corners)
    coefficients = np.append(reflection, 0.0)[np.append(walls, [count, count + 1])]
    heard = np.isfinite(first_echoes(sides, source, microphones=microphones)).T
    everywhere = np.ones((2, len(microphones)), dtype=bool)
    return np.vstack([upright, level]), coefficients, np.vstack([heard, everywhere])


def ways_out(room: AnyRoom, place: Array, *, toward: Array) -> Array:
    """Return how far walls, floor or ceiling are, shape (Q,), in m; infinite through doors.

    Args:
        room: with its walls.
        place: within it, shape (3,), in m.
        toward: unit vectors, shape (Q, 3).
    """
    if isinstance(room, Room):
        low, high = bounds(room)
        with np.errstate(divide="ignore"):
            each: Array = np.abs((np.where(toward > 0, high, low) - place) / toward)
        return each.min(axis=1)
    sides = outline(room)
    edge = (sides[:, 1] - sides[:, 0])[None]
    offset = (sides[:, 0] - place[:2])[None]
    ahead = toward[:, None, :2]
    low, high = bounds(room)
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = _cross(ahead, edge)
        way = _cross(offset, edge) / turn
        along = _cross(offset, ahead) / turn
        level = (np.where(toward[:, 2] > 0, high[2], low[2]) - place[2]) / toward[:, 2]
    met = (way > 0) & (along >= 0) & (along <= 1)
    nearest: Array = np.where(met, way, np.inf).min(axis=1)
    return np.minimum(nearest, np.where(toward[:, 2] == 0, np.inf, level))


def _cross(first: Array, second: Array) -> Array:
    """Return the area that two vectors (..., 2) span, left turns positive."""
    area: Array = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    return area
