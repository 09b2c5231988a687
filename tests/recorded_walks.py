"""Walks of a robot, written as surveys: the sound that recordings are spoiled from."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import yaml

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Array, Pose, Room
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.simulation.walk import trajectory
from echolearn.survey import audio
from echolearn.survey.poses import poses_csv
from echolearn.survey.reader import read_survey
from echolearn.survey.survey import Survey

PROBE = noise_probe(length=8000)
ARRAY = circular_array()
ROOM = Room((8.0, 6.0, 5.0), 0.25)
POSES = trajectory(ROOM, poses=8)
TIME = np.arange(PROBE.length) / PROBE.sample_rate
SCENE = Scene(ARRAY, PROBE, Images(), None)  # type: ignore[arg-type]
Change = Callable[[Array], Array]


@cache
def sound(poses: int = len(POSES)) -> Array:
    """Return what a robot hears on its walk, without noise, shape (P, M, N)."""
    return np.stack([SCENE.received(ROOM, pose) for pose in trajectory(ROOM, poses=poses)])


@cache
def walk(*, direct: bool, snr_db: float = 20.0, seed: int = 7, poses: int = len(POSES)) -> Array:
    """Return a walk, the noise measured against the sound with its direct path, (P, M, N).

    Not to be changed. The seed is another than that of the probe, which would be part of the noise.
    """
    received = sound(poses)
    noise = np.random.default_rng(seed).standard_normal(received.shape)
    level = received.std() * 10 ** (-snr_db / 20)
    found = received - (0.0 if direct else SCENE.direct) + level * noise
    found.setflags(write=False)
    return found


def write(folder: Path, samples: Array, *, direct: bool, poses: list[Pose] = POSES) -> Survey:
    """Write a survey of recordings (P, M, N), and open it."""
    (folder / "observations").mkdir(parents=True)
    about = {
        "sample_rate": PROBE.sample_rate,
        "speed_of_sound": 343.0,
        "microphones": ARRAY.positions.tolist(),
        "loudspeaker": [0.0, 0.0, 0.0],
        "direct_path": "present" if direct else "removed",
    }
    (folder / "survey.yaml").write_text(yaml.safe_dump(about))
    silence = PROBE.length - len(PROBE.samples)
    burst = audio.wav_bytes(np.pad(PROBE.samples, (0, silence)), PROBE.sample_rate)
    (folder / "probe.wav").write_bytes(burst)
    names = [f"observations/{number}.wav" for number in range(len(samples))]
    (folder / "poses.csv").write_bytes(poses_csv(poses[: len(samples)], names))
    for name, recording in zip(names, samples, strict=True):
        (folder / name).write_bytes(audio.wav_bytes(recording, PROBE.sample_rate))
    return read_survey(folder)
