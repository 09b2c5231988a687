"""Noise of sources at fixed places beside the microphones: rotors at the ends of a robot's arms.

    x_m(t) = sum_q (1 / d_qm) s_q(t - d_qm / c)

d_qm is the distance of source q from microphone m: spherical waves, unlike the far sound from all
sides of `diffuse.py`. With fewer sources than microphones the covariance between microphones is
nearly singular at every frequency, so an estimator that knows it can be rid of most of the noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from echolearn.acoustics.types import SPEED_OF_SOUND, Array, MicArray
from echolearn.checks import check, check_metres, check_speed
from echolearn.simulation.noise.diffuse import Source

NEAREST = 0.01
"""Least distance in m from any microphone."""


@dataclass(frozen=True)
class Fixed:
    """Sources that move with the robot.

    Attributes:
        source: noise of one of them; each is a draw of its own.
        places: positions in the robot's frame, Q x 3, in m.
        speed_of_sound: in m/s.
    """

    source: Source
    places: Sequence[Sequence[float]]
    speed_of_sound: float = SPEED_OF_SOUND

    def __post_init__(self) -> None:
        check_speed("diffuse.speed_of_sound", self.speed_of_sound)
        check_metres("diffuse.places", self.places, shape=(-1, 3))

    def __call__(
        self, array: MicArray, *, length: int, sample_rate: float, rng: np.random.Generator
    ) -> Array:
        """Return noise of unit power, mean over time and microphones, shape (M, length)."""
        offsets = np.array(self.places, dtype=float)[:, None] - array.positions
        distance = np.linalg.norm(offsets, axis=-1)
        nearest = f"{distance.min():.3f} m from a microphone"
        allowed = f"must be {NEAREST} m or more from every microphone"
        check(distance.min() >= NEAREST, "diffuse.places", nearest, allowed=allowed)

        # Delays are phases, so they wrap around; as much again is drawn and cut off at either end.
        ahead = int(np.ceil(distance.max() * sample_rate / self.speed_of_sound)) + 1
        size = fft.next_fast_len(length + 2 * ahead, real=True)
        omega = 2 * np.pi * fft.rfftfreq(size, 1.0 / sample_rate)
        total = np.zeros((len(array), len(omega)), dtype=complex)
        for path in distance:
            drawn = self.source(length=length + 2 * ahead, sample_rate=sample_rate, rng=rng)
            delay = np.exp(-1j * omega * path[:, None] / self.speed_of_sound)
            total += fft.rfft(drawn, size) * delay / path[:, None]
        noise = fft.irfft(total, size)[:, ahead : ahead + length]
        return noise / np.sqrt(np.mean(np.square(noise)))
