"""A small survey, written by hand: two poses, three microphones, 400 samples."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.rooms import outline
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Pose, Room
from echolearn.survey.audio import wav_bytes
from echolearn.survey.description import description_bytes
from echolearn.survey.poses import poses_csv

PROBE = noise_probe(burst=100, length=400)
ARRAY = circular_array(microphones=3)
ROOM = Room((5.0, 4.0, 3.0), 0.25)
POSES = (Pose(np.array([1.0, 2.0, 1.5]), 0.1), Pose(np.array([1.1, 1 / 3, 1.5]), -3.0))
FILES = ("observations/0.wav", "observations/1.wav")
SAMPLES = np.random.default_rng(0).standard_normal((2, 3, 400)).astype(np.float32)
CONDITIONS = {"snr_db": 3.0, "noise": "white"}


def write_small(folder: Path) -> Path:
    """Write the survey."""
    (folder / "observations").mkdir(parents=True)
    walls = outline(ROOM)
    about = description_bytes(
        ARRAY, PROBE, speed_of_sound=340.0, walls=walls, conditions=CONDITIONS
    )
    (folder / "survey.yaml").write_bytes(about)
    (folder / "probe.wav").write_bytes(wav_bytes(np.pad(PROBE.samples, (0, 300)), 22050.0))
    (folder / "poses.csv").write_bytes(poses_csv(POSES, FILES))
    for name, samples in zip(FILES, SAMPLES, strict=True):
        (folder / name).write_bytes(wav_bytes(samples, 22050.0))
    return folder


class Plain(yaml.SafeDumper):
    """Writes equal lists out instead of naming the first."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def edit(folder: Path, **changes: Any) -> None:
    """Change keys of `survey.yaml`; ... removes one."""
    path = folder / "survey.yaml"
    about = yaml.safe_load(path.read_text()) | changes
    about = {key: value for key, value in about.items() if value is not ...}
    path.write_text(yaml.dump(about, Dumper=Plain, width=99999))
