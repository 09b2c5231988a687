"""Walls and their echoes where loudspeaker and microphones stand apart: exact, both ways.

A wall at the distance D in direction n mirrors the loudspeaker to 2 D n. Its echo travels L and is
seen from the array's centre c, the mean of the microphones, in direction v at the distance rho:

    L = |2 D n - p_1|,    rho v = 2 D n - c,    |c + rho v - p_1| = L,

so with q = p_1 - c the centre sees the mirror source at rho = v . q + sqrt((v . q)^2 - |q|^2 +
L^2), and D n = (c + rho v) / 2 is the wall's nearest point. Where the sound meets the wall lies on
an ellipse about loudspeaker and microphone; around a loudspeaker in the middle, c = 0, v is n and D
is rho / 2.
"""

import numpy as np

from echolearn.acoustics.geometry import direction
from echolearn.acoustics.types import SPEED_OF_SOUND, Array, MicArray


def echo_path(distance: Array | float, normal: Array, *, array: MicArray) -> Array:
    """Return how far the echo of a wall travels to microphone 1, L = |2 D n - p_1|, (...), in m.

    Args:
        distance: from the loudspeaker to the wall, shape (...), in m.
        normal: unit vectors n from the loudspeaker to the wall, robot frame, shape (..., 3).
        array: its first microphone is the reference.
    """
    image = 2.0 * np.asarray(distance)[..., None] * normal
    return np.asarray(np.linalg.norm(image - array.positions[0], axis=-1))


def echo_direction(distance: Array | float, normal: Array, *, array: MicArray) -> Array:
    """Return the unit vectors v in which the array's centre sees the echo of a wall, (..., 3).

    Args:
        distance: from the loudspeaker to the wall, shape (...), in m.
        normal: unit vectors n from the loudspeaker to the wall, robot frame, shape (..., 3).
        array: the microphones.
    """
    image = 2.0 * np.asarray(distance)[..., None] * normal - array.centre
    return np.asarray(image / np.linalg.norm(image, axis=-1, keepdims=True))


def echo_slopes(distance: Array, azimuth: Array, *, array: MicArray) -> Array:
    """Return the derivatives of path and azimuth of an upright wall's echo, shape (2, 2, ...).

    Rows are L in m and the azimuth phi of v, columns the wall's distance D and the azimuth theta of
    its normal. With t = dn/dtheta, w = 2 D n - c in the plane:

        dL/dD = 2 n . (2 D n - p_1) / L,        dL/dtheta = -2 D t . p_1 / L,
        dphi/dD = -2 t . w / |w|^2,             dphi/dtheta = 2 D n . w / |w|^2.

    Its inverse tells what a lag or a degree is worth: d(D, theta) = slopes^-1 d(L, phi).

    Args:
        distance: from the loudspeaker to the wall, shape (...), in m.
        azimuth: of its normal, robot frame, shape (...), in rad.
        array: its first microphone is the reference.
    """
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    reference = array.positions[0]
    path = echo_path(distance, np.stack([cos, sin, np.zeros_like(cos)], axis=-1), array=array)
    longer = 2.0 * (2.0 * distance - reference[0] * cos - reference[1] * sin) / path
    around = 2.0 * distance * (reference[0] * sin - reference[1] * cos) / path

    x = 2.0 * distance * cos - array.centre[0]
    y = 2.0 * distance * sin - array.centre[1]
    square = x**2 + y**2
    aside = 2.0 * (x * sin - y * cos) / square
    turned = 2.0 * distance * (x * cos + y * sin) / square
    return np.array([[longer, around], [aside, turned]])


def image_distance(
    toa: Array, toward: Array, *, array: MicArray, speed_of_sound: float = SPEED_OF_SOUND
) -> Array:
    """Return the distance rho from the array's centre to the mirror source of an echo, in m.

    In the paper, whose loudspeaker is the centre, it is 2 D. The far-field form rho = c toa + p . v
    is its limit and up to 10 mm off at 2 m; the authors' code takes p . v twice, up to 20 cm off.

    Args:
        toa: at microphone 1, in s, shape (...).
        toward: unit vectors v of the directions of arrival in the robot's frame, shape (..., 3).
        array: its first microphone is the reference.
        speed_of_sound: in m/s.
    """
    reference = array.positions[0] - array.centre
    along = toward @ reference
    square = along**2 - reference @ reference + (speed_of_sound * np.asarray(toa)) ** 2
    # An echo earlier than the way from centre to microphone is impossible; 0 keeps it finite.
    return np.asarray(along + np.sqrt(np.maximum(square, 0.0)))


