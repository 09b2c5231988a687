"""A recorded walk: what is known of it, and how its recordings are read.

Each recording is read when it is asked for, and passes these steps: the gains of the microphones,
mending (`mending.py`), removal of the direct path (`direct_path.py`), another sample rate. What
describes the walk has been read and checked before (`reader.py`).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from functools import cached_property
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, MicArray, Observation, Pose, Probe, Truth
from echolearn.checks import check, check_whole
from echolearn.storage.advice import data_frame
from echolearn.survey import audio, direct_path, early, played
from echolearn.survey.containers import Containers
from echolearn.survey.mending import Mending, steadied, taken_off

NOISE = "noise.wav"
CALIBRATION = "calibration.wav"

BLOCK = 32
"""Recordings read together, at most."""

SAMPLES = 1 << 22
"""Samples of all microphones read together, at most, if more than one recording has."""


@dataclass(frozen=True)
class Survey:
    """A recorded walk.

    Attributes:
        folder: where it lies.
        probe: what was emitted, at the rate of the recordings.
        array: the microphones.
        speed_of_sound: in m/s.
        poses: P poses.
        files: recording of each pose, relative to `folder`.
        numbers: `index` of each pose in `poses.csv`.
        walls: sides of the floor plan, shape (S, 2, 2), in m, or None.
        conditions: what is known of the recording.
        heading_bias_sd: standard deviation of an error that all headings share, in rad.
        direct: how reading removes the direct path, one of `direct_path.REMOVALS`; None if the
            recordings hold none.
        rate: sample rate in Hz to which recordings and probe are brought when read; None leaves
            them.
        gains: factors of the microphones, shape (M,), 0 for one that is left out; None leaves them.
        containers: how the numbers of its files are stored, where headers do not tell.
        mending: what is mended in recordings before anything else looks at them (`health`).
        mapped: whether echoes can be placed on a map; if not, they are times and directions only.
        loudspeakers: places of a loudspeaker that moves on its own, in the robot's frame, shape
            (P, 3), in m; None where it is carried.
        truth: true echoes of each pose, or None where they are not known.
        further: cells of further columns of `poses.csv`, by name, P texts each.
        window: where echoes will be sought; what `direct="fir"` removes comes before.
        played: where the burst as the loudspeaker plays it is taken from, by which recordings are
            filtered when read, one of `played.WAYS`; None leaves them.
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
    heading_bias_sd: float = 0.0
    direct: str | None = None
    rate: float | None = None
    gains: Array | None = None
    containers: Containers = Containers()
    mending: Mending | None = None
    mapped: bool = True
    loudspeakers: Array | None = None
    truth: tuple[Truth, ...] | None = None
    further: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    window: SearchWindow = SearchWindow()
    played: str | None = None

    def __repr__(self) -> str:
        """Say what it is; its fields would fill pages."""
        about = f"{len(self)} poses, {len(self.array.positions)} microphones"
        return f"<Survey {self.folder.name}: {about}, {self.probe.sample_rate:g} Hz>"

    def _repr_html_(self) -> str:
        """Return what a notebook shows: what it is, and its conditions."""
        told = ", ".join(f"{key}: {value}" for key, value in self.conditions.items())
        return f"<p>{escape(repr(self)[1:-1])}</p><p>{escape(told)}</p>"

    def to_pandas(self) -> Any:
        """Return the poses as a `pandas.DataFrame`; pandas is not installed with echolearn."""
        rows = [(*pose.position, pose.heading) for pose in self.poses]
        table = data_frame()(rows, columns=["x_m", "y_m", "z_m", "heading_rad"])
        return table.assign(file=self.files)

    def __len__(self) -> int:
        """Return the number of poses, P."""
        return len(self.poses)

    def observe(self, poses: Sequence[int]) -> Observation:
        """Read the recordings of the numbered poses, samples (B, M, N), without the direct path.

        What `noise.wav` tells of the noise goes with them, for localizers that whiten.

        Raises:
            BadValue: no list of poses of this survey; a recording that is missing, has another
                sample rate, number of channels or length, or NaN; or such a calibration or noise.
        """
        self._check_numbers(poses)
        samples = np.stack([self.mended(pose) for pose in poses])
        if self.direct:
            samples = self.without_direct(samples, poses)
        if self.played:
            samples = played.as_played(samples, self.response)
        psd, covariance = self.noise_statistics
        return Observation(
            samples=self._resampled(samples),
            probe=self.emitted,
            array=self.array,
            speed_of_sound=self.speed_of_sound,
            noise_psd=psd,
            noise_covariance=covariance,
        )

    def _check_numbers(self, poses: Sequence[int]) -> None:
        """Raise `BadValue` unless poses are some of this survey's, by their numbers from 0."""
        last = len(self) - 1
        allowed = f"must be a list of whole numbers from 0 to {last}, as [0] or range(2)"
        listed = isinstance(poses, Sequence | np.ndarray) and not isinstance(poses, str)
        check(listed and len(poses) > 0, "poses", poses, allowed=allowed)
        for pose in poses:
            # A negative one would be a pose from the end, and the last one be taken for the first.
            check_whole("poses", pose, low=0, high=last, hint="they are counted from 0")

    def mended(self, pose: int) -> Array:
        """Return the recording of a pose as it should have been, shape (M, N)."""
        samples = self.recording(pose)
        return samples if self.mending is None else self.mending(samples, pose)

    def around(self, pose: int) -> MicArray:
        """Return the microphones around the loudspeaker as it stood at a pose."""
        if self.loudspeakers is None:
            return self.array
        return MicArray(self.array.positions - self.loudspeakers[pose])

    def without_direct(self, samples: Array, poses: Sequence[int]) -> Array:
        """Return recordings (B, M, N) of some poses without the direct path."""
        lost = self._lost(poses)
        if self.direct == "fir":
            each = zip(samples, poses, lost.tolist(), strict=True)
            left = [self._without_early(*recorded) for recorded in each]
            return np.stack(left)
        arrived = self._arrivals(poses)
        if lost.any():
            # What was lost is not there to be subtracted, nor does it tell the gain.
            arrived = np.where(np.arange(self.probe.length) >= lost[:, None, None], arrived, 0.0)
        gain = self._free_field(poses) if self.direct == "analytic" else None
        return direct_path.remove(samples, arrived, gain=gain)

    def _without_early(self, samples: Array, pose: int, lost: int) -> Array:
        """Return a recording (M, N), of which so many samples are lost, by `early`."""
        return early.without_early(samples, self.probe, lags=self.early_lags(pose), lost=lost)

    def early_lags(self, pose: int) -> tuple[int, int]:
        """Return the lags at which sound arrives before the first possible echo (`early`)."""
        return early.early_lags(
            self.probe, self.around(pose), window=self.window, speed_of_sound=self.speed_of_sound
        )

    @cached_property
    def response(self) -> Array:
        """What the loudspeaker plays of an impulse, as `early.loudspeaker_response` has it."""
        if self.played == "calibration":
            samples = self.calibration
        else:
            samples = np.stack([self.mended(pose) for pose in self.looked_at])
        return early.loudspeaker_response(
            samples[..., self.used, :],
            self.probe,
            positions=self.array.positions[self.used],
            last=self.early_lags(0)[1],
            speed_of_sound=self.speed_of_sound,
        )

    @property
    def looked_at(self) -> list[int]:
        """Poses from whose recordings `response` is taken: all of a short walk."""
        count = len(self.poses)
        places = np.linspace(0, count - 1, min(count, played.LOOKED_AT))
        return list(map(int, np.unique(places.astype(int))))

    def _lost(self, poses: Sequence[int]) -> Array:
        """Return how many samples of some recordings are missing at their beginning, shape (B,)."""
        if self.mending is None:
            return np.zeros(len(poses), dtype=int)
        late: Array = np.asarray(self.mending.latency)[list(poses)]
        return np.ceil(np.maximum(-late, 0.0)).astype(int)

    def _free_field(self, poses: Sequence[int]) -> Array:
        """Return the gains of the free field at some poses, shape (B, M)."""
        return np.stack([direct_path.free_field(self.around(pose)) for pose in poses])

    def _arrivals(self, poses: Sequence[int]) -> Array:
        """Return the direct path as it is at some poses, shape (M, N) or (B, M, N)."""
        if self.loudspeakers is None or self.direct == "calibration":
            return self.arrivals
        speed = self.speed_of_sound
        each = [
            direct_path.delayed(self.probe, self.around(pose), speed_of_sound=speed)
            for pose in poses
        ]
        return np.stack(each)

    @property
    def used(self) -> Array:
        """Microphones that are not left out, shape (M,), bool."""
        return np.ones(len(self.array), dtype=bool) if self.gains is None else self.gains != 0

    @cached_property
    def emitted(self) -> Probe:
        """The burst at the rate of what is read."""
        if self._ratio == 1:
            return self.probe
        # The filter rings on a little after the last sample of the burst.
        ringing = min(100, self.probe.length - len(self.probe.samples))
        burst = self._resampled(np.pad(self.probe.samples, (0, ringing)))
        length = math.ceil(self.probe.length * self._ratio)
        return Probe(burst, float(self.rate or 0.0), length)

    @property
    def _ratio(self) -> Fraction:
        """Rate of what is read over that of the recordings."""
        rate = self.rate or self.probe.sample_rate
        return Fraction(rate / self.probe.sample_rate).limit_denominator(10_000)

    def _resampled(self, samples: Array) -> Array:
        """Return samples (..., N) at the rate of what is read: a polyphase filter without delay."""
        if self._ratio == 1:
            return samples
        from scipy.signal import resample_poly

        found: Array = resample_poly(samples, *self._ratio.as_integer_ratio(), axis=-1)
        return found

    @cached_property
    def arrivals(self) -> Array:
        """The direct path at each microphone up to its gain, shape (M, N), as it is recorded."""
        if self.direct == "calibration":
            return self.calibration
        return direct_path.delayed(self.probe, self.array, speed_of_sound=self.speed_of_sound)

    @cached_property
    def calibration_recorded(self) -> Array:
        """The direct path alone as it was recorded, shape (M, K), at most as long as the walk's."""
        samples = self._read_beside(CALIBRATION)[:, : self.probe.length]
        silent = np.flatnonzero(~samples.any(axis=1) & self.used) + 1
        check(
            not len(silent),
            f"{self.folder / CALIBRATION} channels",
            silent.tolist(),
            allowed="must hold the direct path in each",
            hint="a deaf microphone?",
        )
        return samples

    @cached_property
    def calibration(self) -> Array:
        """The direct path alone, mended, shape (M, N)."""
        samples = self.calibration_recorded
        mending = self.mending
        if mending and (mending.calibration_offset.any() or mending.calibration_tones):
            samples = steadied(samples, mending.calibration_offset, tones=mending.calibration_tones)
        whole = np.pad(samples, ((0, 0), (0, self.probe.length - samples.shape[1])))
        late = mending.calibration if mending else 0.0
        return taken_off(whole, late) if late else whole

    @cached_property
    def noise_statistics(self) -> tuple[Array, Array] | tuple[None, None]:
        """Density and covariance of the noise alone, at the rate of what is read, if recorded."""
        measured = []
        lengths = []
        for piece in self.noise():
            measured.append(signals.noise_statistics(self._resampled(piece)))
            lengths.append(piece.shape[1])
        return signals.pooled(measured, lengths) if measured else (None, None)

    def noise(self) -> Iterator[Array]:
        """Read the noise alone, in pieces (M, n); none where it was not recorded.

        Raises:
            BadValue: as `observe`, or fewer samples than an observation has.
        """
        path = self.folder / NOISE
        if not path.exists():
            return
        # Of a microphone that is left out no level is wanted, but one is needed.
        gains = 1.0 if self.gains is None else np.where(self.used, self.gains, 1.0)[:, None]
        size = max(self.probe.length, SAMPLES // len(self.array))
        scale = self.containers.noise.scale
        for piece in audio.wav_pieces(path, self.probe.sample_rate, samples=size):
            self._check_beside(path, piece, least=self.probe.length)
            yield gains * scale * piece

    def _read_beside(self, name: str, *, least: int = 1) -> Array:
        """Return what was recorded beside the walk, of at least so many samples, shape (M, K)."""
        path = self.folder / name
        samples = audio.read_wav(path, self.probe.sample_rate)
        self._check_beside(path, samples, least=least)
        return samples

    def _check_beside(self, path: Path, samples: Array, *, least: int) -> None:
        """Raise `BadValue` unless a recording (M, K) has the array's channels, and is long enough.

        Args:
            path: its file.
            samples: shape (M, K).
            least: number of samples K.
        """
        fits = samples.shape[0] == len(self.array) and samples.shape[1] >= least
        allowed = f"must be {len(self.array)} channels of at least {least} samples"
        check(fits, str(path), samples.shape, allowed=allowed)

    def recording(self, pose: int) -> Array:
        """Return what was recorded at a pose, by the gains, shape (M, N).

        Raises:
            BadValue: as `observe`.
        """
        path = self.folder / self.files[pose]
        shape = (len(self.array), self.probe.length)
        samples = audio.read_recording(path, self.probe.sample_rate, shape=shape)
        hint = "was the recorder running?"
        check(bool(samples.any()), str(path), "silence", allowed="must be a recording", hint=hint)
        samples *= self.containers.recordings.scale
        return samples if self.gains is None else self.gains[:, None] * samples


def blocks(survey: Survey) -> list[range]:
    """Return which poses are read together, all of them in order.

    They are few enough that their recordings fit into memory.
    """
    count = len(survey.poses)
    # One recording is read even if it alone is larger than that.
    size = max(1, min(BLOCK, SAMPLES // (len(survey.array) * survey.probe.length)))
    return [range(start, min(start + size, count)) for start in range(0, count, size)]
