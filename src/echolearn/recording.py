"""The recorded-survey format: a folder by which real robots and simulated ones come in through the same door.

    survey.yaml          sample_rate, speed_of_sound, microphones (M x 3, m, robot frame), loudspeaker (3, m),
                         direct_path: removed | present (it is removed when read, `direct.py`),
                         optional walls: outline (C x 2, m) for scoring,
                         optional conditions: whatever is known of how it was recorded (snr_db, noise, ...)
    probe.wav            the burst, one channel, followed by silence up to the length of a recording
    poses.csv            index,x_m,y_m,z_m,heading_rad,file
    observations/*       M channels each, WAV (float32 or PCM) or FLAC
    noise.wav            optional: M channels of noise alone, of any length, the loudspeaker silent

Positions are of the loudspeaker in the room's frame; times count from the emission.
"""

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from echolearn import audio, direct, signals
from echolearn.types import Array, BadValue, MicArray, Observation, Pose, Probe, check, check_number

NOISE = "noise.wav"

LIMITS = {"survey.yaml": 1 << 17, "poses.csv": 4 << 20, ".wav": audio.LARGEST, ".flac": audio.LARGEST}
"""Bytes that a file of a survey may have."""

LONGEST = 1 << 20
"""Samples that a recording of one channel may have."""

DEPTH = 20
"""Brackets within brackets that `survey.yaml` may have; coordinates need two."""

INSIDE = "a path inside the survey's folder"

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
        direct: whether the recordings hold the direct path, which reading removes.
        rate: sample rate in Hz to which recordings and probe are brought when read; None leaves them.
    """

    folder: Path
    probe: Probe
    array: MicArray
    speed_of_sound: float
    poses: tuple[Pose, ...]
    files: tuple[str, ...]
    walls: Array | None
    conditions: Mapping[str, Any]
    direct: bool = False
    rate: float | None = None

    def observe(self, poses: Sequence[int]) -> Observation:
        """Read the recordings of the numbered poses, samples (B, M, N), without the direct path.

        What `noise.wav` tells of the noise goes with them, for localizers that whiten.

        Raises:
            BadValue: a recording that is missing, has another sample rate, number of channels or length, or NaN.
        """
        samples = np.stack([self._read(self.files[pose]) for pose in poses])
        if self.direct:
            samples = direct.remove(samples, self.probe, self.array, speed_of_sound=self.speed_of_sound)
        observation = Observation(samples, self.probe, self.array, self.speed_of_sound)
        heard = observation if self.rate in (None, self.probe.sample_rate) else resampled(observation, self.rate)
        psd, covariance = self.noise_statistics
        return replace(heard, noise_psd=psd, noise_covariance=covariance)

    @cached_property
    def noise_statistics(self) -> tuple[Array, Array] | tuple[None, None]:
        """Density and covariance of the noise alone, at the rate of what is read; None where it was not recorded."""
        alone = self.noise()
        if alone is None:
            return None, None
        if self.rate not in (None, self.probe.sample_rate):
            alone = resampled(Observation(alone, self.probe, self.array), self.rate).samples
        return signals.noise_psd(alone), signals.noise_covariance(alone)

    def noise(self) -> Array | None:
        """Read the noise alone, shape (M, K), or None where it was not recorded.

        Raises:
            BadValue: as `observe`, or fewer samples than an observation has.
        """
        path = self.folder / NOISE
        if not path.exists():
            return None
        check(inside(self.folder, NOISE), str(path), "a link", allowed=INSIDE)
        samples = audio.read_wav(path, self.probe.sample_rate)
        channels, length = len(self.array), self.probe.length
        allowed = f"{channels} channels of at least {length} samples"
        check(samples.shape[0] == channels and samples.shape[1] >= length, str(path), samples.shape, allowed=allowed)
        return samples

    def _read(self, name: str) -> Array:
        path = self.folder / name
        check(inside(self.folder, name), f"{self.folder}/poses.csv file", name, allowed=INSIDE)
        expected = (len(self.array), self.probe.length)
        samples = audio.read(path, self.probe.sample_rate, shape=expected)
        check(bool(samples.any()), str(path), "silence", allowed="a recording", hint="was the recorder running?")
        return samples


def resampled(observation: Observation, rate: float | None) -> Observation:
    """Return recordings and probe at another sample rate in Hz, by a polyphase filter without delay."""
    from scipy.signal import resample_poly

    probe = observation.probe
    ratio = Fraction(float(rate or 0.0) / probe.sample_rate).limit_denominator(10_000)
    check(ratio > 0, "rate", f"{rate} Hz", allowed="a sample rate")
    samples = resample_poly(observation.samples, ratio.numerator, ratio.denominator, axis=-1)
    padded = np.pad(probe.samples, (0, min(100, probe.length - len(probe.samples))))
    burst = resample_poly(padded, ratio.numerator, ratio.denominator)
    return replace(observation, samples=samples, probe=Probe(burst, float(rate or 0.0), samples.shape[-1]))


def inside(folder: Path, name: str) -> bool:
    """Tell whether a file of a survey lies in its folder, links followed."""
    return "\0" not in name and (folder / name).resolve().is_relative_to(folder.resolve())


def poses_csv(poses: Sequence[Pose], files: Sequence[str]) -> bytes:
    """Return the text of `poses.csv`."""
    text = StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(HEADER)
    for index, (pose, file) in enumerate(zip(poses, files, strict=True)):
        rows.writerow([index, *map(float, pose.position), float(pose.heading), file])
    return text.getvalue().encode()


def describe(
    array: MicArray, probe: Probe, *, speed_of_sound: float, walls: Array, conditions: Mapping[str, Any]
) -> bytes:
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
        BadValue: a file or key that is missing or malformed.
    """
    folder = Path(folder)
    for name in ("survey.yaml", "probe.wav", "poses.csv"):
        check(inside(folder, name), f"{folder}/{name}", "a link", allowed=INSIDE)
    about = _read_yaml(folder / "survey.yaml")
    padded = audio.read_wav(folder / "probe.wav", about["sample_rate"])[0]
    burst = padded[: np.flatnonzero(padded)[-1] + 1] if padded.any() else padded[:0]
    check(len(burst) > 0, f"{folder}/probe.wav", "silence", allowed="the burst that was emitted")
    check(len(padded) <= LONGEST, f"{folder}/probe.wav", f"{len(padded)} samples", allowed=f"at most {LONGEST}")
    poses, files = _read_poses(folder / "poses.csv")
    return Survey(
        folder=folder,
        probe=Probe(burst, about["sample_rate"], len(padded)),
        array=MicArray(about["microphones"] - about["loudspeaker"]),
        speed_of_sound=about["speed_of_sound"],
        poses=poses,
        files=files,
        walls=about.get("walls"),
        conditions=about.get("conditions") or {},
        direct=about["direct_path"] == "present",
    )