def wall_distance(
    toa: Array, toward: Array, *, array: MicArray, speed_of_sound: float = SPEED_OF_SOUND
) -> Array:
    """Return the distance D from the loudspeaker to the wall that an echo came from, in m.

    Args:
        toa: at microphone 1, in s, shape (...).
        toward: unit vectors v of the directions of arrival in the robot's frame, shape (..., 3).
        array: its first microphone is the reference.
        speed_of_sound: in m/s.
    """
    away = image_distance(toa, toward, array=array, speed_of_sound=speed_of_sound)
    return np.asarray(np.linalg.norm(array.centre + away[..., None] * toward, axis=-1)) / 2.0


def upright_elevation(
    toa: Array, azimuth: Array, *, array: MicArray, speed_of_sound: float = SPEED_OF_SOUND
) -> Array:
    """Return the elevation at which the array's centre sees the echo of an upright wall, in rad.

    The wall's mirror source is as high as the loudspeaker, the centre may be higher or lower. With
    e level in the direction phi and r e the level part of rho v,

        |c + r e - p_1|^2 = L^2 in the plane of the loudspeaker,    tan(elevation) = r / -c_z.

    Args:
        toa: at microphone 1, in s, shape (...).
        azimuth: of the echo, robot frame, shape (...), in rad.
        array: its first microphone is the reference.
        speed_of_sound: in m/s.
    """
    x, y, z = array.centre
    reference = array.positions[0, :2] - (x, y)
    along = direction(azimuth, np.pi / 2)[..., :2] @ reference
    level = (speed_of_sound * np.asarray(toa)) ** 2 - array.positions[0, 2] ** 2
    square = along**2 - reference @ reference + level
    return np.asarray(np.arctan2(along + np.sqrt(np.maximum(square, 0.0)), -z))


def wall_points(
    toa: Array,
    azimuth: Array,
    elevation: Array,
    *,
    position: Array,
    heading: Array | float,
    array: MicArray,
    speed_of_sound: float = SPEED_OF_SOUND,
) -> Array:
    """Return the map points of echoes, shape (..., 2), in m, in the room's frame.

    They are the points of the walls nearest to the loudspeaker.

    Args:
        toa, azimuth, elevation: the echoes, shape (...), robot frame.
        position: of the loudspeaker, shape (..., 2) or (..., 3), in m.
        heading: of the robot, shape (...), in rad.
        array: its first microphone is the reference.
        speed_of_sound: in m/s.
    """
    ahead = direction(azimuth, elevation)
    away = image_distance(toa, ahead, array=array, speed_of_sound=speed_of_sound)
    toward = direction(np.asarray(azimuth) + heading, elevation)[..., :2]
    x, y, _ = array.centre
    cos, sin = np.cos(heading), np.sin(heading)
    centre = (
        np.asarray(position)[..., :2] + np.stack([x * cos - y * sin, x * sin + y * cos], -1) / 2
    )
    return np.asarray(centre + (away / 2.0)[..., None] * toward)


def plane_wave_error(array: MicArray, *, distance: float) -> float:
    """Return by how much echoes of upright walls are not plane waves within the array, in m.

    It is the largest difference, over directions and microphones, of the way to a microphone less
    that to microphone 1, from the mirror source itself and by the plane wave that the centre sees.

    Args:
        array: the microphones.
        distance: from the loudspeaker to the walls, in m.
    """
    normal = direction(np.linspace(-np.pi, np.pi, 72, endpoint=False), np.pi / 2)
    away = np.full(len(normal), distance)
    seen = echo_direction(away, normal, array=array)
    images = 2.0 * away[:, None, None] * normal[:, None]
    exact = np.linalg.norm(images - array.positions, axis=-1)
    exact -= echo_path(away, normal, array=array)[:, None]
    plane = -(seen @ (array.positions - array.positions[0]).T)
    return float(np.abs(exact - plane).max())
