"""One recording by one call, for a first look: `echolearn.simulate`."""

from collections.abc import Sequence

import numpy as np

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import MicArray, Observation, Pose, Room, Truth
from echolearn.checks import check_list, check_whole
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.white import White
from echolearn.simulation.observe import observe
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene

RINGS = 0.5
"""Reverberation time in s of a room of which the size alone is told."""


def simulate(
    room: Room | Sequence[float],
    pose: Pose | Sequence[float],
    *,
    snr_db: float = 10.0,
    array: MicArray | None = None,
    seed: int = 0,
) -> tuple[Observation, Truth]:
    """Simulate what a robot hears at a pose, and what is true there.

    Args:
        room: a `Room`, or length, width and height in m; then it rings for 0.5 s.
        pose: a `Pose`, or x, y in m and heading in rad; then half as high as the room.
        snr_db: received probe over white noise, at microphone 1.
        array: microphones; None is a ring of six, 0.2 m in radius.
        seed: of burst and noise.
    """
    check_whole("seed", seed, low=0, high=2**31)
    if not isinstance(room, Room):
        check_list("room", room, length=3, allowed="must be length, width and height in m")
        length, width, height = map(float, room)
        room = Room((length, width, height), RINGS)
    if not isinstance(pose, Pose):
        check_list("pose", pose, length=3, allowed="must be x and y in m, heading in rad")
        x, y, heading = map(float, pose)
        pose = Pose(np.array([x, y, room.size[2] / 2]), heading)

    scene = Scene(array or circular_array(), noise_probe(seed=seed), Images(), White())
    # Another stream than that of the burst, which would be heard in the noise.
    rng = np.random.default_rng([seed, 1])
    return observe(room, pose, scene=scene, levels=NoiseLevels(snr_db), rng=rng)
