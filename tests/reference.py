"""Rooms and waves once more, slow and literal: oracles for the fast code, sharing none of it.

The estimators' equations are in `echolearn.bench.equations`; delays are its phase shifts. c is 343
m/s throughout.
"""

import math
from typing import Any

import numpy as np

from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.types import Array, MicArray, Observation, Probe
from echolearn.bench.equations import delays, padded, shift

SPEED = 343.0
RATE = 22050.0
RING = circular_array()
FIRST, LAST = SearchWindow().lags(RING, RATE)


def plane_wave(source: Array, positions: Array, azimuth: float, *, rate: float) -> Array:
    """Return what microphones (M, 3) record of a plane wave that passes the origin as `source`."""
    return np.stack([shift(source, delay * rate) for delay in delays(positions, azimuth)])


def wave(probe: Probe, azimuth: float, lag: float, gain: float = 0.1) -> Array:
    """Return the ring's recordings (M, N) of an echo that reaches microphone 1 after `lag`."""
    early = delays(RING.positions, azimuth)[0] * RATE
    source = gain * shift(padded(probe.samples, probe.length), lag - early)
    return plane_wave(source, RING.positions, azimuth, rate=RATE)


def white(probe: Probe, level: float, seed: int = 0) -> Array:
    """Return white noise at the ring, as long as a recording, shape (M, N)."""
    return level * np.random.default_rng(seed).standard_normal((len(RING), probe.length))


def observed(probe: Probe, *samples: Array, array: MicArray = RING, **known: Any) -> Observation:
    """Return recordings (M, N) as a batch."""
    return Observation(np.stack(samples), probe, array, **known)


def turn(angle: Array | float) -> Array:
    """Return angles between -pi and pi."""
    return np.angle(np.exp(1j * np.asarray(angle)))


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
    """Return the burst from one image at one microphone: strength / (4 pi d), d/c late, (length,)."""
    distance = float(np.linalg.norm(image - microphone))
    late = shift(padded(burst, length), distance / SPEED * rate)
    return strength / (4 * math.pi * distance) * late
