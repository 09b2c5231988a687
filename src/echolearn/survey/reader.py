"""The recorded-survey format: a folder by which real robots and simulated ones come in through the
same door.

    survey.yaml          sample_rate, speed_of_sound, microphones (M x 3, m, robot frame), loudspeaker (3, m),
                         direct_path: removed | present (it is removed when read, `direct.py`),
                         optional walls: outline (C x 2, m) for scoring,
                         optional conditions: whatever is known of how it was recorded (snr_db,
                             noise, ...)
    probe.wav            the burst, one channel, followed by silence up to the length of a recording
    poses.csv            index,x_m,y_m,z_m,heading_rad,file; the index whole and each once
    observations/*       M channels each, WAV (float32 or PCM) or FLAC
    noise.wav            optional: M channels of noise alone, of any length, the loudspeaker silent
    calibration.wav      optional, if the direct path is present: M channels of it alone, recorded in a free room

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

from echolearn.acoustics import signals
from echolearn.acoustics.types import Array, MicArray, Observation, Pose, Probe
from echolearn.checks import check
from echolearn.storage import manifests
from echolearn.survey import audio, direct_path, metadata

NOISE, CALIBRATION = "noise.wav", "calibration.wav"

LIMITS = metadata.LIMITS | {
    ".wav": audio.LARGEST,
    ".flac": audio.LARGEST,
    "simulated.json": 16 << 20,
}
"""Bytes that a file of a survey may have; what a simulated one is made from takes 230 for each
pose."""

LONGEST = 1 << 20
"""Samples that a recording of one channel may have."""

BLOCK = 32
"""Recordings heard together, at most."""

SAMPLES = 1 << 22
"""Samples of all microphones heard together, at most, if more than one recording has."""

INSIDE = "a path inside the survey's folder"


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
        numbers: `index` of each pose in `poses.csv`.
        walls: outline of the room, shape (C, 2), in m, or None.
        conditions: what is known of the recording.
        direct: how reading removes the direct path, one of `direct.WAYS`; None if the recordings
            hold none.
        rate: sample rate in Hz to which recordings and probe are brought when read; None leaves
            them.
    """

    folder: Path
    probe: Probe
    array: MicArray
    speed_of_sound: float
    poses: tuple[Pose, ...]
    files: tuple[str, ...]
    numbers: tuple[int, ...]
    walls: Array | None
    conditions: Mapping[str, Any]
    direct: str | None = None
    rate: float | None = None

    def observe(self, poses: Sequence[int]) -> Observation:
        """Read the recordings of the numbered poses, samples (B, M, N), without the direct path.

        What `noise.wav` tells of the noise goes with them, for localizers that whiten.

        Raises:
            BadValue: a recording that is missing, has another sample rate, number of channels or
                length, or NaN; or such a calibration or noise.
        """
        samples = np.stack([self._read(self.files[pose]) for pose in poses])
        if self.direct:
            gain = direct_path.free_field(self.array) if self.direct == "analytic" else None
            samples = direct_path.remove(samples, self.arrivals, gain=gain)
        observation = Observation(samples, self.probe, self.array, self.speed_of_sound)
        heard = (
            observation
            if self.rate in (None, self.probe.sample_rate)
            else resampled(observation, self.rate)
        )
        psd, covariance = self.noise_statistics
        return replace(heard, noise_psd=psd, noise_covariance=covariance)

    @cached_property
    def arrivals(self) -> Array:
        """The direct path at each microphone up to its gain, shape (M, N), at the rate of the
        recordings.
        """
        if self.direct != "calibration":
            return direct_path.delayed(self.probe, self.array, speed_of_sound=self.speed_of_sound)
        path, (channels, length) = self.folder / CALIBRATION, (len(self.array), self.probe.length)
        samples = audio.read_wav(path, self.probe.sample_rate)
        check(
            samples.shape[0] == channels, str(path), samples.shape, allowed=f"{channels} channels"
        )
        silent = [channel + 1 for channel in range(channels) if not samples[channel, :length].any()]
        check(
            not silent,
            f"{path} channels",
            silent,
            allowed="the direct path in each",
            hint="a deaf microphone?",
        )
        return np.pad(samples[:, :length], ((0, 0), (0, max(0, length - samples.shape[1]))))

    @cached_property
    def noise_statistics(self) -> tuple[Array, Array] | tuple[None, None]:
        """Density and covariance of the noise alone, at the rate of what is read; None where it was
        not recorded.
        """
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
        samples = audio.read_wav(path, self.probe.sample_rate)
        channels, length = len(self.array), self.probe.length
        allowed = f"{channels} channels of at least {length} samples"
        check(
            samples.shape[0] == channels and samples.shape[1] >= length,
            str(path),
            samples.shape,
            allowed=allowed,
        )
        return samples

    def _read(self, name: str) -> Array:
        path = self.folder / name
        check(inside(self.folder, name), f"{self.folder}/poses.csv file", name, allowed=INSIDE)
        expected = (len(self.array), self.probe.length)
        samples = audio.read(path, self.probe.sample_rate, shape=expected)
        check(
            bool(samples.any()),
            str(path),
            "silence",
            allowed="a recording",
            hint="was the recorder running?",
        )
        return samples


