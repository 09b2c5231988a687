"""Which estimates are right: those of the strongest echo, against the walls around one pose.

An estimate is *matched* with the wall whose true TOA is nearest to it, or of several within 5
samples with the one nearest in direction.

| metric  | the estimate ...                                                                   |
|---------|------------------------------------------------------------------------------------|
| toa     | lies within 5 samples of its wall's TOA (the paper, V-B)                           |
| doa     | lies within 5 degrees of its wall; what an array cannot tell apart counts as one   |
| doa_any | lies within 5 degrees of any wall's azimuth: the paper's rule, often met by chance |
| on_map  | lies, as a map point, within 0.10 m of a wall                                      |

The baseline `chance` draws a TOA evenly from the search window and an azimuth evenly from the
circle.
"""

import warnings
from typing import Any

import numpy as np

from echolearn.acoustics.arrays import representative
from echolearn.acoustics.bistatic import wall_points
from echolearn.acoustics.geometry import SearchWindow, direction
from echolearn.acoustics.polygon_room import AnyRoom
from echolearn.acoustics.rooms import outline, true_echoes
from echolearn.acoustics.types import Array, Observation, Pose
from echolearn.checks import BadValue
from echolearn.evaluation.labelling import on_map
from echolearn.localization.localizer import Localizer
from echolearn.localization.silence import SilentMicrophone
from echolearn.simulation.scene import Scene

METRICS = ("toa", "doa", "doa_any", "on_map")
TOLERANCE_SAMPLES = 5
TOLERANCE_DEGREES = 5.0

DRAWS = 50
"""Estimates drawn by chance for each recording."""


def strongest_echo(
    localizer: Localizer, observation: Observation, *, may_refuse: bool = False
) -> Array:
    """Return TOA in s, azimuth and elevation in rad of the strongest echo, shape (B, 3).

    Args:
        localizer: an estimator of one echo or more.
        observation: samples (B, M, N).
        may_refuse: whether a localizer may refuse the recordings, as of an array with a dead
            microphone; then all estimates are NaN, which no metric counts as right.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SilentMicrophone)
        try:
            echoes = localizer(observation)
        except BadValue:
            if not may_refuse:
                raise
            return np.full((len(observation.samples), 3), np.nan)
    return np.stack([echoes.toa, echoes.azimuth, echoes.elevation], axis=-1)[:, 0]


def drawn_by_chance(
    scene: Scene, window: SearchWindow, *, count: int, rng: np.random.Generator
) -> Array:
    """Return estimates of the baseline `chance`, shape (count, 3).

    Args:
        scene: its array and burst turn the window into times.
        window: that times are drawn from.
        count: number of estimates.
        rng: draws them.
    """
    rate = scene.probe.sample_rate
    first, last = window.lags(scene.array, rate, speed_of_sound=scene.speed_of_sound)
    toa = rng.uniform(first, last, count) / rate
    azimuth = rng.uniform(-np.pi, np.pi, count)
    return np.stack([toa, azimuth, np.full(count, np.pi / 2)], axis=1)


def is_right(estimates: Array, *, room: AnyRoom, pose: Pose, scene: Scene) -> Array:
    """Tell which metrics estimates meet, given the walls around one pose.

    Args:
        estimates: TOA in s, azimuth and elevation in rad, shape (B, 3); NaN is wrong.
        room: gives the walls; floor and ceiling count for TOA and direction, not as walls of the
            map.
        pose: where the robot stands.
        scene: gives its array, sample rate and the speed of sound.

    Returns:
        Whether each metric of `METRICS` is met, shape (B, 4), as 0 and 1.
    """
    around: dict[str, Any] = {"array": scene.array, "speed_of_sound": scene.speed_of_sound}
    truth = true_echoes(room, pose, **around)
    toa, azimuth, elevation = estimates.T
    late = np.abs(toa[:, None] - truth.toa) * scene.probe.sample_rate

    # What an array cannot tell apart counts as one: up and down of a plane.
    estimated = representative(scene.array, direction(azimuth, elevation))
    reference = representative(scene.array, direction(truth.azimuth, truth.elevation))
    away = np.degrees(np.arccos(np.clip(estimated @ reference.T, -1.0, 1.0)))

    # Walls within the tolerance come before all others, and among them the direction decides.
    matched = np.where(late < TOLERANCE_SAMPLES, away - 1000.0, late).argmin(axis=1)
    trial = np.arange(len(estimates))
    points = wall_points(*estimates.T, position=pose.position, heading=pose.heading, **around)
    right = (
        late[trial, matched] < TOLERANCE_SAMPLES,
        away[trial, matched] <= TOLERANCE_DEGREES,
        (away <= TOLERANCE_DEGREES).any(axis=1),
        on_map(points, outline(room)),
    )
    return np.stack(right, axis=1).astype(float)
