"""What every stage of the benchmark shares: a function `Setting -> iterable of Measurement`.

Whatever has a peer runs in turns with it (`runtime.timing.race`): pyroomacoustics and the generator
of Habets for responses, loops over the equations for localizers, SciPy and NumPy for single steps,
one process for two. The first contestant of a comparison is the reference of the others.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Observation
from echolearn.checks import check, check_list, check_number, check_whole
from echolearn.dataset.plans import Plan, ScatteredPlan
from echolearn.localization.localizer import Localizer
from echolearn.runtime.timing import Contestant, Lap, Spread, race, ratios, spread
from echolearn.simulation.observe import observe
from echolearn.simulation.realism import Realism
from echolearn.simulation.scene import Scene

KEYS = "stage variant parameter value measure unit".split()
COLUMNS = [*KEYS, *"n median q1 q3 reference ratio ratio_q1 ratio_q3".split()]
"""Columns of `bench.csv`; the first six tell what was measured."""

ALONE = Spread(np.nan, np.nan, np.nan)
"""Ratio of what is compared with nothing."""


@dataclass(frozen=True)
class Measurement:
    """One quantity, measured several times.

    Attributes:
        stage: name of the stage.
        variant: who or what was measured.
        parameter, value: what was varied, if anything, and its value.
        measure: `wall`, `cpu`, or another quantity.
        unit: unit of the quantity.
        repetitions: value of each repetition, shape (n,).
        reference: variant of the same stage, parameter and value that this one is compared with;
            empty for that one itself.
        ratio: how many times the reference, median and quartiles over laps; NaN without one.
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
    ratio: Spread = ALONE
    group: str = ""

    @property
    def spread(self) -> Spread:
        """Median and quartiles."""
        return spread(self.repetitions)

    @property
    def keys(self) -> dict[str, Any]:
        """What was measured: the first columns of each table."""
        return {key: getattr(self, key) for key in KEYS}

    def row(self) -> dict[str, Any]:
        """Return the row of `bench.csv`."""
        rest = (len(self.repetitions), *self.spread, self.reference, *self.ratio)
        return dict(zip(COLUMNS, (*self.keys.values(), *rest), strict=True))


LIMITS: dict[str, tuple[float, float]] = {
    "workers": (1, 1024),
    "repetitions": (1, 1000),
    "long_repetitions": (1, 1000),
    "positions": (1, 10**6),
    "batch": (1, 4096),
    "rows": (1, 10**9),
    "microphones": (2, 256),
    "azimuths": (8, 3600),
    "seconds": (0.0, 3600.0),
    "t60": (0.01, 10.0),
    "peer_t60": (0.01, 10.0),
}
SECONDS = ("seconds", "t60", "peer_t60")
LISTS = ("rows", "microphones", "azimuths", "t60", "peer_t60")


@dataclass(frozen=True)
class Setting:
    """What is timed, and how often.

    Attributes:
        plan: the set that is generated, and that observations are taken from.
        growing: the set whose number of rows grows.
        realistic: what is not ideal, for the time that it takes.
        localizers: localizers by name.
        runs: folder of everything generated: its trained runs and bundles are timed.
        place: folder for what is generated only to be timed.
        workers: processes where several are used.
        repetitions: laps of what is quick.
        long_repetitions: laps of what takes seconds.
        seconds: time after which no further lap of a comparison begins, in s.
        batch: observations that are localized together.
        positions: positions of `plan` at which pyroomacoustics is timed; its time for all is scaled
            up from these.
        rows: sizes of the growing set.
        t60: reverberation times, s.
        peer_t60: those at which the peers are timed, too, s.
        microphones: sizes of the ring.
        azimuths: sizes of the azimuth grid.
    """

    plan: Plan
    growing: ScatteredPlan
    realistic: Realism
    localizers: Mapping[str, Localizer]
    runs: Path
    place: Path
    workers: int
    repetitions: int
    long_repetitions: int
    seconds: float
    batch: int
    positions: int
    rows: Sequence[int]
    t60: Sequence[float]
    peer_t60: Sequence[float]
    microphones: Sequence[int]
    azimuths: Sequence[int]

    def __post_init__(self) -> None:
        scattered = isinstance(self.growing, ScatteredPlan)
        check(scattered, "growing", self.growing.name, allowed="must be a scattered plan")
        for name, (low, high) in LIMITS.items():
            given = getattr(self, name)
            if name in LISTS:
                check_list(name, given)
            for value in given if name in LISTS else [given]:
                if name in SECONDS:
                    check_number(name, value, low=low, high=high, unit="s")
                else:
                    check_whole(name, value, low=int(low), high=int(high))

    @property
    def rings(self) -> dict[int, Scene]:
        """The plan's scene with each of the rings, by their numbers of microphones."""
        scene = self.plan.scene
        return {
            count: replace(scene, array=circular_array(microphones=count))
            for count in self.microphones
        }

    def compare(
        self, stage: str, contestants: Mapping[str, Contestant], **about: Any
    ) -> list[Measurement]:
        """Time contestants in turns, and compare each with the first.

        Args:
            stage: name of the stage.
            contestants: contestants by variant.
            about: parameter, value and group of the comparison (`times`).
        """
        laps = race(contestants, laps=self.repetitions, seconds=self.seconds)
        return times(stage, laps, **about)

    def grow(
        self, stage: str, variant: str, *, parameter: str, contestants: Mapping[int, Contestant]
    ) -> Iterator[Measurement]:
        """Time one variant at several values of a parameter, in turns.

        Args:
            stage: name of the stage.
            variant: who or what.
            parameter: what is varied.
            contestants: the variant at work, by value.
        """
        laps = race(contestants, laps=self.repetitions, seconds=self.seconds)
        for value, own in laps.items():
            yield from times(stage, {variant: own}, parameter=parameter, value=value)


def times(
    stage: str,
    laps: Mapping[str, Sequence[Lap]],
    *,
    parameter: str = "",
    value: Any = "",
    group: str = "",
) -> list[Measurement]:
    """Return wall and CPU times of a race, each compared with those of the first contestant.

    Args:
        stage: name of the stage.
        laps: laps of each contestant.
        parameter, value: what the race was about.
        group: what all contestants belong to in a table.
    """
    reference = next(iter(laps))
    found = []
    for variant, own in laps.items():
        for index, measure in enumerate(Lap._fields):
            values = [lap[index] for lap in own]
            compared: dict[str, Any] = {}
            # Lap by lap: what slows the machine down slows both of a lap.
            if variant != reference:
                beside = [lap[index] for lap in laps[reference]]
                compared = {"reference": reference, "ratio": ratios(values, beside)}
            about = (stage, variant, parameter, value, measure, "s", values)
            found.append(Measurement(*about, group=group, **compared))
    return found


def observations(plan: Plan, count: int, *, scene: Scene | None = None) -> Observation:
    """Simulate rows of a plan, evenly spaced.

    Args:
        plan: gives positions and levels.
        count: B, how many rows.
        scene: what the robot carries, if not what the plan says.

    Returns:
        Observations, samples (B, M, N).
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
            gain_db=spot.gain_db,
            rng=rng,
        )
        samples.append(observation.samples)
    return Observation(np.stack(samples), scene.probe, scene.array, scene.speed_of_sound)
