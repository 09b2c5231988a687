"""What localizers make of recordings at one place: the fault of the array, the estimates, and which
of them hit.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import (
    SearchWindow,
    direction,
    distance_to_outline,
    outline,
    true_echoes,
    wall_points,
)
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Array, MicArray, Observation, Pose, Room
from echolearn.checks import BadValue
from echolearn.dataset.records import MAP_TOLERANCE
from echolearn.localization.faults import DeafMicrophone
from echolearn.localization.localizer import Localizer
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.observe import NOISE_SECONDS, add_noise, noise_alone
from echolearn.simulation.scene import Scene

TOLERANCE_SAMPLES = 5
TOLERANCE_DEGREES = 5.0
METRICS = ("toa", "doa", "doa_any", "on_map")

GUESSES = 50
"""Draws of `chance` for each recording."""


@dataclass(frozen=True)
class Fault:
    """What is wrong with an array, without the estimators knowing.

    Attributes:
        dead: microphones that hear nothing, each in turn from position to position.
        gain_db: standard deviation of the microphones' gains, in dB.
        displacement: standard deviation of each coordinate of the microphones, in m.
    """

    dead: int = 0
    gain_db: float = 0.0
    displacement: float = 0.0


FAULTS = {
    "none": Fault(),
    "one_dead": Fault(dead=1),
    "gains_3dB": Fault(gain_db=3.0),
    "positions_5mm": Fault(displacement=0.005),
}


@dataclass(frozen=True)
class Condition:
    """What one value of a study stands for.

    Attributes:
        room: where it takes place.
        levels: levels of the noises, and how many recordings are averaged.
        fault: what is wrong with the array.
        stretch: number of the noise that all recordings hear; None is noise of its own for each.
    """

    room: Room
    levels: NoiseLevels
    fault: Fault
    stretch: int | None = None


@dataclass(frozen=True)
class Trials:
    """Recordings at one place.

    Attributes:
        condition: what they are made under.
        scene: what the robot carries, as it believes.
        pose: where it stands.
        place: number of the pose; with `seed` it gives the fault and the noise-only recording.
        numbers: of the trials; with `seed` each gives its noise, whatever the condition, unless
            that names a stretch.
        seed: see above.
    """

    condition: Condition
    scene: Scene
    pose: Pose
    place: int
    numbers: Sequence[int]
    seed: int

    def rng(self, purpose: str, index: int) -> np.random.Generator:
        """Return the source of random numbers of one purpose."""
        return stream(self.seed, purpose, index)

    def noise(self, number: int) -> np.random.Generator:
        """Return the source of a trial's noise."""
        stretch = self.condition.stretch
        return self.rng("trial", number) if stretch is None else self.rng("stretch", stretch)

    def record(self) -> Observation:
        """Return all recordings, samples (B, M, N), with what a recording of the noise alone tells
        of it.
        """
        room, rng, levels = (
            self.condition.room,
            self.rng("fault", self.place),
            self.condition.levels,
        )
        scene, gains = spoil(self.scene, self.condition.fault, rng, first=self.place)
        alone = gains * noise_alone(
            room, self.pose, scene=scene, seconds=NOISE_SECONDS, levels=levels, rng=rng
        )
        received = scene.received(room, self.pose)
        recordings = [
            gains * add_noise(received, scene, levels=levels, rng=self.noise(number))
            for number in self.numbers
        ]
        about = (self.scene.probe, self.scene.array, self.scene.speed_of_sound)
        psd, covariance = signals.noise_psd(alone), signals.noise_covariance(alone)
        return Observation(np.stack(recordings), *about, noise_psd=psd, noise_covariance=covariance)

    def judge(self, localizers: Sequence[Localizer], window: SearchWindow) -> Array:
        """Return the hits of each localizer and, last, of guesses in `window`: (B, localizers + 1,
        metrics).
        """
        observation, room = self.record(), self.condition.room
        estimates = [
            estimate(localizer, observation, self.condition.fault) for localizer in localizers
        ]
        found = [hits(each, room, self.pose, observation) for each in estimates]
        guesses = hits(
            guess(observation, window, self.rng("guess", self.place)), room, self.pose, observation
        )
        return np.stack(
            [*found, guesses.reshape(len(self.numbers), GUESSES, -1).mean(axis=1)], axis=1
        )


