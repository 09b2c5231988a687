"""The recorded-survey format: a folder by which real robots and simulated ones come in through the same door.

    survey.yaml          sample_rate, speed_of_sound, microphones (M x 3, m, robot frame), loudspeaker (3, m),
                         direct_path: removed | present, optional walls: outline (C x 2, m) for scoring,
                         optional conditions: whatever is known of how it was recorded (snr_db, noise, ...)
    probe.wav            the burst, one channel, followed by silence up to the length of a recording
    poses.csv            index,x_m,y_m,z_m,heading_rad,file
    observations/*.wav   M channels each, float32 or PCM

Positions are of the loudspeaker in the room's frame; times count from the emission.
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO, StringIO
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy.io import wavfile

from echolearn.types import Array, BadValue, MicArray, Observation, Pose, Probe, check

HEADER = ("index", "x_m", "y_m", "z_m", "heading_rad", "file")


@dataclass(frozen=True)
class Survey:
    """A recorded walk.

    Attributes:
        folder: where it lies.
        probe: what was emitted.
        array: the microphones.
        speed_of_sound: in m/s.
        poses: P poses.
        files: recording of each pose, relative to `folder`.
        walls: outline of the room, shape (C, 2), in m, or None.
        conditions: what is known of the recording.
    """

    folder: Path
    probe: Probe
    array: MicArray
    speed_of_sound: float
    poses: tuple[Pose, ...]
    files: tuple[str, ...]
    walls: Array | None
    conditions: Mapping[str, Any]

    def observe(self, poses: Sequence[int]) -> Observation:
        """Read the recordings of the numbered poses, samples (B, M, N).

        Raises:
            BadValue: a recording that is missing, has another sample rate, number of channels or length, or NaN.
        """
        samples = np.stack([self._read(self.files[pose]) for pose in poses])
        return Observation(samples, self.probe, self.array, self.speed_of_sound)

    def _read(self, name: str) -> Array:
        path = self.folder / name
        samples = read_wav(path, self.probe.sample_rate)
        expected = (len(self.array), self.probe.length)
        check(samples.shape == expected, str(path), samples.shape, allowed=f"{expected[0]} channels of {expected[1]} samples")
        check(bool(np.isfinite(samples).all()), str(path), "NaN or infinity", allowed="finite samples")
        return samples


def wav_bytes(samples: Array, sample_rate: float) -> bytes:
    """Return `samples` (M, N) or (N,) as a float32 WAV file."""
    buffer = BytesIO()
    wavfile.write(buffer, round(sample_rate), np.ascontiguousarray(samples.T, dtype=np.float32))
    return buffer.getvalue()


def read_wav(path: Path, sample_rate: float) -> Array:
    """Return a WAV file's samples as float64, shape (M, N), PCM scaled to -1 ... 1.

    Raises:
        BadValue: not a WAV file, or its sample rate is not `sample_rate` Hz.
    """
    try:
        rate, samples = wavfile.read(path)
    except (OSError, ValueError) as error:
        raise BadValue(f"{path}: cannot be read as WAV ({error})") from None
    check(rate == sample_rate, f"{path} sample_rate", f"{rate} Hz", allowed=f"{sample_rate:g} Hz", hint="resample the recording")
    full_scale = np.iinfo(samples.dtype).max + 1.0 if samples.dtype.kind == "i" else 1.0
    return np.atleast_2d(samples.T).astype(float) / full_scale


def poses_csv(poses: Sequence[Pose], files: Sequence[str]) -> bytes:
    """Return the text of `poses.csv`."""
    text = StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(HEADER)
    for index, (pose, file) in enumerate(zip(poses, files, strict=True)):
        rows.writerow([index, *map(float, pose.position), float(pose.heading), file])
    return text.getvalue().encode()


def describe(array: MicArray, probe: Probe, *, speed_of_sound: float, walls: Array, conditions: Mapping[str, Any]) -> bytes:
    """Return the text of `survey.yaml` for recordings whose direct path has been removed."""
    content = {
        "sample_rate": float(probe.sample_rate),
        "speed_of_sound": float(speed_of_sound),
        "microphones": array.positions.tolist(),
        "loudspeaker": [0.0, 0.0, 0.0],
        "direct_path": "removed",
        "walls": np.asarray(walls).tolist(),
        "conditions": dict(conditions),
    }
    return yaml.safe_dump(content, sort_keys=False).encode()


def read(folder: Path) -> Survey:
    """Open a recorded survey.

    Raises:
        BadValue: a file or key that is missing or malformed, or a direct path still present.
    """
    folder = Path(folder)
    about = _read_yaml(folder / "survey.yaml")
    present = about["direct_path"]
    check(present == "removed", f"{folder}/survey.yaml direct_path", present, allowed="removed", hint="subtract the anechoic response first")
    padded = read_wav(folder / "probe.wav", about["sample_rate"])[0]
    burst = padded[: np.flatnonzero(padded)[-1] + 1] if padded.any() else padded[:0]
    check(len(burst) > 0, f"{folder}/probe.wav", "silence", allowed="the burst that was emitted")
    poses, files = _read_poses(folder / "poses.csv")
    return Survey(
        folder=folder,
        probe=Probe(burst, about["sample_rate"], len(padded)),
        array=MicArray(about["microphones"]),
        speed_of_sound=about["speed_of_sound"],
        poses=poses,
        files=files,
        walls=np.array(about["walls"], dtype=float) if about.get("walls") else None,
        conditions=about.get("conditions") or {},
    )


def _read_yaml(path: Path) -> dict[str, Any]:
    try:
        content = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise BadValue(f"{path}: cannot be read ({' '.join(str(error).split())})") from None
    required = ("sample_rate", "speed_of_sound", "microphones", "loudspeaker", "direct_path")
    missing = [key for key in required if key not in (content or {})]
    check(not missing, str(path), f"without {', '.join(missing)}", allowed=f"a mapping with {', '.join(required)}")
    return dict(content)


def _read_poses(path: Path) -> tuple[tuple[Pose, ...], tuple[str, ...]]:
    try:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
        poses = tuple(Pose(np.array([float(r["x_m"]), float(r["y_m"]), float(r["z_m"])]), float(r["heading_rad"])) for r in rows)
        files = tuple(row["file"] for row in rows)
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise BadValue(f"{path}: cannot be read ({error!r}); its columns are {','.join(HEADER)}") from None
    check(len(poses) > 0, str(path), "no rows", allowed="at least one pose")
    return poses, files
