"""Sounds to test with, and what the ring records of them."""

from typing import Any

import numpy as np

from echolearn.acoustics.types import Array, MicArray, Noise
from reference import RATE, RING


def hiss(*, length: int, sample_rate: float, rng: np.random.Generator) -> Array:
    """Return white noise at one point."""
    return rng.standard_normal(length)


def draw(noise: Noise, length: int = 20_000, *, seed: Any = 0, array: MicArray = RING) -> Array:
    """Return one draw of a noise, shape (M, length); `seed` may be a generator."""
    rng = np.random.default_rng(seed)
    return noise(array, length=length, sample_rate=RATE, rng=rng)
