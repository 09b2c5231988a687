"""How often do the intervals of walls hold the truth? `python tests/wall_coverage.py [trials]`.

A wall and a walk are drawn by chance, its echoes rounded to the grids of a localizer, with noise,
errors of poses and headings; the intervals are those of 95 %, the estimate and 1.96 standard
deviations on either side.
"""

import sys
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.geometry import wrap
from echolearn.acoustics.types import Array
from echolearn.mapping.accuracy import Accuracy
from echolearn.mapping.uncertainty import Sightings, measured
from echolearn.mapping.walls import fit

LAG = Accuracy().lag
AZIMUTH = Accuracy().azimuth

WALKS = (
    "stands still",
    "turns by 30 degrees",
    "turns anyhow",
    "parallel",
    "nearly parallel",
    "oblique",
    "wanders",
    "two stretches",
)


class Trial(NamedTuple):
    """Whether intervals hold the truth, and whether grids leave less than half of the variance."""

    normal: bool
    offset: bool
    noisy: bool


def walk(name: str, rng: np.random.Generator, *, count: int) -> Array:
    """Return places along the wall, away from it, and headings beside its normal, (3, count)."""
    steps = 0.1 * np.arange(count)
    still = np.zeros(count)
    ahead = np.full(count, np.pi / 2)
    if name == "stands still":
        return np.stack([still, still, np.full(count, rng.uniform(-np.pi, np.pi))])
    if name.startswith("turns by"):
        return np.stack([still, still, np.deg2rad(30) * np.arange(count)])
    if name.startswith("turns"):
        return np.stack([still, still, rng.uniform(-np.pi, np.pi, count)])
    if name == "wanders":
        along, away, turn = rng.normal(0, [[0.1], [0.3], [0.3]], (3, count)).cumsum(axis=1)
        return np.stack([along, 0.3 * np.sin(away), turn])
    if name == "two stretches":
        steps = steps + 3.0 * (np.arange(count) > count / 2)
    slant = {"parallel": 0.0, "nearly parallel": 0.01, "oblique": 0.3, "two stretches": 0.03}[name]
    slant = slant * rng.standard_normal()
    return np.stack([steps * np.cos(slant), steps * np.sin(slant), ahead + slant])


def trial(name: str, rng: np.random.Generator) -> Trial:
    """Draw a wall and a walk, and ask the interval of each number for the truth."""
    count = int(rng.integers(4, 40))
    normal, offset = rng.uniform([-np.pi, -8.0], [np.pi, 8.0])
    along, away, turn = walk(name, rng, count=count)
    along, away = along + rng.uniform(-8, 8), np.abs(away + rng.uniform(1.0, 2.0))
    across = np.array([np.cos(normal), np.sin(normal)])
    poses = (offset - away)[:, None] * across + along[:, None] * [-across[1], across[0]]

    distance_noise = LAG * rng.choice([0, 0.1, 0.3, 1, 3])
    azimuth_noise = AZIMUTH * rng.choice([0, 0.1, 0.3, 1, 2])
    pose_sd, heading_sd, bias_sd = (
        rng.choice(sds) for sds in ([0, 0.005, 0.03], [0, 0.02], [0, 0.02])
    )
    distance = away + distance_noise * rng.standard_normal(count)
    azimuth = -turn + azimuth_noise * rng.standard_normal(count)
    # The robot's own frame is what the grid of directions belongs to.
    distance = LAG * np.round(distance / LAG)
    azimuth = AZIMUTH * np.round(azimuth / AZIMUTH)
    told = poses + pose_sd * rng.standard_normal((count, 2))
    headings = normal + turn + heading_sd * rng.standard_normal(count) + rng.normal(0, bias_sd)
    bearing = azimuth + headings
    rays = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)

    points = told + distance[:, None] * rays
    seen = Sightings(points, told, headings, np.full(count, pose_sd), np.full(count, heading_sd))
    line = fit(points, seen.toward, members=np.arange(count))
    found = measured(line, seen, accuracy=Accuracy(heading_bias_sd=bias_sd))
    noise = distance_noise**2 + pose_sd**2, azimuth_noise**2 + heading_sd**2 + bias_sd**2
    return Trial(
        normal=bool(abs(wrap(found.normal - normal)) < 1.96 * found.normal_sd),
        offset=bool(abs(found.offset - offset) < 1.96 * found.offset_sd),
        noisy=noise[0] > LAG**2 / 12 and noise[1] > AZIMUTH**2 / 12,
    )


def trials(each: int, seed: int = 0) -> dict[str, list[Trial]]:
    """Return so many trials of each walk."""
    rng = np.random.default_rng(seed)
    return {name: [trial(name, rng) for _ in range(each)] for name in WALKS}


def shares(drawn: list[Trial]) -> tuple[float, float]:
    """Return the shares of intervals of normals and offsets that hold the truth."""
    return float(np.mean([each.normal for each in drawn])), float(
        np.mean([each.offset for each in drawn])
    )


def main(each: int) -> None:
    """Print the table."""
    print(f"{'walk':20} {'cases':>5} {'normal':>7} {'offset':>7}   noisy: cases, normal, offset")
    found = trials(each)
    found["all"] = sum(found.values(), [])
    for name, drawn in found.items():
        noisy = [each for each in drawn if each.noisy]
        columns = "{:7.1%} {:7.1%}   {:5} {:7.1%} {:7.1%}"
        columns = columns.format(*shares(drawn), len(noisy), *shares(noisy))
        print(f"{name:20} {len(drawn):5} {columns}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 125)
