"""A robot before it has recorded anything: `robot.yaml`, what `survey.yaml` says of the robot.

    sample_rate          Hz, of what will be recorded
    microphones          M x 3, m, robot frame; the first is the reference
    loudspeaker          3, m, robot frame
    speed_of_sound       m/s; 343 unless given
    probe                WAV beside it: the burst, then silence up to the length of a recording;
                         probe.wav unless given

So the keys, but for `probe`, can be copied into the `survey.yaml` of its first walk.
"""

from pathlib import Path
from typing import Any

from echolearn.acoustics.types import SPEED_OF_SOUND, MicArray
from echolearn.checks import check, check_text
from echolearn.survey import audio
from echolearn.survey.containers import Containers, numbers_of
from echolearn.survey.description import TABLE, read_keys
from echolearn.survey.placed_array import check_places
from echolearn.survey.reader import read_probe
from echolearn.survey.survey import Survey

KEYS = ("sample_rate", "speed_of_sound", "microphones", "loudspeaker")
"""Keys that `survey.yaml` has as well."""

ROBOT: dict[str, Any] = {key: TABLE[key] for key in KEYS} | {"probe": check_text}
"""Keys of `robot.yaml`, each with its check."""

OPTIONAL = {"speed_of_sound": SPEED_OF_SOUND, "probe": "probe.wav"}
"""Keys that may be missing or null, and what is then read."""


def read_robot(path: Path) -> Survey:
    """Return what describes a robot as a walk without a pose.

    Raises:
        BadValue: a file that cannot be read, a key that is missing, unknown or malformed, places
            that no array has, or a burst without silence after it.
    """
    path = Path(path)
    allowed = "must be a file that describes a robot"
    hint = "a folder of recordings is survey=" if path.is_dir() else "there is no such file"
    inside = path / "robot.yaml"
    hint = f"is it {inside}?" if inside.is_file() else hint
    check(path.is_file(), "robot", path, allowed=allowed, hint=hint)
    hint = f"{path.name} has what survey.yaml says of the robot, and probe"
    about = read_keys(path, ROBOT, optional=OPTIONAL, hint=hint)
    places = about["microphones"] - about["loudspeaker"]
    check_places(f"{path} microphones", places)

    file = path.parent / about["probe"]
    stored = numbers_of([audio.undecided_words(file)])
    probe = read_probe(file, about["sample_rate"], scale=stored.scale)
    burst = len(probe.samples)
    allowed = "must be the burst, then silence up to the length of a recording"
    hint = "echoes come after it"
    check(burst < probe.length, str(file), f"{burst} samples", allowed=allowed, hint=hint)
    return Survey(
        folder=path,
        probe=probe,
        array=MicArray(places),
        speed_of_sound=about["speed_of_sound"],
        poses=(),
        files=(),
        numbers=(),
        walls=None,
        conditions={},
        containers=Containers(probe=stored),
    )
