"""Whole sets: `generate` from nothing to the manifest beside the responses alone of
pyroomacoustics; growing sets.

Every time is that of the whole call, with the start of its processes, which pyroomacoustics is not
    charged for: its
processes wait, warm, for the positions. It computes an even choice of them; its time for all is
scaled up by their number.

Rows per second are those of the whole call (`rate`), and of the time after every process has
written its first shard (`steady rate`), by the times of the files: median and quartiles over up to
`PARTS` parts of the shards. Memory is the high-water mark of the resident set, of the process that
directs and of the largest of those that work; none of them did anything before.
"""

import re
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from resource import RUSAGE_CHILDREN, getrusage
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.geometry import microphone_positions
from echolearn.bench.measurement import Measurement, Setting, times
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
    """Time a whole set with one and with several processes, beside its responses by
    pyroomacoustics.
    """
    plan, count = setting.plan, setting.workers
    spots = places(plan)
    some = [
        spots[i] for i in sorted(set(np.linspace(0, len(spots) - 1, setting.positions).astype(int)))
    ]
    name = processes_of(count)
    plan.scene.received(some[0].room, some[0].pose)  # compiled once, for all processes to come
    with processes(count) as pool:
        respond = responding(pool, plan.scene, some)
        respond(some[:1] * count)
        contestants = {
            name: generator(setting, count),
            f"{PEER}, {name}": Contestant(
                lambda: respond(some), units=len(some) / len(spots), warm=False
            ),
        }
        contestants |= {processes_of(1): generator(setting, 1)} if count > 1 else {}
        laps = race(contestants, laps=setting.long_repetitions)
    for found in times("generate", laps, reference=name, parameter="rows", value=len(plan)):
        if not (
            found.variant.startswith(PEER) and found.measure == "cpu"
        ):  # its processes live on, their time unknown
            yield found


def places(plan: Plan) -> list[Spot]:
    """Return a spot of each position of a plan, in order."""
    spots = (plan.spot(row, np.random.default_rng(0)) for row in range(len(plan)))
    return list({spot.group: spot for spot in spots}.values())


def processes_of(count: int) -> str:
    """Return how many processes work, in words."""
    return "1 process" if count == 1 else f"{count} processes"


def generator(setting: Setting, workers: int) -> Contestant:
    """Return a whole `generate` into a folder of its own."""

    def work() -> None:
        with TemporaryDirectory(dir=setting.place) as place:
            generate(setting.plan, runs=Path(place), engine=Processes(workers))

    return Contestant(work, warm=False)


def responding(
    pool: ProcessPoolExecutor, scene: Scene, some: list[Spot]
) -> Callable[[list[Spot]], float]:
    """Return a function that lets the processes compute responses by pyroomacoustics at some spots."""
    chunk = max(1, len(some) // 16)
    return lambda spots: sum(
        pool.map(partial(respond, scene), spots, chunksize=chunk if len(spots) > 4 else 1)
    )


def respond(scene: Scene, spot: Spot) -> float:
    """Compute the responses at one spot by pyroomacoustics; return their sum, lest their transport
    be timed.
    """
    at = microphone_positions(scene.array, spot.pose)
    rate, speed = scene.probe.sample_rate, scene.speed_of_sound
    return float(
        Pyroom()(spot.room, spot.pose.position, at, sample_rate=rate, speed_of_sound=speed).sum()
    )


class Made(NamedTuple):
    """What making a set took.

    Attributes:
        seconds: by the clock.
        rates: rows per second of each part of the shards.
        bytes: on the disk.
        director, worker: high-water mark of the resident set, bytes.
    """

    seconds: float
    rates: list[float]
    bytes: int
    director: int
    worker: int


def growing(setting: Setting) -> Iterator[Measurement]:
    """Time the growing set at each number of rows, in fresh processes, with its memory and its
    size.
    """
    for rows in track(setting.rows, "bench rows", unit="sizes"):
        with processes(1) as pool:
            plan = replace(setting.growing, rows=rows)
            made = pool.submit(make, plan, setting.place, setting.workers).result()
        about = ("rows", processes_of(setting.workers), "rows", rows)
        yield Measurement(*about, "wall", "s", [made.seconds])
        yield Measurement(*about, "rate", "1/s", [rows / made.seconds])
        yield Measurement(*about, "steady rate", "1/s", made.rates)
        yield Measurement(*about, "size", "byte", [made.bytes])
        yield Measurement(*about, "memory, director", "byte", [made.director])
        yield Measurement(*about, "memory, worker", "byte", [made.worker])


def make(plan: Plan, place: Path, workers: int) -> Made:
    """Make a set in a folder of its own, and remove it; memory is that of this process and those it
    starts.
    """
    with TemporaryDirectory(dir=place) as folder:
        began = time.perf_counter()
        made = generate(plan, runs=Path(folder), engine=Processes(workers))
        seconds = time.perf_counter() - began
        size = sum(path.stat().st_size for path in made.iterdir())
        written = [path.stat().st_mtime_ns * 1e-9 for path in sorted(made.glob("shard-*.npy"))]
    rates = steady_rates(written[: len(plan) // plan.shard_rows], plan.shard_rows, workers=workers)
    largest = getrusage(RUSAGE_CHILDREN).ru_maxrss * 1024
    return Made(seconds, rates, size, resident_peak(), largest)


def steady_rates(written: Sequence[float], shard_rows: int, *, workers: int) -> list[float]:
    """Return rows per second once every process has written a shard, in up to `PARTS` parts; NaN
    for too few shards.

    Processes that began together end together, so time is looked at after every `workers` shards
    only.

    Args:
        written: when each whole shard was, in s, in any order.
        shard_rows: rows in each.
        workers: processes.
    """
    marks = sorted(written)[workers - 1 :: workers]
    parts = max(1, min(PARTS, (len(marks) - 1) // 4))
    ends = (
        sorted(set(np.linspace(0, len(marks) - 1, parts + 1).astype(int).tolist())) if marks else []
    )
    rates = [(b - a) * workers * shard_rows / (marks[b] - marks[a]) for a, b in pairwise(ends)]
    return rates or [float("nan")]


def resident_peak() -> int:
    """Return the high-water mark of this process's resident set, in bytes; not that of what it was
    forked from.
    """
    [kilobytes] = re.findall(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text())
    return int(kilobytes) * 1024