def blocks(survey: Survey) -> list[range]:
    """Return which poses are heard together, all of them in order: few enough that their recordings
    fit into memory.
    """
    count = len(survey.poses)
    size = max(1, min(BLOCK, SAMPLES // (len(survey.array) * survey.probe.length)))
    return [range(start, min(start + size, count)) for start in range(0, count, size)]


def resampled(observation: Observation, rate: float | None) -> Observation:
    """Return recordings and probe at another sample rate in Hz, by a polyphase filter without
    delay.
    """
    from scipy.signal import resample_poly

    probe = observation.probe
    ratio = Fraction(float(rate or 0.0) / probe.sample_rate).limit_denominator(10_000)
    check(ratio > 0, "rate", f"{rate} Hz", allowed="a sample rate")
    samples = resample_poly(observation.samples, ratio.numerator, ratio.denominator, axis=-1)
    padded = np.pad(probe.samples, (0, min(100, probe.length - len(probe.samples))))
    burst = resample_poly(padded, ratio.numerator, ratio.denominator)
    return replace(
        observation, samples=samples, probe=Probe(burst, float(rate or 0.0), samples.shape[-1])
    )


def inside(folder: Path, name: str) -> bool:
    """Tell whether a file of a survey lies in its folder, links followed."""
    return "\0" not in name and (folder / name).resolve().is_relative_to(folder.resolve())


def poses_csv(poses: Sequence[Pose], files: Sequence[str]) -> bytes:
    """Return the text of `poses.csv`."""
    text = StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(metadata.HEADER)
    for index, (pose, file) in enumerate(zip(poses, files, strict=True)):
        rows.writerow([index, *map(float, pose.position), float(pose.heading), file])
    return text.getvalue().encode()


def describe(
    array: MicArray,
    probe: Probe,
    *,
    speed_of_sound: float,
    walls: Array,
    conditions: Mapping[str, Any],
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
        BadValue: a file or key that is missing or malformed; or a calibration where there is no
            direct path.
    """
    folder, allowed = Path(folder), "a folder in the recorded-survey format"
    manifests.check_folder("survey", folder, allowed=allowed)
    swapped = (folder / manifests.BUNDLE).is_file() and not (folder / "survey.yaml").exists()
    check(
        not swapped,
        "survey",
        folder,
        allowed=allowed,
        hint="this is a bundle; did you swap survey and bundle?",
    )
    for name in ("survey.yaml", "probe.wav", "poses.csv", NOISE, CALIBRATION):
        check(inside(folder, name), f"{folder}/{name}", "a link", allowed=INSIDE)
    about = metadata.read_yaml(folder / "survey.yaml")
    padded = audio.read_wav(folder / "probe.wav", about["sample_rate"])[0]
    burst = padded[: np.flatnonzero(padded)[-1] + 1] if padded.any() else padded[:0]
    check(len(burst) > 0, f"{folder}/probe.wav", "silence", allowed="the burst that was emitted")
    check(
        len(padded) <= LONGEST,
        f"{folder}/probe.wav",
        f"{len(padded)} samples",
        allowed=f"at most {LONGEST}",
    )
    present, calibrated = about["direct_path"] == "present", (folder / CALIBRATION).exists()
    place, hint = f"{folder}/{CALIBRATION} direct_path", "there is none to remove"
    check(present or not calibrated, place, "removed", allowed="present", hint=hint)
    numbers, poses, files = metadata.read_poses(folder / "poses.csv")
    return Survey(
        folder=folder,
        probe=Probe(burst, about["sample_rate"], len(padded)),
        array=MicArray(about["microphones"] - about["loudspeaker"]),
        speed_of_sound=about["speed_of_sound"],
        poses=poses,
        files=files,
        numbers=numbers,
        walls=about.get("walls"),
        conditions=about.get("conditions") or {},
        direct=("calibration" if calibrated else "fitted") if present else None,
    )
