"""The nouns of the project: small frozen values, checked when they are made."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from echolearn.checks import (
    check,
    check_list,
    check_metres,
    check_number,
    check_rate,
    check_speed,
    check_whole,
    finite_vector,
    is_number,
    real_array,
)

Array = NDArray[Any]

SPEED_OF_SOUND = 343.0
"""m/s, the paper's value."""

LONGEST = 1 << 20
"""Samples that a recording of one channel may have: 48 s at 22 050 Hz."""

PARITY = 1e-5
"""Largest difference in confidence between a trained classifier and its file."""


@dataclass(frozen=True)
class Room:
    """A shoebox room spanning [0, size].

    Attributes:
        size: length, width, height in m.
        t60: reverberation time in s; Sabine's formula turns it into one absorption for all walls.
        walls: factors (0 to 1) on each wall's reflection coefficient, in the order x=0, x=max, y=0,
            y=max, floor, ceiling; 0 is a wall that does not reflect.
    """

    size: tuple[float, float, float]
    t60: float
    walls: tuple[float, float, float, float, float, float] = (1.0, 1.0, 1.0, 1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        check_list("room.size", self.size, length=3, allowed="must be three lengths in m")
        for length in self.size:
            check_number("room.size", length, low=0.5, high=200.0, unit="m")
        check_list("room.walls", self.walls, length=6, allowed="must be six factors from 0 to 1")
        for factor in self.walls:
            check_number("room.walls", factor, low=0.0, high=1.0)
        object.__setattr__(self, "size", tuple(map(float, self.size)))
        object.__setattr__(self, "walls", tuple(map(float, self.walls)))
        check_t60(self.t60, shortest=self.shortest_t60(), dimensions=self.dimensions)

    @property
    def dimensions(self) -> str:
        """Size in words, as in 5 x 4 x 3 m."""
        return "{:g} x {:g} x {:g} m".format(*self.size)

    @property
    def volume(self) -> float:
        """Air in the room, in m^3."""
        return math.prod(self.size)

    def shortest_t60(self, speed_of_sound: float = SPEED_OF_SOUND) -> float:
        """Return the T60 in s at which Sabine's absorption reaches 1: 24 ln(10) V / (c S)."""
        x, y, z = self.size
        return 24.0 * math.log(10.0) * x * y * z / (speed_of_sound * 2.0 * (x * y + y * z + z * x))

    def sabine_absorption(self, speed_of_sound: float = SPEED_OF_SOUND) -> float:
        """Return the energy absorption coefficient that Sabine's formula gives for `t60`."""
        return self.shortest_t60(speed_of_sound) / self.t60

    def reflection(self, speed_of_sound: float = SPEED_OF_SOUND) -> Array:
        """Return pressure reflection coefficients, factor * sqrt(1 - absorption), shape (6,)."""
        return reflections(self.walls, self.sabine_absorption(speed_of_sound))


def check_t60(t60: object, *, shortest: float, dimensions: str) -> None:
    """Raise `BadValue` for a reverberation time out of range, or one that Sabine's rules out.

    Args:
        t60: in s.
        shortest: T60 at which Sabine's absorption reaches 1, in s.
        dimensions: of the room, in words.
    """
    check_number("room.t60", t60, low=0.01, high=10.0, unit="s")
    check(
        is_number(t60) and shortest < t60,
        "room.t60",
        f"{t60:g} s",
        allowed=f"must be over {shortest:.3f} s, Sabine's formula, in a {dimensions} room",
        hint="walls cannot absorb more than everything; use a longer T60 or a smaller room",
    )


def reflections(factors: Sequence[float], absorption: float) -> Array:
    """Return pressure reflection coefficients, factor * sqrt(1 - absorption)."""
    # A speed of sound above the usual one may absorb a little more than everything.
    return np.array(factors) * math.sqrt(max(0.0, 1.0 - absorption))


@dataclass(frozen=True, eq=False)
class MicArray:
    """Microphones and a loudspeaker at the origin of the robot's frame (x ahead, y left, z up).

    Attributes:
        positions: microphones, shape (M, 3), in m; the first is the reference.
    """

    positions: Array

    def __post_init__(self) -> None:
        positions = check_metres("array.positions", self.positions, shape=(-1, 3)).copy()
        # Its hash is that of its values, so they must not change.
        positions.setflags(write=False)
        object.__setattr__(self, "positions", positions)

    def __len__(self) -> int:
        return len(self.positions)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MicArray) and np.array_equal(self.positions, other.positions)

    def __hash__(self) -> int:
        return hash(self.positions.tobytes())

    @property
    def radius(self) -> float:
        """Largest distance of a microphone from the loudspeaker, in m."""
        return float(np.linalg.norm(self.positions, axis=1).max())

    @cached_property
    def centre(self) -> Array:
        """Mean of the microphones, from which directions of arrival are seen, shape (3,), in m."""
        middle = self.positions.mean(axis=0)
        # A ring's middle is its loudspeaker but for rounding.
        return np.where(np.abs(middle) < 1e-9, 0.0, middle)

    @property
    def reach(self) -> float:
        """Largest distance of a microphone from the centre, in m."""
        return float(np.linalg.norm(self.positions - self.centre, axis=1).max())


