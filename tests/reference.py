"""Rooms and waves once more, slow and literal: oracles for the fast code, sharing none of it.

The estimators' equations are in `echolearn.bench.equations`; delays are its phase shifts. c is 343
m/s throughout.
"""

import math

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.bench.equations import delays, padded, shift

SPEED = 343.0


def plane_wave(source: Array, positions: Array, azimuth: float, *, rate: float) -> Array:
    """Return what microphones (M, 3) hear of a plane wave that passes the origin as `source` (N,),
    shape (M, N)."""
    return np.stack([shift(source, delay * rate) for delay in delays(positions, azimuth)])


def images(size: tuple[float, ...], position: Array) -> list[Array]:
    """Return the six first-order mirror images of a point in a shoebox spanning [0, size]."""
    found = []
    for axis in range(3):
        for wall in (0.0, size[axis]):
            image = np.array(position, dtype=float)
            image[axis] = 2 * wall - image[axis]
            found.append(image)
    return found


def microphones(positions: Array, place: Array, heading: float) -> Array:
    """Return microphones of the robot's frame in the room's frame, one by one."""
    cos, sin = math.cos(heading), math.sin(heading)
    turned = [[cos * x - sin * y, sin * x + cos * y, z] for x, y, z in positions]
    return np.array(turned) + place


def echo(
    burst: Array, image: Array, microphone: Array, *, strength: float, rate: float, length: int
) -> Array:
    """Return the burst as it comes from one image to one microphone: strength / (4 pi d), d/c late,
    shape (length,)."""
    distance = float(np.linalg.norm(image - microphone))
    return (
        strength / (4 * math.pi * distance) * shift(padded(burst, length), distance / SPEED * rate)
    )
