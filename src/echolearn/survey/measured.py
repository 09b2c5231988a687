"""Published measurements of rooms: responses from a loudspeaker's places to an array, and truth.

    folder --MeasuredSource.read--> Measurements --takes--> recordings, true echoes (`protocols`)

A source is one module of `survey/sources`: it knows how a published set lies in its folder, and
what is wrong with a copy of it. Times in a response are those of its file; `emitted` tells where in
it the sound left the loudspeaker.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from echolearn.acoustics.types import Array, MicArray, Pose, Truth
from echolearn.checks import BadValue, check
from echolearn.storage.files import one_line
from echolearn.survey import wav
from echolearn.survey.audio import LARGEST, check_size

POINTER = b"version https://git-lfs"
"""Beginning of what Git LFS leaves where a file was not downloaded."""


@dataclass(frozen=True)
class Response:
    """Impulse responses from one place of a loudspeaker to M microphones.

    Attributes:
        place: name of the loudspeaker's place, or of the array's where that is what changes.
        condition: state of the room.
        samples: responses, shape (M, K).
        emitted: time in the file at which the sound left the loudspeaker, in s; negative before its
            first sample.
        loudspeaker: in the robot's frame, shape (3,), in m.
        truth: true echoes, times from the emission; directions are NaN where they are not known.
        pose: of the array in the room.
    """

    place: str
    condition: str
    samples: Array
    emitted: float
    loudspeaker: Array
    truth: Truth
    pose: Pose

    @property
    def distance(self) -> float:
        """Way from the loudspeaker to the middle of the array, in m."""
        return float(np.linalg.norm(self.loudspeaker))


@dataclass(frozen=True)
class Measurements:
    """A published set of responses.

    Attributes:
        name: short name of the source.
        responses: in the order of their recordings.
        array: the microphones, around the middle of the array.
        sample_rate: in Hz.
        speed_of_sound: in m/s.
        credits: `title`, `licence`, `attribution`, `changes`, as the licence wants them told.
        within: path in m, from and to, of which a recording needs a true echo; None keeps all.
        remark: a line on what was read, for the screen.
    """

    name: str
    responses: Sequence[Response]
    array: MicArray
    sample_rate: float
    speed_of_sound: float
    credits: Mapping[str, str]
    within: tuple[float, float] | None = None
    remark: str = ""


class MeasuredSource(Protocol):
    """What reads a published set from a folder."""

    def read(self, folder: Path | None) -> Measurements:
        """Return what the folder holds; without one, what comes with echolearn.

        Raises:
            BadValue: no such folder, a file that is missing or broken, or nothing comes with it.
        """


def checked_folder(folder: Path, *, inside: str, repository: str) -> Path:
    """Return where in a checkout the measurements lie.

    Args:
        folder: the checkout.
        inside: path of a file or folder in it.
        repository: what should be checked out.

    Raises:
        BadValue: there is no such path.
    """
    place = Path(folder) / inside
    hint = "there is no such folder" if not Path(folder).is_dir() else f"it has no {inside}"
    allowed = f"must be a checkout of {repository}"
    check(place.exists(), "folder", folder, allowed=allowed, hint=hint)
    return place


def read_response(path: Path) -> tuple[float, Array]:
    """Return sample rate in Hz and samples (M, K) of a WAV file.

    Raises:
        BadValue: it is missing, what Git LFS leaves in place of it, no WAV, or not finite.
    """
    check(path.is_file(), str(path), "missing", allowed="must be a file", hint="a partial copy?")
    check_size(path, LARGEST)
    try:
        content = path.read_bytes()
        mend = "run git lfs pull in the checkout"
        check(
            not content.startswith(POINTER),
            str(path),
            "a pointer of Git LFS",
            allowed="must be the file",
            hint=mend,
        )
        rate, samples = wav.read(content)
    except BadValue:
        raise
    except (OSError, ValueError) as error:
        raise BadValue(f"{path}: cannot be read as WAV ({one_line(error)}); a cut copy?") from None
    finite = bool(np.isfinite(samples).all()) and bool(samples.any(axis=-1).all())
    allowed = "must be finite samples, none of its channels silent"
    check(finite, str(path), "NaN, infinity or silence", allowed=allowed, hint="a broken copy?")
    return float(rate), samples
