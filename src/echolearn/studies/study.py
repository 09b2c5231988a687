"""How well echoes are found: every localizer's accuracy while one thing of the scene is varied.

At each value all localizers hear the same recordings, in corners of the room or along walks through
it (`places`), of
one burst or of another at each position: what an estimator makes of noise of few lines hangs on the
    burst. The wall
that an estimate is *matched* with is the one whose true TOA is nearest to it, or of several within
5 samples the one nearest in direction. Each metric is a share of all recordings:

| metric  | the estimate ...                                                                  |
|---------|-----------------------------------------------------------------------------------|
| toa     | lies within 5 samples of its wall's TOA (the paper, V-B)                            |
| doa     | lies within 5 degrees of its wall; a planar array need not tell up from down        |
| doa_any | lies within 5 degrees of any wall's azimuth: the paper's rule, easily met by chance |
| on_map  | lies, as a map point, within 0.10 m of a wall                                       |

`chance` draws a TOA evenly from the window and an azimuth evenly from the circle. Intervals are a
bootstrap over positions; where all or none of the recordings hit, Wilson's.

A localizer that refuses the recordings of a faulty array (S-NLS, if microphone 1 is the dead one)
misses. A study is
resumed value by value: what was found at one value is one shard of its folder. Estimates are not
    thrown
away: a study with other settings is never replaced; intervals (`resamples`) and files of an older
    format are made anew
from them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.geometry import SearchWindow, check_inside
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Array, Pose, Room
from echolearn.checks import BadValue, check, check_list, check_name, check_number, check_whole
from echolearn.evaluation import stats
from echolearn.localization.localizer import Localizer
from echolearn.runtime.processes import processes
from echolearn.runtime.progress import track
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.scene import Scene
from echolearn.storage import manifests
from echolearn.storage.files import clean, write_atomic
from echolearn.storage.identity import canonical, digest, plain
from echolearn.storage.once import locked
from echolearn.studies import curves, places
from echolearn.studies.trials import FAULTS, METRICS, Condition, Trials

CHANCE = "chance"
VARIED = ("snr_db", "sdnr_db", "t60", "fault", "pings", "stretch")
BURSTS = ("one", "each")


@dataclass(frozen=True)
class Study:
    """What is varied, where, and how often.

    Attributes:
        vary: snr_db, sdnr_db, t60, fault, pings, or stretch: of noise, one that all recordings
            hear.
        values: of it, ascending; faults by name, stretches by number.
        room: a shoebox.
        scene: what the robot carries.
        localizers: by name.
        snr_db: unless varied; None is no sensor noise.
        sdnr_db: unless varied; None is no diffuse noise.
        walls: distances of the two nearest walls of every position, in m.
        window: from which `chance` draws.
        positions: how many.
        trials: recordings at each value, shared out evenly over the positions.
        seed: of positions and noise.
        bursts: one, that of the scene, or each: a burst of its own, as long, for every position.
        pings: unless varied; how many recordings are averaged, each at the levels above.
        places: corners, low or walk, see `places`; a walk keeps its own distances from the walls.
    """

    vary: str
    values: Sequence[Any]
    room: Room
    scene: Scene
    localizers: Mapping[str, Localizer]
    snr_db: float | None = 40.0
    sdnr_db: float | None = None
    walls: tuple[float, float] = (1.0, 1.5)
    window: SearchWindow = SearchWindow()
    positions: int = 20
    trials: int = 100
    seed: int = 0
    bursts: str = "each"
    pings: int = 1
    places: str = "corners"

    def __post_init__(self) -> None:
        check(self.vary in VARIED, "vary", self.vary, allowed=", ".join(VARIED))
        check_list("values", self.values)
        check(len(self.values) > 0, "values", "[]", allowed="at least one value")
        for value in self.values:
            check(
                isinstance(value, str | int | float),
                "values",
                value,
                allowed="numbers, or names of faults",
            )
        check(
            len(set(self.values)) == len(self.values),
            "values",
            list(self.values),
            allowed="each value once",
        )
        check(len(self.localizers) > 0, "localizers", "{}", allowed="at least one")
        hint = "tables and figures call guessing so"
        check(
            CHANCE not in self.localizers, "localizers", CHANCE, allowed="another name", hint=hint
        )
        check_list("walls", self.walls, length=2, allowed="two distances in m")
        for distance in self.walls:
            check_number("walls", distance, low=0.0, high=100.0, unit="m")
        check_whole("positions", self.positions, low=2, high=10_000, hint="intervals need several")
        check_whole(
            "trials",
            self.trials,
            low=self.positions,
            high=1_000_000,
            hint="one per position at least",
        )
        check_whole("seed", self.seed, low=0)
        for value in self.values:
            self.condition(value)
        ascending = self.vary == "fault" or sorted(self.values) == list(self.values)
        check(
            ascending,
            "values",
            list(self.values),
            allowed="in ascending order",
            hint="figures join them in turn",
        )
        check(self.bursts in BURSTS, "bursts", self.bursts, allowed=" or ".join(BURSTS))
        check(self.places in places.PLACES, "places", self.places, allowed=", ".join(places.PLACES))
        check(
            any(self.room.walls),
            "room.walls",
            list(self.room.walls),
            allowed="one that reflects, at least",
        )
        for pose in self.poses():
            self._check_inside(pose)

    def _check_inside(self, pose: Pose) -> None:
        try:
            check_inside(self.room, self.scene.array, pose)
        except BadValue:
            place, size = (
                ", ".join(f"{x:g}" for x in pose.position),
                " x ".join(f"{x:g}" for x in self.room.size),
            )
            allowed = f"the whole array inside the room of {size} m; with places={self.places} it would be at ({place})"
            raise BadValue(f"walls={list(self.walls)} m: {allowed}") from None

    def condition(self, value: Any) -> Condition:
        """Return what a value stands for.

        Raises:
            BadValue: out of range, a T60 that the room cannot have, an unknown fault.
        """
        levels = NoiseLevels(self.snr_db, self.sdnr_db, self.pings)
        usual = Condition(self.room, levels, FAULTS["none"])
        if self.vary == "fault":
            check(value in FAULTS, "values", value, allowed=", ".join(FAULTS))
            found = replace(usual, fault=FAULTS[value])
        elif self.vary == "t60":
            found = replace(usual, room=replace(self.room, t60=value))
        elif self.vary == "stretch":
            found = replace(usual, stretch=value)
        else:
            found = replace(usual, levels=replace(levels, **{self.vary: value}))
        found.levels.check_scene(self.scene)
        if found.stretch is not None:
            check_whole("values", found.stretch, low=0, hint="stretches go by number")
        return found

    def poses(self) -> list[Pose]:
        """Return where the robot stands, one pose per position."""
        if self.places == "walk":
            return places.walked(self.room, self.positions, seed=self.seed)
        if self.places == "low":
            return places.low(self.walls, self.positions)
        return [
            places.corner(self.room, self.walls, seed=self.seed, position=p)
            for p in range(self.positions)
        ]

    def heard(self, position: int) -> Scene:
        """Return the scene of a position, with the burst that is emitted there."""
        if self.bursts == "one":
            return self.scene
        probe = self.scene.probe
        seed = stream(self.seed, "burst", position).integers(10**9)
        burst = noise_probe(seed=int(seed), burst=len(probe.samples), length=probe.length).samples
        return replace(self.scene, probe=replace(probe, samples=burst))


def run(
    study: Study,
    *,
    name: str,
    runs: Path,
    workers: int = 1,
    resamples: int = 1000,
    command: str | None = None,
) -> Path:
    """Carry out a study, or what is missing of it, and write its table and figures.

    Args:
        study: what to vary.
        name: names the folder under `runs/study`.
        runs: folder of everything generated.
        workers: processes; the result does not depend on their number.
        resamples: bootstrap draws behind every interval.
        command: what makes the study again, for its manifest; None says nothing about it.

    Returns:
        The study's folder.

    Raises:
        BadValue: an argument out of range, a study of that name made with other settings, or a
            folder that cannot be written.
    """
    check_name("name", name)
    check_whole("workers", workers, low=1, high=1024)
    check_whole("resamples", resamples, low=20, high=100_000)
    folder = Path(runs) / "study" / name
    about = {
        "kind": "study",
        "format": curves.FORMAT,
        "study": plain(study),
        "resamples": resamples,
    }
    if not _is_finished(folder, about):
        with locked(folder, waiting=f"study {name}: waiting for another command that makes it"):
            if not _is_finished(folder, about):
                estimates = folder / _estimates(about["study"])
                _listen(study, estimates, workers=workers)
                files = curves.make(
                    name, study.vary, _judged(study, estimates, resamples=resamples)
                )
                for file, content in files.items():
                    write_atomic(folder / file, content)
                manifests.finish(folder, about | manifests.made_by(command), files)
    curves.show(folder)
    return folder


def _estimates(study: Any) -> str:
    """Return the name of the folder that holds what was found in a study, given as plain
    containers.
    """
    return f"estimates-{digest(study)}"


def _is_finished(folder: Path, about: Mapping[str, Any]) -> bool:
    """Tell whether the study stands there whole; one of other settings is refused, finished or not."""
    try:
        manifest = manifests.load_manifest(folder)
    except BadValue:
        manifest = {}
    stands = {path.name for path in folder.glob("estimates-*")}
    stands |= {_estimates(manifest["study"])} if "study" in manifest else set()
    allowed = "a study made with the same settings, or a new name"
    hint = f"remove {folder} to make it anew"
    check(stands <= {_estimates(about["study"])}, "name", folder.name, allowed=allowed, hint=hint)
    try:
        manifests.verify(folder)
    except BadValue:
        return False
    return canonical({key: manifest.get(key) for key in about}) == canonical(about)


def _listen(study: Study, folder: Path, *, workers: int) -> None:
    """Write the shard of every value that has none yet."""
    clean(folder)
    count = len(study.values)
    missing = manifests.missing_shards(folder, count)
    with processes(max(1, min(workers, len(missing)))) as pool:
        jobs = [pool.submit(_write, study, folder, index) for index in missing]
        for job in track(
            jobs, f"study {folder.parent.name}", unit="values", done=count - len(missing)
        ):
            job.result()


def _write(study: Study, folder: Path, index: int) -> None:
    manifests.write_shard(folder, index, listen(study, study.values[index]))


def listen(study: Study, value: Any) -> Array:
    """Return what every localizer makes of the recordings at one value.

    Returns:
        Records, shape (trials,): `position`, its number; `hit`, shape (localizers + 1, 4), bool:
        the metrics in the order of `METRICS` for each localizer and, last, the share for `chance`.
    """
    condition, poses = study.condition(value), study.poses()
    share = np.array_split(np.arange(study.trials), study.positions)
    localizers = list(study.localizers.values())
    blocks = [
        Trials(
            condition, study.heard(place), poses[place], place, numbers.tolist(), study.seed
        ).judge(localizers, study.window)
        for place, numbers in enumerate(share)
    ]
    table = np.empty(
        study.trials,
        dtype=[("position", int), ("hit", float, (len(study.localizers) + 1, len(METRICS)))],
    )
    table["position"] = np.repeat(np.arange(study.positions), [len(numbers) for numbers in share])
    table["hit"] = np.concatenate(blocks)
    return table


def _judged(study: Study, folder: Path, *, resamples: int) -> list[curves.Row]:
    """Return one row for each value, localizer and metric."""
    rows = []
    for index, value in enumerate(study.values):
        table = np.load(folder / manifests.shard_name(index), allow_pickle=False)
        weights = stats.cluster_weights(table["position"], resamples=resamples)
        for column, name in enumerate([*study.localizers, CHANCE]):
            for metric, hit in zip(METRICS, table["hit"][:, column].T, strict=True):
                low, high = _interval(hit, weights)
                share = {"value": float(hit.mean()), "ci_low": low, "ci_high": high, "n": len(hit)}
                rows.append({"localizer": name, study.vary: value, "metric": metric, **share})
    return rows


def _interval(hit: Array, weights: Array) -> tuple[float, float]:
    if hit.min() == hit.max():
        found = stats.wilson(round(hit.sum()), len(hit))
    else:
        found = stats.interval(
            lambda w: hit.mean() if w is None else w @ hit / w.sum(axis=-1), weights
        )
    return found.low, found.high
