"""How times are taken: contestants run in turns, and are compared lap by lap.

    lap i: every contestant once, first the one that was second in lap i - 1
    ratio_i = t_i / t_i of the reference

What slows a machine down for a while slows all contestants of those laps, so the ratios hold where
the times do not. Of times and of ratios the median over laps is reported, with quartiles (Hyndman
and Fan's type 7, NumPy's default).

Not counted is the first call of each contestant, which compiles, fills caches and pages. What takes
less than `SHORTEST` is called several times within a lap. Wall time is that of the monotonic clock,
CPU time that of this process and of those it started that have ended.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from resource import RUSAGE_CHILDREN, getrusage
from typing import NamedTuple, TypeVar

import numpy as np

K = TypeVar("K")

SHORTEST = 5e-3
"""Seconds below which the clock, the loop around it and interrupts would show in a lap."""


class Lap(NamedTuple):
    """Seconds that one unit of work took, by the clock and of the processor."""

    wall: float
    cpu: float


class Spread(NamedTuple):
    """Median and quartiles."""

    median: float
    q1: float
    q3: float


@dataclass(frozen=True)
class Contestant:
    """What is timed.

    Attributes:
        work: one call of it.
        units: amount of work that a call does; laps are seconds per unit.
        warm: whether to call it before the first lap, which whole processes do not need.
    """

    work: Callable[[], object]
    units: float = 1.0
    warm: bool = True


def spread(values: Sequence[float]) -> Spread:
    """Return median and quartiles of values (n,)."""
    q1, median, q3 = np.quantile(values, [0.25, 0.5, 0.75]).tolist()
    return Spread(median, q1, q3)


def ratios(values: Sequence[float], reference: Sequence[float]) -> Spread:
    """Return median and quartiles of values / reference, lap by lap, both (n,)."""
    return spread([value / other for value, other in zip(values, reference, strict=True)])


def exponent(x: Sequence[float], seconds: Sequence[float]) -> float:
    """Return the p of seconds ~ x^p that fits best: the slope of least squares in logarithms."""
    return float(np.polyfit(np.log(x), np.log(seconds), 1)[0])


def cpu_seconds() -> float:
    """Return the CPU time of this process and of those it started that have ended."""
    # Work shared out among processes would else seem to cost nothing.
    ended = getrusage(RUSAGE_CHILDREN)
    return time.process_time() + ended.ru_utime + ended.ru_stime


def lap(contestant: Contestant, calls: int = 1) -> Lap:
    """Time so many calls; return seconds per unit of work."""
    cpu = cpu_seconds()
    wall = time.perf_counter()
    for _ in range(calls):
        contestant.work()
    units = calls * contestant.units
    return Lap((time.perf_counter() - wall) / units, (cpu_seconds() - cpu) / units)


def calls_per_lap(contestant: Contestant) -> int:
    """Warm a contestant up, and return how many calls of it last at least `SHORTEST`."""
    if not contestant.warm:
        return 1
    # The first call fills caches and compiles; what it takes says nothing of the next.
    lap(contestant)
    return max(1, math.ceil(SHORTEST / max(lap(contestant).wall * contestant.units, 1e-9)))


def race(
    contestants: Mapping[K, Contestant], *, laps: int, seconds: float = math.inf, least: int = 3
) -> dict[K, list[Lap]]:
    """Let contestants run in turns.

    Args:
        contestants: by name.
        laps: how often each of them runs.
        seconds: no further lap begins after so many.
        least: laps that are run in any case, if `laps` are not fewer.

    Returns:
        Each one's laps, the same number for all: lap i of one ran beside lap i of the others.
    """
    calls = {name: calls_per_lap(contestant) for name, contestant in contestants.items()}
    taken: dict[K, list[Lap]] = {name: [] for name in contestants}
    order = list(contestants)
    began = time.perf_counter()
    for number in range(laps):
        if number >= least and time.perf_counter() - began > seconds:
            break
        for name in order:
            taken[name].append(lap(contestants[name], calls[name]))
        # Whoever is first always finds the caches of the last: nobody is first twice in a row.
        order = order[1:] + order[:1]
    return taken
