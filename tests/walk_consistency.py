"""How often are poses found out that are not meant so? `python tests/walk_consistency.py [walks]`.

Walks of 24 poses through rooms of any size are simulated and recorded at 20 or 0 dB; then their
poses, or the order of microphones, are spoiled in each way. Printed is how often the first of what
is said names the fault, how often something else is said, and how often sound walks are accused.
"""

import sys

import numpy as np

from echolearn.acoustics.types import Array, Pose, Room
from echolearn.survey.arrivals import arrivals
from echolearn.survey.consistency import Heard, inconsistency
from echolearn.survey.exchange import strongest
from recorded_walks import PROBE, SCENE

COUNT = 24
SCALE = PROBE.sample_rate / 343.0
AFTER = 64
"""Samples after which echoes begin."""


def way(room: Array, rng: np.random.Generator) -> list[Pose]:
    """Return the poses of a robot that wanders, 0.6 m off the walls at least."""
    step = rng.uniform(0.1, 0.35)
    place = rng.uniform(1.0, room - 1.0)
    heading = rng.uniform(-np.pi, np.pi)
    poses = []
    for _ in range(COUNT):
        poses.append(Pose(np.array([*place[:2], 1.2]), heading))
        for _ in range(50):
            turn = heading + rng.normal(0.0, 0.3)
            ahead = place[:2] + step * np.array([np.cos(turn), np.sin(turn)])
            if (ahead > 0.6).all() and (ahead < room[:2] - 0.6).all():
                place[:2], heading = ahead, turn
                break
            heading += rng.normal(0.0, 1.0)
    return poses


def heard(rng: np.random.Generator) -> Heard:
    """Draw a room and a walk, and return what the recordings hear."""
    size = rng.uniform([3.5, 3.5, 2.4], [9.0, 7.0, 4.5])
    room = Room(tuple(size), rng.uniform(0.15, 0.5))
    poses = way(size, rng)
    echoes = []
    for pose in poses:
        sound = SCENE.received(room, pose) - SCENE.direct
        noise = sound.std() * rng.standard_normal(sound.shape) * rng.choice([0.1, 1.0])
        found = arrivals(sound + noise, PROBE)
        outputs = found.outputs[:, found.zero + AFTER :]
        echoes.append(strongest(outputs, found.noise, positions=SCALE * SCENE.array.positions))
    return Heard(
        np.array([pose.position[:2] for pose in poses]),
        np.array([pose.heading for pose in poses]),
        (np.array([each.lag for each in echoes]) + AFTER) / SCALE / 2,
        np.array([each.azimuth for each in echoes]),
    )


FAULTS = {
    "sound": (lambda x: x, ""),
    "feet": (lambda x: x._replace(places=x.places / 0.3048), "feet"),
    "compass": (lambda x: x._replace(headings=np.pi / 2 - x.headings), "compass"),
    "headings in turns": (lambda x: x._replace(headings=x.headings / (2 * np.pi)), "in turns"),
    "headings from y": (lambda x: x._replace(headings=x.headings + np.pi / 2), "counted from x"),
    "ring turned by one": (lambda x: x._replace(azimuth=x.azimuth + np.pi / 3), "microphone 1"),
    "ring mirrored": (lambda x: x._replace(azimuth=-x.azimuth), "other way round"),
    "x and y exchanged": (lambda x: x._replace(places=x.places[:, ::-1]), "x and y"),
    "one row off": (
        lambda x: x._replace(places=np.roll(x.places, 1, 0), headings=np.roll(x.headings, 1)),
        "one row off",
    ),
}


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    rng = np.random.default_rng(0)
    walks = [heard(rng) for _ in range(count)]
    print(f"{'fault':20}{'named':>8}{'other':>8}{'silent':>8}  of {count} walks of {COUNT} poses")
    for fault, (change, word) in FAULTS.items():
        said = [inconsistency(change(walk)) for walk in walks]
        named = sum(bool(word) and word in line for line in said)
        spoken = sum(map(bool, said))
        print(f"{fault:20}{named:8}{spoken - named:8}{count - spoken:8}")


if __name__ == "__main__":
    main()
