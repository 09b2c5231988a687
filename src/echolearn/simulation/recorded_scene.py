"""The scene of a recorded survey: simulation with the robot that recorded it, or will.

Before there is a recording, a file that describes the robot (`survey/robot_file.py`) stands for it.
"""

from pathlib import Path

from echolearn.acoustics.types import MicArray, Noise, Probe
from echolearn.checks import check
from echolearn.simulation.scene import Responder, Scene
from echolearn.storage.kinds import check_kind
from echolearn.survey.reader import read_survey
from echolearn.survey.robot_file import read_robot
from echolearn.survey.survey import Survey


def recorded_scene(
    *,
    folder: str,
    array: MicArray,
    probe: Probe,
    rir: Responder,
    noise: Noise,
    diffuse: Noise | None = None,
    speed_of_sound: float | None = None,
) -> Scene:
    """Return a scene whose speed of sound, unless given, is that of a survey.

    Args:
        folder: the survey, or the file of a robot.
        array, probe: as `recorded_array` and `recorded_probe` return them of the same survey.
        rir, noise, diffuse: as a scene has them.
        speed_of_sound: in m/s.
    """
    speed = _opened(folder).speed_of_sound if speed_of_sound is None else speed_of_sound
    return Scene(array, probe, rir, noise, speed_of_sound=speed, diffuse=diffuse)


def recorded_array(folder: str | None) -> MicArray:
    """Return the microphones of a survey.

    Raises:
        BadValue: no survey, or none that can be read.
    """
    return _opened(folder).array


def recorded_probe(folder: str | None) -> Probe:
    """Return the burst of a survey's `probe.wav`, and how long its recordings are.

    Raises:
        BadValue: no survey, or none that can be read.
    """
    return _opened(folder).probe


def _opened(folder: str | None) -> Survey:
    """Return the survey that a scene names, or a walk without a pose of the robot that it names."""
    hint = "scene.folder=<folder>"
    allowed = "must be a folder in the recorded-survey format"
    check(bool(folder), "scene.folder", folder, allowed=allowed, hint=hint)
    place = Path(str(folder))
    if place.is_file():
        return read_robot(place)
    check_kind("scene.folder", place, wanted="survey", allowed=allowed)
    return read_survey(place)