@dataclass(frozen=True)
class Probe:
    """The known burst the loudspeaker emits.

    Attributes:
        samples: the burst, shape (L,), before zero-padding; float64, whatever was given.
        sample_rate: in Hz.
        length: N, samples recorded from the start of the emission.
    """

    samples: Array
    sample_rate: float
    length: int

    def __post_init__(self) -> None:
        allowed = "must be finite numbers, shape (L,)"
        samples = finite_vector("probe.samples", self.samples, allowed=allowed)
        object.__setattr__(self, "samples", samples)
        hint = "is a file empty, or a level 0?"
        check(bool(samples.any()), "probe.samples", "silence", allowed="must be a burst", hint=hint)
        check_rate("probe.sample_rate", self.sample_rate)
        object.__setattr__(self, "sample_rate", float(self.sample_rate))
        burst = len(self.samples)
        hint = "a recording must hold the burst, and be one that surveys may have"
        bounds: dict[str, Any] = {"low": burst, "high": max(burst, LONGEST), "unit": "samples"}
        check_whole("probe.length", self.length, hint=hint, **bounds)

    @property
    def energy(self) -> float:
        """||s||^2."""
        return float(np.sum(np.square(self.samples)))


@dataclass(frozen=True)
class Pose:
    """Where the robot stands.

    Attributes:
        position: loudspeaker, shape (3,), in m, room frame.
        heading: direction of the robot's x axis in the room, in rad.
        position_sd: standard deviation of each coordinate, in m; 0 where nobody has told it.
        heading_sd: that of the heading, in rad.
    """

    position: Array
    heading: float = 0.0
    # `storage.identity.LATER`, which stands above this room: surveys of before keep their identity.
    position_sd: float = field(default=0.0, metadata={"later": True})
    heading_sd: float = field(default=0.0, metadata={"later": True})

    def __post_init__(self) -> None:
        allowed = "must be three finite coordinates in m"
        position = finite_vector("pose.position", self.position, length=3, allowed=allowed)
        object.__setattr__(self, "position", position)
        check_number("pose.heading", self.heading, unit="rad")
        check_number("pose.position_sd", self.position_sd, low=0.0, unit="m")
        check_number("pose.heading_sd", self.heading_sd, low=0.0, unit="rad")


@dataclass(frozen=True)
class Observation:
    """All that an estimator may know: recordings without their direct path, and the robot's parts.

    Attributes:
        samples: recordings, shape (..., M, N); leading axes are a batch of observations. Real
            numbers of any dtype, which become float64; their scale does not matter.
        probe: what was emitted.
        array: where the microphones are.
        speed_of_sound: in m/s.
        noise_psd: power spectral density of the noise alone, recorded before the walk
            (`signals.noise_psd`), shape (F,) or (M, F) at F evenly spaced frequencies from 0 to
            half the sample rate; None if unknown.
        noise_covariance: of the same noise between microphones at those frequencies
            (`signals.noise_covariance`), shape (F, M, M); None if unknown.
        sample_rate: of the recordings, in Hz, where it is known apart from the probe's; localizers
            refuse another.
    """

    samples: Array
    probe: Probe
    array: MicArray
    speed_of_sound: float = SPEED_OF_SOUND
    noise_psd: Array | None = None
    sample_rate: float | None = None
    noise_covariance: Array | None = None

    def __post_init__(self) -> None:
        samples = real_array(
            "observation.samples",
            self.samples,
            allowed="must be real numbers, shape (..., M, N)",
            hint="give the samples themselves, not their spectrum",
        )
        object.__setattr__(self, "samples", samples)
        check_speed("observation.speed_of_sound", self.speed_of_sound)


@dataclass(frozen=True)
class Truth:
    """All that an estimator may not know: the first-order echo of each reflecting wall.

    Attributes:
        toa: at microphone 1, shape (W,), in s.
        azimuth: in the robot's frame, seen from the array's centre, shape (W,), in rad.
        elevation: from the frame's z axis, seen from there, shape (W,), in rad.
    """

    toa: Array
    azimuth: Array
    elevation: Array


@dataclass(frozen=True)
class Echoes:
    """Estimated echoes, strongest first; every field has shape (..., R). R = 1 is the paper.

    Attributes:
        toa: at microphone 1, in s.
        score: normalised correlation of the recording with the probe at `toa`, -1 to 1.
        gain: amplitude relative to the probe (Eq. 11).
        azimuth: in the robot's frame, seen from the array's centre, in rad.
        elevation: from the frame's z axis, seen from there, in rad.
        power: steered response at the estimate, in the localizer's own linear unit.
    """

    toa: Array
    score: Array
    gain: Array
    azimuth: Array
    elevation: Array
    power: Array


@dataclass(frozen=True)
class EchoMap:
    """Points of a map with the belief in each.

    Attributes:
        points: shape (P, 2), in m, room frame.
        confidence: shape (P,), 0 to 1.
        kept: shape (P,), bool: survived the filter.
        poses: robot positions the points were seen from, shape (P, 2), in m.
    """

    points: Array
    confidence: Array
    kept: Array
    poses: Array = field(default_factory=lambda: np.empty((0, 2)))


class Noise(Protocol):
    """A source of microphone noise (`echolearn.simulation.noise`)."""

    def __call__(
        self, array: MicArray, *, length: int, sample_rate: float, rng: np.random.Generator
    ) -> Array:
        """Return noise of unit variance, shape (M, length).

        Args:
            array: M microphones.
            length: number of samples.
            sample_rate: in Hz.
            rng: source of random numbers.
        """
