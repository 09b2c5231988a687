"""Simulate what the robot records: room + pose + noise -> Observation and Truth.

    y_m = gain (x_m - direct_m + f1_m + f2_m),      x_m = h_m * s  (Eq. 1)

The direct path is removed by subtracting the anechoic response, which the known geometry of the
array gives exactly; the noises f1 and f2 have the levels that `levels` explains.
"""

from dataclasses import replace

import numpy as np

from echolearn.acoustics.polygon_room import AnyRoom
from echolearn.acoustics.rooms import check_inside, true_echoes
from echolearn.acoustics.types import Array, Observation, Pose, Truth
from echolearn.checks import check_number
from echolearn.simulation.levels import NoiseLevels, noises
from echolearn.simulation.scene import Scene

NOISE_SECONDS = 4.0
"""Length of a recording of the noise alone, where no other is asked for."""


def observe(
    room: AnyRoom,
    pose: Pose,
    *,
    scene: Scene,
    levels: NoiseLevels,
    rng: np.random.Generator,
    gain_db: float = 0.0,
) -> tuple[Observation, Truth]:
    """Simulate one observation.

    Args:
        room: a box, or of any outline.
        pose: the whole array must lie inside the room.
        scene: what the robot carries, engine and noise.
        levels: levels of the noises, and how many recordings are averaged.
        rng: draws the noise.
        gain_db: gain of the recording, signal and noise alike.

    Returns:
        The observation, samples (M, N) with the direct path removed, and the truth.

    Raises:
        BadValue: a microphone outside the room.
    """
    check_inside(room, pose, array=scene.array)
    received = scene.received(room, pose)
    samples = add_noise(received, scene, levels=levels, rng=rng, gain_db=gain_db)
    truth = true_echoes(room, pose, array=scene.array, speed_of_sound=scene.speed_of_sound)
    return Observation(samples, scene.probe, scene.array, scene.speed_of_sound), truth


def add_noise(
    received: Array,
    scene: Scene,
    *,
    levels: NoiseLevels,
    rng: np.random.Generator,
    gain_db: float = 0.0,
    out: Array | None = None,
) -> Array:
    """Remove the direct path from `received`, add noise, apply a gain; shape (M, N).

    Args:
        received: probe as received, direct path included, shape (M, N).
        scene: gives the direct path and the noise.
        levels: levels of the noises, and how many recordings are averaged.
        rng: draws the noise.
        gain_db: gain of the recording, signal and noise alike.
        out: where the recording is written, shape (M, N); a new array unless given.
    """
    from echolearn.simulation.normal_loops import noisy_recording

    noise = noises(received, scene, length=scene.probe.length, levels=levels, rng=rng)
    gain = 10.0 ** (gain_db / 20.0)
    return noisy_recording(received, scene.beginning, noise=noise, gain=gain, out=out)


def noise_alone(
    room: AnyRoom,
    pose: Pose,
    *,
    scene: Scene,
    seconds: float,
    levels: NoiseLevels,
    rng: np.random.Generator,
) -> Array:
    """Record the noise while the loudspeaker is silent, which shows an estimator its spectrum.

    Args:
        room, pose: where; the levels are those that `observe` would have there.
        scene: what the robot carries.
        seconds: length of the recording.
        levels: levels of the noises. Where the observations are means of K pings, one stretch is
            recorded and divided by sqrt(K): its density is that of the noise left in a mean.
        rng: draws the noise; one that has not drawn an observation, or the two are not independent.

    Returns:
        Samples, shape (M, round(seconds * sample_rate)).
    """
    check_number("noise_seconds", seconds, low=0.1, high=600.0, unit="s")
    check_inside(room, pose, array=scene.array)
    length = round(seconds * scene.probe.sample_rate)
    received = scene.received(room, pose)
    single = replace(levels, pings=1)
    return noises(received, scene, length=length, levels=single, rng=rng) / np.sqrt(levels.pings)
