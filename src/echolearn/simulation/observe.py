"""Simulate what the robot hears: room + pose + noise -> Observation and Truth.

    y_m = gain (x_m - direct_m + f1_m + f2_m),      x_m = h_m * s  (Eq. 1)

The direct path is removed by subtracting the anechoic response, which the known geometry of the
array gives exactly; the noises f1 and f2 have the levels that `levels` explains.
"""

import numpy as np

from echolearn.acoustics.geometry import check_inside, true_echoes
from echolearn.acoustics.types import (
    Array,
    Observation,
    Pose,
    Room,
    Truth,
)
from echolearn.checks import check_number
from echolearn.simulation.levels import check_pings, noises
from echolearn.simulation.scene import Scene

NOISE_SECONDS = 4.0
"""Length of a recording of the noise alone, where no other is asked for."""


def add_noise(
    received: Array,
    scene: Scene,
    *,
    snr_db: float | None,
    gain_db: float,
    rng: np.random.Generator,
    sdnr_db: float | None = None,
    pings: int = 1,
) -> Array:
    """Remove the direct path from `received` (M, N), add noise at its levels, apply a recording
    gain.

    Args:
        received: probe as received, direct path included, shape (M, N).
        scene: gives the direct path and the noise.
        snr_db: received probe over sensor noise, per microphone, or None for no such noise.
        gain_db: gain of the recording, signal and noise alike.
        rng: draws the noise.
        sdnr_db: received probe over diffuse noise at microphone 1, or None for no such noise.
        pings: K, how many recordings are averaged; the levels are those of one.
    """
    levels = {"snr_db": snr_db, "sdnr_db": sdnr_db}
    noise = noises(received, scene, length=scene.probe.length, rng=rng, pings=pings, **levels)
    return 10.0 ** (gain_db / 20.0) * (received - scene.direct + noise)


def noise_alone(
    room: Room,
    pose: Pose,
    scene: Scene,
    *,
    seconds: float,
    snr_db: float | None,
    rng: np.random.Generator,
    sdnr_db: float | None = None,
    pings: int = 1,
) -> Array:
    """Record the noise while the loudspeaker is silent: what an estimator may learn the noise's
    spectrum from.

    Args:
        room, pose: where; the levels are those that `observe` would have there.
        scene: what the robot carries.
        seconds: length of the recording.
        snr_db, sdnr_db: see the module's header.
        rng: draws the noise; one that has not drawn an observation, or the two are not independent.
        pings: K, how many recordings are averaged in the observations. One stretch is recorded and
            divided by sqrt(K), so that its density is that of the noise which is left in their
            mean.

    Returns:
        Samples, shape (M, round(seconds * sample_rate)).
    """
    check_number("noise_seconds", seconds, low=0.1, high=600.0, unit="s")
    check_inside(room, scene.array, pose)
    length = round(seconds * scene.probe.sample_rate)
    check_pings(pings)
    heard = noises(
        scene.received(room, pose), scene, length=length, snr_db=snr_db, sdnr_db=sdnr_db, rng=rng
    )
    return heard / np.sqrt(pings)


def observe(
    room: Room,
    pose: Pose,
    scene: Scene,
    *,
    snr_db: float | None,
    rng: np.random.Generator,
    gain_db: float = 0.0,
    sdnr_db: float | None = None,
    pings: int = 1,
) -> tuple[Observation, Truth]:
    """Simulate one observation.

    Args:
        room: a shoebox.
        pose: the whole array must lie inside the room.
        scene: what the robot carries, engine and noise.
        snr_db: of the sensor noise, see the module's header; None is no such noise.
        rng: draws the noise.
        gain_db: gain of the recording.
        sdnr_db: of the diffuse noise; None is no such noise.
        pings: K, how many recordings are averaged at the pose; the levels are those of one.

    Returns:
        The observation, samples (M, N) with the direct path removed, and the truth.

    Raises:
        BadValue: a microphone outside the room.
    """
    check_inside(room, scene.array, pose)
    received = scene.received(room, pose)
    samples = add_noise(
        received, scene, snr_db=snr_db, gain_db=gain_db, rng=rng, sdnr_db=sdnr_db, pings=pings
    )
    truth = true_echoes(room, pose, scene.array, scene.speed_of_sound)
    return Observation(samples, scene.probe, scene.array, scene.speed_of_sound), truth
