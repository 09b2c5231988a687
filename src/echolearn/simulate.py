"""Simulate what the robot hears: room + pose + noise -> Observation and Truth.

    y_m = gain (x_m - direct_m + v_m),      x_m = h_m * s  (Eq. 1)

The signal-to-noise ratio is that of the *received* probe x_m, direct path included, over all N samples,
against the noise v_m at the same microphone. Then the direct path is removed by subtracting the anechoic
response, which the known geometry of the array gives exactly.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from echolearn import signals
from echolearn.geometry import check_inside, microphone_positions, true_echoes
from echolearn.types import (
    SPEED_OF_SOUND,
    Array,
    MicArray,
    Noise,
    Observation,
    Pose,
    Probe,
    Responder,
    Room,
    Truth,
    check_number,
)


@dataclass(frozen=True)
class Scene:
    """What every observation of a robot shares.

    Attributes:
        array: microphones around the loudspeaker.
        probe: the known burst.
        rir: engine for room impulse responses.
        noise: what the microphones hear besides the probe.
        speed_of_sound: in m/s.
    """

    array: MicArray
    probe: Probe
    rir: Responder
    noise: Noise
    speed_of_sound: float = SPEED_OF_SOUND

    def __post_init__(self) -> None:
        hint = "air is 343 m/s"
        check_number("scene.speed_of_sound", self.speed_of_sound, low=100.0, high=2000.0, unit="m/s", hint=hint)

    @cached_property
    def direct(self) -> Array:
        """Direct path at the microphones, shape (M, N): the same at every pose."""
        hall = Room((20.0, 20.0, 20.0), 1.0)
        return self.received(replace(hall, walls=(0.0,) * 6), Pose(np.array([10.0, 10.0, 10.0])))

    def received(self, room: Room, pose: Pose) -> Array:
        """Return the probe as received, x_m of Eq. 1, without noise, shape (M, N)."""
        response = self.rir(
            room,
            np.asarray(pose.position, dtype=float),
            microphone_positions(self.array, pose),
            sample_rate=self.probe.sample_rate,
            speed_of_sound=self.speed_of_sound,
        )
        return signals.convolve(self.probe.samples, response, self.probe.length)


def add_noise(received: Array, scene: Scene, *, snr_db: float, gain_db: float, rng: np.random.Generator) -> Array:
    """Remove the direct path from `received` (M, N), add noise at `snr_db`, apply a recording gain.

    Args:
        received: probe as received, direct path included, shape (M, N).
        scene: gives the direct path and the noise.
        snr_db: received probe over noise, per microphone.
        gain_db: gain of the recording, signal and noise alike.
        rng: draws the noise.
    """
    noise = scene.noise(scene.array, length=scene.probe.length, sample_rate=scene.probe.sample_rate, rng=rng)
    level = np.sqrt(signals.power(received) * 10.0 ** (-snr_db / 10.0))
    return 10.0 ** (gain_db / 20.0) * (received - scene.direct + level[:, None] * noise)


def observe(
    room: Room, pose: Pose, scene: Scene, *, snr_db: float, rng: np.random.Generator, gain_db: float = 0.0
) -> tuple[Observation, Truth]:
    """Simulate one observation.

    Args:
        room: a shoebox.
        pose: the whole array must lie inside the room.
        scene: what the robot carries, engine and noise.
        snr_db: see the module's header.
        rng: draws the noise.
        gain_db: gain of the recording.

    Returns:
        The observation, samples (M, N) with the direct path removed, and the truth.

    Raises:
        BadValue: a microphone outside the room.
    """
    check_inside(room, scene.array, pose)
    received = scene.received(room, pose)
    samples = add_noise(received, scene, snr_db=snr_db, gain_db=gain_db, rng=rng)
    truth = true_echoes(room, pose, scene.array, scene.speed_of_sound)
    return Observation(samples, scene.probe, scene.array, scene.speed_of_sound), truth
