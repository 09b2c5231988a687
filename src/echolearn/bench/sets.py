"""Whole sets beside the responses alone of pyroomacoustics; growing sets.

Every time is that of the whole call, with the start of its processes, which pyroomacoustics is not
charged for: its processes wait, warm, for the positions. It computes an even choice of them; its
time for all is scaled up by their number.

Rows per second are those of the whole call (`rate`), and of the time after every process has
written its first shard (`steady rate`), by the times of the files: median and quartiles over up to
`PARTS` parts of the shards. Memory is the high-water mark of the resident set, of the process that
directs and of the largest of those that work; none of them did anything before.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from tempfile import TemporaryDirectory

import numpy as np

from echolearn.bench.measurement import Measurement, Setting, times
from echolearn.bench.memory import peak_memory
from echolearn.bench.responses import responding
from echolearn.dataset.generate import generate
from echolearn.dataset.plans import Plan, Spot
from echolearn.runtime.engines.processes import Processes
from echolearn.runtime.processes import processes
from echolearn.runtime.progress import track
from echolearn.runtime.timing import Contestant, race
from echolearn.simulation.rir.pyroom import Pyroom
from echolearn.simulation.scene import Scene

PARTS = 10
PEER = "pyroomacoustics, responses alone"


def generating(setting: Setting) -> Iterator[Measurement]:
    """Time a whole set with one and with several processes, beside pyroomacoustics."""
    plan = setting.plan
    count = setting.workers
    every = [plan.spot(row, np.random.default_rng(0)) for row in range(len(plan))]
    spots = list({spot.group: spot for spot in every}.values())
    chosen = np.linspace(0, len(spots) - 1, setting.positions).astype(int)
    some = [spots[index] for index in np.unique(chosen)]
    work = partial(respond, plan.scene)
    plan.scene.received(some[0].room, some[0].pose)  # compiled once, for all processes to come
    with processes(count) as pool:
        # The peer is not charged for the start of its processes.
        list(pool.map(work, some[:1] * count))
        chunk = max(1, len(some) // 16)
        share = len(some) / len(spots)
        peer = Contestant(lambda: sum(pool.map(work, some, chunksize=chunk)), share, warm=False)
        contestants = {
            processes_of(count): generating_with(setting, count),
            f"{PEER}, {processes_of(count)}": peer,
            processes_of(1): generating_with(setting, 1),
        }
        laps = race(contestants, laps=setting.long_repetitions)
    for found in times("generate", laps, parameter="rows", value=len(plan)):
        # The peer's processes live on, so their CPU time is not known yet.
        if not (found.variant.startswith(PEER) and found.measure == "cpu"):
            yield found


def processes_of(count: int) -> str:
    """Return how many processes work, in words."""
    return "1 process" if count == 1 else f"{count} processes"


def generating_with(setting: Setting, workers: int) -> Contestant:
    """Return a whole `generate` into a folder of its own."""

    def work() -> None:
        """Generate the whole set once."""
        with TemporaryDirectory(dir=setting.place) as place:
            generate(setting.plan, runs=Path(place), engine=Processes(workers))

    return Contestant(work, warm=False)


def respond(scene: Scene, spot: Spot) -> float:
    """Compute the responses at a spot by pyroomacoustics; their sum, lest transport be timed."""
    return float(responding(Pyroom(), spot.room, scene=scene, pose=spot.pose)().sum())


def growing(setting: Setting) -> Iterator[Measurement]:
    """Time the growing set at each number of rows, in fresh processes."""
    for rows in track(setting.rows, "bench rows", unit="sizes"):
        plan = replace(setting.growing, rows=rows)
        with processes(1) as pool:
            yield from pool.submit(make_set, plan, setting.place, workers=setting.workers).result()


def make_set(plan: Plan, place: Path, *, workers: int) -> list[Measurement]:
    """Make a set in a folder of its own, and remove it.

    Args:
        plan: of the set.
        place: folder that is to hold it.
        workers: processes.

    Returns:
        Seconds, rates, size, and the memory of this process and those it starts.
    """
    with TemporaryDirectory(dir=place) as folder:
        began = time.perf_counter()
        made = generate(plan, runs=Path(folder), engine=Processes(workers))
        seconds = time.perf_counter() - began
        size = sum(path.stat().st_size for path in made.iterdir())
        written = [path.stat().st_mtime_ns * 1e-9 for path in sorted(made.glob("shard-*.npy"))]
    # The last shard may be a part, which would pass for a fast one.
    whole = written[: len(plan) // plan.shard_rows]
    found = (
        ("wall", "s", [seconds]),
        ("rate", "1/s", [len(plan) / seconds]),
        ("steady rate", "1/s", steady_rates(whole, plan.shard_rows, workers=workers)),
        ("size", "byte", [size]),
        ("memory, director", "byte", [peak_memory()]),
        ("memory, worker", "byte", [getrusage(RUSAGE_CHILDREN).ru_maxrss * 1024]),
    )
    about = ("rows", processes_of(workers), "rows", len(plan))
    return [Measurement(*about, *each) for each in found]


def steady_rates(written: Sequence[float], shard_rows: int, *, workers: int) -> list[float]:
    """Return rows per second once every process has written a shard, in up to `PARTS` parts.

    Args:
        written: when each whole shard was, in s, in any order.
        shard_rows: rows in each.
        workers: processes.

    Returns:
        A rate for each part; NaN alone for too few shards.
    """
    # Processes that began together end together: only every `workers`th shard is a fair mark.
    marks = sorted(written)[workers - 1 :: workers]
    parts = max(1, min(PARTS, (len(marks) - 1) // 4))
    ends = np.unique(np.linspace(0, max(0, len(marks) - 1), parts + 1).astype(int)).tolist()
    rows = workers * shard_rows
    rates = [rows * (b - a) / (marks[b] - marks[a]) for a, b in pairwise(ends)]
    return rates or [float("nan")]
