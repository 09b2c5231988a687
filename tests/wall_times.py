"""What does a map of walls cost? `python tests/wall_times.py [poses ...]`.

A simulated walk of 160 poses through 8 x 6 x 5 m at -17 dB, recordings as long as the paper's
(20 000 samples of six microphones), is mapped by the bundle `walk`: all of it, and its first poses
alone. Printed is the CPU time in s from recordings to walls (reading them, matched filters,
evidence, hypotheses, strips, verdicts, points; numpy on one thread), the less of two runs, with
the compiled loops, for the bundle's window and for a farther one, and without them; and the most
memory that the process had, one for each figure. What comes before, the health of the recordings,
is told beside it. How many processes the machine ran is told: beside others the same work takes
longer.
"""

import os
import resource
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Room
from echolearn.robot.choices import open_survey
from echolearn.robot.scorer import load
from echolearn.robot.shipped import FOLDER
from echolearn.robot.wall_map import score_walls
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.white import White
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.simulation.survey import survey
from echolearn.survey.examining import examine
from echolearn.survey.health import mended
from echolearn.walls import evidence

WINDOWS = (SearchWindow(1.0, 2.0), SearchWindow(1.0, 6.0))
ROUNDS = 2
MOST = 160


def walk(runs: Path) -> Path:
    """Simulate the walk."""
    scene = Scene(circular_array(), noise_probe(), Images(), White())
    about: Any = {"room": Room((8.0, 6.0, 5.0), 0.6), "scene": scene}
    return survey(name="walk", levels=NoiseLevels(-17.0), poses=MOST, runs=runs, **about)


def cost(folder: Path, *, poses: int, window: SearchWindow, compiled: bool) -> list[float]:
    """Return the CPU times of health and walls in s, and the most memory in MiB.

    Args:
        folder: of the walk.
        poses: how many of it.
        window: distances of walls.
        compiled: whether numba is there.
    """
    if not compiled:
        evidence._loops = lambda: None  # type: ignore[assignment]
    scorer = load(FOLDER / "walk")
    farther: Any = replace(scorer.bundle.localizer, window=window)  # type: ignore[type-var]
    scorer = replace(scorer, bundle=replace(scorer.bundle, localizer=farther))
    whole = open_survey(folder, scorer.bundle, resample=False, direct=None)
    parts = {key: getattr(whole, key)[:poses] for key in ("poses", "files", "numbers")}
    some = replace(whole, **parts)
    # It is the same whatever is sought afterwards.
    first = compiled and window == WINDOWS[0]
    health = least(lambda: mended(some, examine(some))) if first else 0.0
    walls = least(lambda: score_walls(scorer, some))
    return [health, walls, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024]


def least(work: Callable[[], object]) -> float:
    """Return the least CPU time of some work in s."""
    times = []
    for _ in range(ROUNDS):
        began = time.process_time()
        work()
        times.append(time.process_time() - began)
    return min(times)


CASES = ((WINDOWS[0], True), (WINDOWS[1], True), (WINDOWS[0], False))
"""Columns of the table: window, and whether the loops are compiled."""


def row(folder: Path, poses: int) -> str:
    """Return the table's row about the first poses of a walk."""
    cells = [str(poses)]
    for window, compiled in CASES:
        told: Any = {"poses": poses, "window": window, "compiled": compiled}
        # A process of its own, whose memory nothing else has stretched.
        with get_context("spawn").Pool(1) as pool:
            health, walls, memory = pool.apply(cost, (folder,), told)
        if len(cells) == 1:
            cells.append(f"{health:.2f}")
        cells.append(f"{walls:.2f} ({memory:.0f} MiB)")
        print(cells[-1], flush=True)
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    with TemporaryDirectory() as place:
        lines = [
            f"CPU time in s on one core, the machine at a load of {os.getloadavg()[0]:.1f}:",
            "",
            "| poses | health | 1-2 m | 1-6 m | 1-2 m, without numba |",
            "|---|---|---|---|---|",
        ]
        folder = walk(Path(place))
        asked = [int(word) for word in sys.argv[1:]] or [40, 80, MOST]
        lines += [row(folder, poses) for poses in asked]
    print("\n".join(lines))


if __name__ == "__main__":
    main()
