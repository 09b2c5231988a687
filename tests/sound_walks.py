"""How often are sound walks accused? `python tests/sound_walks.py [walks of each kind]`.

Walks through rooms of any size, at levels from 40 to -20 dB, with white noise and under rotors,
with the direct path in the recordings and without it, are written as surveys and examined. Printed
is how many are refused, mended, or told of; of sound walks it must be none. The status is 1 if one
was refused or mended.
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from echolearn.acoustics.types import Array, Pose, Room
from echolearn.simulation.noise.diffuse import Diffuse
from echolearn.simulation.noise.rotor import Rotor
from echolearn.simulation.walk import trajectory
from echolearn.survey.examining import examine
from echolearn.survey.health import Health
from recorded_walks import ARRAY, PROBE, SCENE, write

LEVELS = (40, 20, 10, 0, -5, -10, -20)


def drawn(
    seed: int, *, snr_db: float, rotors: bool, direct: bool, poses: tuple[int, int] = (8, 25)
) -> tuple[Array, list[Pose]]:
    """Draw a room and a walk, and return its recordings (P, M, N) and poses.

    Args:
        seed: of the draw.
        snr_db: level of the sound over that of the noise.
        rotors: whether the noise is that of rotors, else white.
        direct: whether the direct path is in the recordings.
        poses: fewest, and more than most.
    """
    rng = np.random.default_rng(seed)
    room = Room(tuple(rng.uniform([5.0, 5.0, 2.4], [12.0, 10.0, 6.0])), rng.uniform(0.25, 0.5))
    way = trajectory(room, poses=int(rng.integers(*poses)), start=rng.uniform(0.0, 6.0))
    way = [replace(pose, heading=rng.uniform(-np.pi, np.pi)) for pose in way]
    received = np.stack([SCENE.received(room, pose) for pose in way])
    noise = rng.standard_normal(received.shape)
    if rotors:
        draw = {"length": PROBE.length, "sample_rate": PROBE.sample_rate, "rng": rng}
        noise = np.stack([Diffuse(Rotor())(ARRAY, **draw) for _ in way])
    level = received.std() * 10 ** (-snr_db / 20) / noise.std()
    return received - (0.0 if direct else SCENE.direct) + level * noise, way


def examined(seed: int, *, snr_db: float, rotors: bool, direct: bool) -> Health:
    """Draw a walk, write it and examine the survey."""
    sound, poses = drawn(seed, snr_db=snr_db, rotors=rotors, direct=direct)
    with tempfile.TemporaryDirectory() as folder:
        return examine(write(Path(folder), sound, direct=direct, poses=poses))


def main() -> int:
    """Print the table, and each line that was said."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    accused = 0
    print(f"{'noise':8}{'direct path':14}{'walks':>6}{'refused':>9}{'mended':>8}{'told of':>9}")
    for rotors in (False, True):
        for direct in (True, False):
            found = [
                examined(1000 * level + each, snr_db=snr_db, rotors=rotors, direct=direct)
                for level, snr_db in enumerate(LEVELS)
                for each in range(count)
            ]
            kinds = [sum(bool(getattr(x, kind)) for x in found) for kind in KINDS]
            accused += sum(kinds[:2])
            noise, path = ("rotors" if rotors else "white"), ("present" if direct else "removed")
            print(f"{noise:8}{path:14}{len(found):6}{kinds[0]:9}{kinds[1]:8}{kinds[2]:9}")
            for each in found:
                for line in (*each.refused, *each.mended, *each.noticed):
                    print(f"    {line}")
    return int(accused > 0)


KINDS = ("refused", "mended", "noticed")

if __name__ == "__main__":
    sys.exit(main())
