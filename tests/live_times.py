"""What does a pose cost a live map? `python tests/live_times.py [poses] [page]`.

A simulated walk of 60 poses, recordings as long as the paper's (20 000 samples of six microphones),
is linked under as many names as poses are asked for, 10 000 unless given, and mapped by the bundle
that comes along, with its own localizer and with each of the others. Printed are the CPU times of a
pose in ms (everything from looking at the folder to the row in `map.csv`, health and waterfall
included, numpy on one thread), the share that takes longer than the budget of 15 ms, the memory of
the process after the first poses and after the last, and the size of the table. The other
localizers map fewer poses, each in a process of its own. How many processes the machine ran is
told: beside others the same work takes longer.
"""

import csv
import os
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Room
from echolearn.localization.methods.em import Em
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.joint import Joint
from echolearn.localization.methods.mclam import Mclam
from echolearn.localization.methods.peaks import Peaks
from echolearn.localization.methods.snls import Snls
from echolearn.robot.live import following
from echolearn.robot.live.viewers import Viewers, Viewing
from echolearn.robot.shipped import find_bundle
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.white import White
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.simulation.survey import survey
from echolearn.storage.marked_page import Markers, write_between

BUDGET = 15.0
"""ms that a pose may take."""

FIRST = 250
"""Poses after which memory should grow no more, and of the other localizers."""

LOCALIZERS = {
    "gated": Gated(),
    "peaks": Peaks(),
    "joint": Joint(),
    "snls": Snls(),
    "em": Em(),
    "mclam": Mclam(),
}

MARKERS = Markers(
    "<!-- live times: written by `python tests/live_times.py` -->",
    "<!-- end of live times -->",
    "page",
)


def linked(source: Path, walk: Path, poses: int) -> Path:
    """Return a survey of so many poses, whose recordings are links to those of a short one."""
    (walk / "observations").mkdir(parents=True)
    for name in ("survey.yaml", "probe.wav"):
        os.link(source / name, walk / name)
    with (source / "poses.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    with (walk / "poses.csv").open("w", newline="") as file:
        out = csv.DictWriter(file, rows[0])
        out.writeheader()
        for number in range(poses):
            row = rows[number % len(rows)]
            name = f"observations/{number:05d}.wav"
            os.link(source / row["file"], walk / name)
            out.writerow(row | {"file": name, "index": number})
    return walk


def memory_mb() -> float:
    """Return the memory that the process has now, in MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def simulated(runs: Path) -> Path:
    """Simulate the short walk."""
    scene = Scene(circular_array(), noise_probe(), Images(), White())
    about: Any = {"room": Room((8.0, 6.0, 5.0), 0.6), "scene": scene}
    return survey(name="sixty", levels=NoiseLevels(20.0), poses=60, runs=runs, **about)


def mapped(walk: Path, place: Path, poses: int, localizer: Any) -> dict[str, Any]:  # in a child
    """Map so many poses with a localizer, and return what it cost."""
    about: dict[str, Any] = {"folder": place, "resolution": 0.05, "asked": {}}
    session = following._session(walk, find_bundle("point", place), **about)
    # The classifier is the bundle's: what it costs hangs on its columns, not on their values.
    session.scorer = replace(
        session.scorer, bundle=replace(session.scorer.bundle, localizer=localizer)
    )
    times = []
    early = 0.0
    with Viewers(Viewing(port=0), session.map, folder=place) as viewers:
        begun = time.process_time()
        while len(times) < poses:
            for new in session.step():
                viewers.pose(new)
                now = time.process_time()
                times.append(1000 * (now - begun))
                begun = now
                if len(times) == FIRST:
                    early = memory_mb()
                if len(times) >= poses:
                    break
    session.table.close()
    return {
        "times": np.array(times),
        "early": early,
        "late": memory_mb(),
        "table": (place / "map.csv").stat().st_size / 1e6,
    }


def row(name: str, found: dict[str, Any]) -> str:
    """Return a row of the table."""
    times = found["times"]
    shares = [np.median(times), times.mean(), *np.quantile(times, [0.9, 0.99]), times.max()]
    cells = [name, f"{len(times)}", *(f"{each:.1f}" for each in shares)]
    cells.append(f"{100 * np.mean(times > BUDGET):.0f} %")
    cells += [f"{found['early']:.0f}, {found['late']:.0f}", f"{found['table']:.2f}"]
    return f"| {' | '.join(cells)} |"


def main(words: Sequence[str]) -> None:
    """Print the table, and write it into a page if one is named."""
    poses = int(words[0]) if words else 10_000
    lines = [
        f"CPU time of a pose in ms; the machine ran {os.getloadavg()[0]:.1f} processes on "
        f"{os.cpu_count()} cores.",
        "",
        f"| localizer | poses | median | mean | 90 % | 99 % | most | over {BUDGET:g} ms | "
        f"MB after {FIRST}, after all | `map.csv` MB |",
        f"|{'---|' * 10}",
    ]
    with TemporaryDirectory() as scratch:
        runs = Path(scratch)
        fresh = get_context("spawn")
        with fresh.Pool(1) as pool:
            walk = linked(pool.apply(simulated, (runs,)), runs / "walk", poses)
        for name, localizer in LOCALIZERS.items():
            count = poses if name == "gated" else min(FIRST, poses)
            with fresh.Pool(1) as pool:
                found = pool.apply(mapped, (walk, runs / name, count, localizer))
            lines.append(row(name, found))
            print(lines[-1], flush=True)
    print("\n".join(lines))
    if words[1:]:
        text = "\n".join(lines)
        write_between(Path(words[1]), f"\n{text}\n", markers=MARKERS)


if __name__ == "__main__":
    main(sys.argv[1:])