def spoil(
    scene: Scene, fault: Fault, rng: np.random.Generator, *, first: int
) -> tuple[Scene, Array]:
    """Return the scene as it really is, and the gains (M, 1) of its microphones, 0 of dead ones
    from the `first` on.
    """
    positions = scene.array.positions
    moved = MicArray(positions + fault.displacement * rng.standard_normal(positions.shape))
    gains = 10.0 ** (fault.gain_db * rng.standard_normal((len(positions), 1)) / 20.0)
    gains[(first + np.arange(fault.dead)) % len(positions)] = 0.0
    return replace(scene, array=moved) if fault.displacement else scene, gains


def estimate(localizer: Localizer, observation: Observation, fault: Fault) -> Array:
    """Return TOA, azimuth and elevation of the strongest echo, shape (B, 3), NaN if dead
    microphones are refused.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeafMicrophone)
        try:
            echoes = localizer(observation)
        except BadValue:
            if not fault.dead:
                raise
            return np.full((len(observation.samples), 3), np.nan)
    return np.stack([echoes.toa[:, 0], echoes.azimuth[:, 0], echoes.elevation[:, 0]], axis=1)


def guess(observation: Observation, window: SearchWindow, rng: np.random.Generator) -> Array:
    """Return estimates drawn by chance, `GUESSES` for each observation, shape (B * GUESSES, 3)."""
    rate, count = observation.probe.sample_rate, len(observation.samples) * GUESSES
    first, last = window.lags(observation.array, rate, observation.speed_of_sound)
    toa, azimuth = rng.uniform(first, last, count) / rate, rng.uniform(-np.pi, np.pi, count)
    return np.stack([toa, azimuth, np.full(count, np.pi / 2)], axis=1)


def hits(estimates: Array, room: Room, pose: Pose, observation: Observation) -> Array:
    """Judge estimates against the walls around one pose.

    Args:
        estimates: TOA in s, azimuth and elevation in rad, shape (B, 3).
        room: gives the walls; floor and ceiling count for TOA and direction, not as walls of the
            map.
        pose: where the robot stands.
        observation: gives its array and the speed of sound.

    Returns:
        Whether each metric of `METRICS` is met, shape (B, 4), as 0 and 1.
    """
    array, speed, rate = (
        observation.array,
        observation.speed_of_sound,
        observation.probe.sample_rate,
    )
    truth = true_echoes(room, pose, array, speed)
    toa, azimuth, elevation = estimates.T
    late = np.abs(toa[:, None] - truth.toa) * rate
    found, true = direction(azimuth, elevation), direction(truth.azimuth, truth.elevation)
    if np.ptp(array.positions[:, 2]) == 0.0:  # a planar array cannot tell up from down
        found[:, 2], true[:, 2] = np.abs(found[:, 2]), np.abs(true[:, 2])
    away = np.degrees(np.arccos(np.clip(found @ true.T, -1.0, 1.0)))
    matched = np.where(late < TOLERANCE_SAMPLES, away - 1000.0, late).argmin(axis=1)[:, None]
    point = wall_points(
        toa,
        azimuth,
        elevation,
        position=pose.position,
        heading=pose.heading,
        array=array,
        speed_of_sound=speed,
    )
    return np.stack(
        [
            np.take_along_axis(late, matched, axis=1)[:, 0] < TOLERANCE_SAMPLES,
            np.take_along_axis(away, matched, axis=1)[:, 0] <= TOLERANCE_DEGREES,
            (away <= TOLERANCE_DEGREES).any(axis=1),
            distance_to_outline(point, outline(room)) <= MAP_TOLERANCE,
        ],
        axis=1,
    ).astype(float)
