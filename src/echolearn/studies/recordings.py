"""Recordings of one position under one condition: noise at its levels, faults of the array.

    recording = gains * (x - direct + noise)

where x comes from the array as it is, while estimators are told of the array as it should be.
Every recording draws its noise from its own stream of random numbers, whatever the condition, so
that conditions differ in what is varied alone.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.polygon_room import AnyRoom
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Array, MicArray, Observation, Pose
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.observe import NOISE_SECONDS, add_noise, noise_alone
from echolearn.simulation.scene import Scene


@dataclass(frozen=True)
class ArrayFault:
    """What is wrong with an array, without the estimators knowing.

    Attributes:
        dead: number of microphones that record silence, each in turn from position to position.
        gain_db: standard deviation of the microphones' gains, in dB.
        displacement: standard deviation of each coordinate of the microphones, in m.
    """

    dead: int = 0
    gain_db: float = 0.0
    displacement: float = 0.0


FAULTS = {
    "none": ArrayFault(),
    "one_dead": ArrayFault(dead=1),
    "gains_3dB": ArrayFault(gain_db=3.0),
    "positions_5mm": ArrayFault(displacement=0.005),
}


@dataclass(frozen=True)
class Condition:
    """What one value of a study stands for.

    Attributes:
        room: where it takes place.
        levels: levels of the noises, and how many recordings are averaged.
        fault: what is wrong with the array.
        stretch: number of the noise that all recordings share; None is noise of its own for each.
        array: of the robot instead of its scene's.
    """

    room: AnyRoom
    levels: NoiseLevels
    fault: ArrayFault = FAULTS["none"]
    stretch: int | None = None
    array: MicArray | None = None


@dataclass(frozen=True)
class Position:
    """A place of the robot in a study.

    Attributes:
        number: index of the position; with the seed it gives fault and noise-only recording.
        pose: place and heading.
        scene: what the robot carries, as it believes.
    """

    number: int
    pose: Pose
    scene: Scene

    def under(self, condition: Condition) -> "Position":
        """Return it with the array of a condition."""
        array = condition.array or self.scene.array
        return replace(self, scene=replace(self.scene, array=array))


def record(
    position: Position, condition: Condition, *, trials: Sequence[int], seed: int
) -> Observation:
    """Simulate recordings at one position, and learn the noise from a recording of it alone.

    Args:
        position: where, and with what.
        condition: levels, fault, room.
        trials: numbers of the B recordings; each gives its noise, unless the condition names a
            stretch.
        seed: of the study.

    Returns:
        All recordings, samples (B, M, N), with density and covariance of the noise.
    """
    rng = stream(seed, "fault", position.number)
    scene, gains = apply_fault(position, condition.fault, rng=rng)
    room, pose, levels = condition.room, position.pose, condition.levels
    noise = noise_alone(room, pose, scene=scene, seconds=NOISE_SECONDS, levels=levels, rng=rng)
    noise *= gains
    received = scene.received(room, pose)
    samples = []
    for trial in trials:
        rng = stream(seed, "trial", trial)
        if condition.stretch is not None:
            rng = stream(seed, "stretch", condition.stretch)
        samples.append(gains * add_noise(received, scene, levels=levels, rng=rng))
    believed = position.scene
    return Observation(
        np.stack(samples),
        believed.probe,
        believed.array,
        believed.speed_of_sound,
        noise_psd=signals.noise_psd(noise),
        noise_covariance=signals.noise_covariance(noise),
    )


def apply_fault(
    position: Position, fault: ArrayFault, *, rng: np.random.Generator
) -> tuple[Scene, Array]:
    """Return the scene as it really is, and the gains of its microphones.

    Args:
        position: its number tells which microphones are the dead ones.
        fault: what is wrong.
        rng: draws displacements and gains.

    Returns:
        The scene, and gains of shape (M, 1), 0 of dead microphones.
    """
    scene = position.scene
    positions = scene.array.positions

    # Both are always drawn, so that one fault's numbers do not hang on another's size.
    displaced = MicArray(positions + fault.displacement * rng.standard_normal(positions.shape))
    gains = 10.0 ** (fault.gain_db * rng.standard_normal((len(positions), 1)) / 20.0)

    gains[(position.number + np.arange(fault.dead)) % len(positions)] = 0.0
    return replace(scene, array=displaced) if fault.displacement else scene, gains
