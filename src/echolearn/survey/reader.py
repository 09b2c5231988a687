"""The recorded-survey format, by which real and simulated robots come in through the same door.

    survey.yaml          what describes it (`description.py`): sample_rate, speed_of_sound,
                         microphones (M x 3, m, robot frame), loudspeaker (3, m),
                         direct_path: removed | present (it is removed when read, `direct_path.py`),
                         optional walls: floor plan (`floor_plan.py`, m),
                         optional heading_bias_sd_rad: of an error common to all headings,
                         optional map: false where echoes are times and directions only,
                         optional conditions: whatever is known of how it was recorded (snr_db,
                         noise, ...)
    probe.wav            the burst, one channel, then silence up to the length of a recording
    poses.csv            index,x_m,y_m,z_m,heading_rad,file (`poses.py`)
    truth.csv            optional: true echoes of the poses (`truth.py`)
    observations/*       M channels each, WAV (float32 or PCM) or FLAC
    noise.wav            optional: M channels of noise alone, of any length, the loudspeaker silent
    calibration.wav      optional, if the direct path is present: M channels of it alone, recorded
                         in a free room

Positions are of the loudspeaker in the room's frame, or of the robot where a loudspeaker moves on
its own and has columns of its own; times count from the emission.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from echolearn.acoustics.types import LONGEST, Array, MicArray, Pose, Probe
from echolearn.checks import check
from echolearn.storage.kinds import check_kind
from echolearn.survey import audio
from echolearn.survey.containers import Containers, numbers_of
from echolearn.survey.description import read_description
from echolearn.survey.poses import Poses, read_poses
from echolearn.survey.survey import CALIBRATION, NOISE, Survey
from echolearn.survey.truth import TRUTH, read_truth

FORMAT = "must be a folder in the recorded-survey format"
INSIDE = "must be a path inside the survey's folder"


def lies_inside(folder: Path, name: str) -> bool:
    """Tell whether a file of a survey lies in its folder, links followed."""
    if "\0" in name:
        return False
    try:
        return (folder / name).resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError):  # links in a circle
        return False


def read_survey(folder: Path) -> Survey:
    """Open a recorded survey.

    Raises:
        BadValue: as `read_described`, or of its poses or their truth.
    """
    survey = with_poses(read_described(folder), read_poses(Path(folder) / "poses.csv"))
    truth = survey.folder / TRUTH
    if truth.exists():
        survey = replace(survey, truth=read_truth(truth, survey.numbers))
    return survey


def with_poses(described: Survey, walked: Poses) -> Survey:
    """Return a survey that was described, with these poses.

    Raises:
        BadValue: a recording that lies elsewhere.
    """
    for file in dict.fromkeys(walked.files):
        _check_inside(described.folder, file)
    return replace(
        described,
        poses=walked.poses,
        files=walked.files,
        numbers=walked.numbers,
        loudspeakers=_carried_to(walked.loudspeakers, walked.poses),
        further=walked.further,
    )


def read_described(folder: Path) -> Survey:
    """Return what describes a recorded survey, without a pose.

    Raises:
        BadValue: a file or key that is missing or malformed; or a calibration where there is no
            direct path.
    """
    folder = Path(folder)
    check_kind("survey", folder, wanted="survey", allowed=FORMAT)
    # A link could make the map a copy of any file of this machine.
    for name in ("survey.yaml", "probe.wav", "poses.csv", NOISE, CALIBRATION, TRUTH):
        check(lies_inside(folder, name), f"{folder}/{name}", "a link", allowed=INSIDE)

    about = read_description(folder / "survey.yaml")
    present = about["direct_path"] == "present"
    calibrated = (folder / CALIBRATION).exists()
    name = f"{folder}/{CALIBRATION} direct_path"
    hint = "there is none to remove"
    check(present or not calibrated, name, "removed", allowed="must be present", hint=hint)

    probe = folder / "probe.wav"
    stored = numbers_of([audio.undecided_words(probe)])
    return Survey(
        folder=folder,
        probe=read_probe(probe, about["sample_rate"], scale=stored.scale),
        array=MicArray(about["microphones"] - about["loudspeaker"]),
        speed_of_sound=about["speed_of_sound"],
        poses=(),
        files=(),
        numbers=(),
        walls=about["walls"],
        conditions=about["conditions"],
        heading_bias_sd=float(about["heading_bias_sd_rad"]),
        direct=("calibration" if calibrated else "fir") if present else None,
        containers=Containers(probe=stored),
        mapped=about["map"],
    )


def _check_inside(folder: Path, file: str) -> None:
    """Raise `BadValue` unless a recording lies in the folder of its survey."""
    # Another machine's path, most often: its last part is the name here, too.
    here = f"observations/{Path(file).name}"
    hint = f"is it {here}?" if lies_inside(folder, here) and (folder / here).is_file() else ""
    inside = lies_inside(folder, file)
    check(inside, f"{folder}/poses.csv file", file, allowed=INSIDE, hint=hint)


def _carried_to(places: Array | None, poses: Sequence[Pose]) -> Array | None:
    """Return places (P, 3) of the room's frame in that of the robot at each pose."""
    if places is None:
        return None
    offset = places - np.array([pose.position for pose in poses])
    heading = np.array([pose.heading for pose in poses])
    cos, sin = np.cos(heading), np.sin(heading)
    x, y, z = offset.T
    return np.stack([cos * x + sin * y, cos * y - sin * x, z], axis=-1)


def read_probe(path: Path, sample_rate: float, *, scale: float) -> Probe:
    """Return the burst, and the length of recordings, up to which silence follows it.

    Args:
        path: its file.
        sample_rate: that it must have, in Hz.
        scale: factor of its samples.
    """
    padded = audio.read_wav(path, sample_rate)
    length = padded.shape[1]
    check(length <= LONGEST, str(path), f"{length} samples", allowed=f"must be at most {LONGEST}")
    return Probe(scale * audio.burst_of(padded, name=str(path)), sample_rate, length)