def _read_yaml(path: Path) -> dict[str, Any]:
    audio.check_size(path, LIMITS["survey.yaml"])
    try:
        text = path.read_text()
        _check_plain(text)
        content = yaml.safe_load(text)
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise BadValue(f"{path}: cannot be read ({' '.join(str(error).split())})") from None
    required = ("sample_rate", "speed_of_sound", "microphones", "loudspeaker", "direct_path")
    missing = [key for key in required if not isinstance(content, dict) or key not in content]
    check(not missing, str(path), f"without {', '.join(missing)}", allowed=f"a mapping with {', '.join(required)}")
    present, conditions = content["direct_path"], content.get("conditions") or {}
    check(present in ("removed", "present"), f"{path} direct_path", present, allowed="removed or present")
    check(isinstance(conditions, dict), f"{path} conditions", conditions, allowed="a mapping")
    check_number(f"{path} sample_rate", content["sample_rate"], low=1000.0, high=400_000.0, unit="Hz")
    check_number(
        f"{path} speed_of_sound", content["speed_of_sound"], low=100.0, high=2000.0, unit="m/s", hint="air is 343 m/s"
    )
    shapes = {"microphones": (-1, 3), "loudspeaker": (3,)} | ({"walls": (-1, 2)} if content.get("walls") else {})
    return {**content, **{key: _metres(content[key], f"{path} {key}", shape) for key, shape in shapes.items()}}


def _check_plain(text: str) -> None:
    """Raise `ValueError` for YAML of little text that takes endless time or memory: deep nesting, and aliases."""
    depth = deepest = 0
    for character in text:
        depth += (character in "[{") - (character in "]}")
        deepest = max(deepest, depth)
    if deepest > DEPTH:
        raise ValueError(f"it is nested more than {DEPTH} deep")
    if any(isinstance(token, yaml.AliasToken) for token in yaml.scan(text)):
        raise ValueError("it holds an alias, *name, by which little text can become endless lists")


def _metres(value: Any, name: str, shape: tuple[int, ...]) -> Array:
    """Return lists of coordinates as an array of `shape`, in which -1 is any number but 0."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    fits = array.ndim == len(shape) and all(
        n == wanted or n > 0 > wanted for n, wanted in zip(array.shape, shape, strict=True)
    )
    axes = " x ".join("many" if wanted == -1 else str(wanted) for wanted in shape)
    check(fits and bool(np.isfinite(array).all()), name, value, allowed=f"{axes} finite numbers in m")
    return array


def _read_poses(path: Path) -> tuple[tuple[Pose, ...], tuple[str, ...]]:
    audio.check_size(path, LIMITS["poses.csv"])
    try:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
        poses = tuple(
            Pose(np.array([float(r["x_m"]), float(r["y_m"]), float(r["z_m"])]), float(r["heading_rad"])) for r in rows
        )
        files = tuple(str(row["file"] or "") for row in rows)
    except (OSError, KeyError, TypeError, ValueError, csv.Error) as error:
        raise BadValue(f"{path}: cannot be read ({error!r:.200}); its columns are {','.join(HEADER)}") from None
    check(len(poses) > 0, str(path), "no rows", allowed="at least one pose")
    finite = all(np.isfinite([*pose.position, pose.heading]).all() for pose in poses)
    check(finite, str(path), "NaN or infinity", allowed="finite positions and headings")
    check(all(files), str(path), "a row without file", allowed=f"the columns {','.join(HEADER)} in every row")
    odd = next((ascii(file)[:100] for file in files if not file.isprintable()), None)
    check(odd is None, f"{path} file", odd, allowed="names that can be printed")
    return poses, files
