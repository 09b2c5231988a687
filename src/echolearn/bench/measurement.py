"""Benchmarks: functions of one interface, `Setting -> iterable of Measurement`, one module for each
kind of work.

Whatever has a peer is timed beside it in the same laps (`timing.race`): pyroomacoustics and the
generator of Habets for responses, loops over the equations for localizers, SciPy and NumPy for
single steps, one process for two.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Observation
from echolearn.checks import check, check_list, check_number, check_whole
from echolearn.dataset.plans import Plan, ScatteredPlan
from echolearn.localization.localizer import Localizer
from echolearn.runtime.timing import Contestant, Lap, Spread, race, ratios, spread
from echolearn.simulation.observe import observe
from echolearn.simulation.scene import Scene

COLUMNS = "stage variant parameter value measure unit n median q1 q3 reference ratio ratio_q1 ratio_q3".split()
"""Of `bench.csv`."""


@dataclass(frozen=True)
class Measurement:
    """One quantity, measured several times.

    Attributes:
        stage: of the benchmark.
        variant: who or what.
        parameter, value: what was varied, if anything, and its value.
        measure: `wall`, `cpu`, or another quantity.
        unit: of it.
        repetitions: each one's value, shape (n,).
        reference: the variant of the same stage, parameter and value that this one is compared
            with, if any.
        beside: the reference's repetitions, lap by lap, shape (n,).
        group: what variants belong together in a table: of a trained run its classifier.
    """

    stage: str
    variant: str
    parameter: str
    value: Any
    measure: str
    unit: str
    repetitions: Sequence[float]
    reference: str = ""
    beside: Sequence[float] = ()
    group: str = ""

    @property
    def spread(self) -> Spread:
        """Median and quartiles."""
        return spread(self.repetitions)

    @property
    def ratio(self) -> Spread | None:
        """How many times the reference: median and quartiles of the ratios of laps; None without a
        reference.
        """
        return ratios(self.repetitions, self.beside) if self.reference else None

    def row(self) -> dict[str, Any]:
        """Return the row of `bench.csv`."""
        nothing = Spread(np.nan, np.nan, np.nan)
        plain = {
            key: getattr(self, key)
            for key in ("stage", "variant", "parameter", "value", "measure", "unit")
        }
        compared = dict(zip(COLUMNS[-3:], self.ratio or nothing, strict=True))
        return (
            plain
            | {"n": len(self.repetitions), "reference": self.reference}
            | self.spread._asdict()
            | compared
        )


@dataclass(frozen=True)
class Setting:
    """What is timed, and how often.

    Attributes:
        plan: the set that is generated, and that observations are taken from.
        growing: the set whose number of rows grows.
        localizers: by name.
        runs: folder of everything generated: its trained runs are timed.
        place: folder for what is generated only to be timed.
        workers: processes where several are used.
        repetitions: laps of what is quick.
        long_repetitions: laps of what takes seconds.
        seconds: after which no further lap of a comparison begins.
        batch: observations that are localized together.
        positions: of `plan` at which pyroomacoustics is timed; its time for all is scaled up from
            these.
        rows: sizes of the growing set.
        t60: reverberation times, s.
        peer_t60: those at which the peers are timed, too.
        microphones: sizes of the ring.
        azimuths: sizes of the azimuth grid.
    """

    plan: Plan
    growing: ScatteredPlan
    localizers: Mapping[str, Localizer]
    runs: Path
    place: Path
    workers: int = 2
    repetitions: int = 15
    long_repetitions: int = 3
    seconds: float = 4.0
    batch: int = 64
    positions: int = 60
    rows: Sequence[int] = (1000, 3000, 10000)
    t60: Sequence[float] = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
    peer_t60: Sequence[float] = (0.3, 0.6, 1.0)
    microphones: Sequence[int] = (3, 6, 12, 24)
    azimuths: Sequence[int] = (45, 90, 180, 360, 720)

    def __post_init__(self) -> None:
        check(
            isinstance(self.growing, ScatteredPlan),
            "growing",
            self.growing.name,
            allowed="a scattered plan",
        )
        for name, high in (
            ("workers", 1024),
            ("repetitions", 1000),
            ("long_repetitions", 1000),
            ("positions", 10**6),
        ):
            check_whole(name, getattr(self, name), low=1, high=high)
        check_whole("batch", self.batch, low=1, high=4096)
        check_number("seconds", self.seconds, low=0.0, high=3600.0, unit="s")
        for name, low, high in (("rows", 1, 10**9), ("microphones", 2, 256), ("azimuths", 8, 3600)):
            check_list(name, getattr(self, name))
            for value in getattr(self, name):
                check_whole(name, value, low=low, high=high)
        for name in ("t60", "peer_t60"):
            check_list(name, getattr(self, name))
            for value in getattr(self, name):
                check_number(name, value, low=0.01, high=10.0, unit="s")

    def race(self, contestants: Mapping[str, Contestant]) -> dict[str, list[Lap]]:
        """Let contestants run in turns, as often as this setting says."""
        return race(contestants, laps=self.repetitions, seconds=self.seconds)


def times(
    stage: str,
    laps: Mapping[str, Sequence[Lap]],
    *,
    reference: str = "",
    parameter: str = "",
    value: Any = "",
    group: str = "",
) -> list[Measurement]:
    """Return wall and CPU times of the contestants of a race.

    Args:
        stage: of the benchmark.
        laps: of each contestant.
        reference: the contestant that the others are compared with, or none.
        parameter, value: what the race was about.
        group: of all of them.
    """
    found = []
    for variant, own in laps.items():
        other, name = (
            ((), "") if variant == reference or not reference else (laps[reference], reference)
        )
        for measure in Lap._fields:
            repetitions, beside = ([getattr(lap, measure) for lap in side] for side in (own, other))
            about = (stage, variant, parameter, value, measure, "s")
            found.append(
                Measurement(*about, repetitions, reference=name, beside=beside, group=group)
            )
    return found


def heard(plan: Plan, count: int, scene: Scene | None = None) -> Observation:
    """Return observations of `count` rows of a plan, evenly spaced, in another scene if given;
    (count, M, N).
    """
    scene = scene or plan.scene
    samples = []
    for row in np.linspace(0, len(plan) - 1, count).astype(int).tolist():
        rng = stream(plan.seed, "observation", row)
        spot = plan.spot(row, rng)
        observation, _ = observe(
            spot.room,
            spot.pose,
            scene=scene,
            levels=spot.levels,
            rng=rng,
            gain_db=spot.gain_db,
        )
        samples.append(observation.samples)
    return Observation(np.stack(samples), scene.probe, scene.array, scene.speed_of_sound)
