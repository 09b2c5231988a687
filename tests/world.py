"""A whole world, small enough for tests: labelled sets, classifiers trained on them, walks through
a room never seen.

The sets are those that `generate` makes, one shard each and without its processes.
"""

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Room
from echolearn.cli import config
from echolearn.comparison.choice import Comparison
from echolearn.comparison.compare import load_inputs
from echolearn.comparison.evaluate import evaluate
from echolearn.dataset.generate import folder_of
from echolearn.dataset.labelled_set import FORMAT, Dataset
from echolearn.dataset.plans import GridPlan, Plan, ScatteredPlan
from echolearn.dataset.records import records
from echolearn.localization.localizer import returned
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.snls import Snls
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.white import White
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.simulation.survey import survey
from echolearn.storage import manifests
from echolearn.storage.identity import by_short_names, plain
from echolearn.storage.once import locked
from echolearn.training.export import export
from echolearn.training.split import LearningProblem
from echolearn.training.train import train as train_run

HALL = Room((6.0, 5.0, 4.0), 0.25)
"""The room of the walks."""

WALKS = ("hall_0dB", "hall_-10dB")
POSES = 36  # more than are heard at a time

CLASSIFIERS: dict[str, dict[str, Any]] = {
    "threshold_peak": {
        "_target_": "echolearn.classifiers.methods.threshold.Threshold",
        "inputs": ["peak_to_rms"],
    },
    "svm_pair": {
        "_target_": "echolearn.classifiers.methods.svm.Svm",
        "inputs": ["toa", "power"],
        "c_grid": [1.0],
        "gamma_grid": [0.1, 1.0],
        "folds": 2,
    },
    "trees_features": {
        "_target_": "echolearn.classifiers.methods.trees.Trees",
        "inputs": ["peak_to_rms", "second_to_first", "joint", "coherence"],
        "iterations": 30,
        "min_leaf": 5,
        "patience": 10,
    },
}

TRAINED = (
    ("scattered", 0, ("svm_pair", "threshold_peak", "trees_features")),
    ("scattered", 1, ("svm_pair", "threshold_peak")),
    ("grid", 0, ("svm_pair", "threshold_peak")),
)


@dataclass(frozen=True)
class World:
    """Where everything lies, and how it is compared.

    Attributes:
        runs: folder of everything generated.
        sets: by name.
        arguments: of `compare`, but for the name and the number of workers.
    """

    runs: Path
    sets: dict[str, Dataset]
    arguments: dict[str, Any]


def plans() -> list[Plan]:
    """Return a grid in one room, positions in many rooms, and some off the grid in the walks'."""
    window = SearchWindow()
    shared: dict[str, Any] = {
        "margin": 1.0,
        "window": window,
        "scene": Scene(circular_array(), noise_probe(length=6000), Images(), White()),
        "localizer": Gated(window, 36),
        "snr_db": (-25.0, 25.0),
    }
    rooms = {"size_low": (5.0, 5.0, 3.0), "size_high": (8.0, 7.0, 4.0)}
    hall = {"size_low": HALL.size, "size_high": HALL.size, "role": "test"}
    scattered = partial(ScatteredPlan, t60=(0.25, 0.3), **shared)
    return [
        GridPlan("grid", 1, HALL, 0.8, **shared),
        scattered("scattered", 2, 140, **rooms),
        scattered("offgrid_hall", 3, 60, **hall),
    ]


def write_set(plan: Plan, runs: Path) -> Dataset:
    """Write the set of a plan unless it is there, and open it."""
    folder = folder_of(plan, runs)
    if not (folder / manifests.MANIFEST).exists():
        manifests.write_shard(folder, 0, array=records(plan, range(len(plan))))
        rows = len(plan) * returned(plan.localizer)
        about = {"kind": "set", "format": FORMAT, "rows": rows, "plan": plain(plan)}
        about["microphones"] = plan.scene.array.positions.tolist()
        manifests.finish(folder, about, files=[manifests.shard_name(0)])
    return Dataset(folder)


def train(dataset: Dataset, name: str, *, seed: int, runs: Path, **changes: Any) -> None:
    """Train one of the classifiers."""
    keys = CLASSIFIERS[name] | changes
    problem = LearningProblem(dataset, target="reflector", seed=seed)
    make = partial(config.build, keys, "classifier")
    train_run(problem, name=name, classifier=make, config=by_short_names(keys), runs=runs)


def make(runs: Path) -> World:
    """Make what is missing below `runs`."""
    sets = {plan.name: write_set(plan, runs) for plan in plans()}
    for plan, seed, names in TRAINED:
        for name in names:
            train(sets[plan], name, seed=seed, runs=runs)
    scene = plans()[0].scene
    for walk, snr_db in zip(WALKS, (0.0, -10.0), strict=True):
        levels = NoiseLevels(snr_db)
        survey(name=walk, room=HALL, scene=scene, levels=levels, poses=POSES, runs=runs)
    window = SearchWindow()
    arguments = {
        "tested": [*sets],
        "surveys": [*WALKS],
        "localizers": {"gated": Gated(window, 36), "snls": Snls(window, 36)},
        "resamples": 50,
        "runs": runs,
    }
    return World(runs, sets, arguments)


def pack(world: World, classifier: str, runs: Path, **changes: Any) -> Path:
    """Export the first run of a classifier on the scattered set."""
    run = next((world.runs / "train").glob(f"{classifier}-scattered-s0-*"), None)
    scene = plans()[0].scene
    given: dict[str, Any] = {"run": run, "best": None, "resamples": 30, "name": "small"}
    given |= {"array": scene.array, "probe": scene.probe, "runs": runs}
    return export(**given | changes)


def evaluated(world: World) -> Comparison:
    """Return the comparison of the world, by two processes."""
    keys = ("runs", "tested", "surveys", "localizers")
    inputs = load_inputs(**{key: world.arguments[key] for key in keys})
    return evaluate(inputs, resamples=50, workers=2)


def coming_second(
    work: Callable[[], Any], path: Path, first: Callable[[], Any], heard: Callable[[], str]
) -> Any:
    """Let `work` come to `path` while another is there, who does `first`; return what comes of it.

    Args:
        work: what waits.
        path: file or folder that both change.
        first: what is done meanwhile.
        heard: what has been said on stderr since it was asked last.
    """
    with ThreadPoolExecutor(1) as pool:
        with locked(path):
            coming = pool.submit(work)
            said = ""
            while "waiting for another command" not in said and not coming.done():
                time.sleep(0.01)
                said += heard()
            assert not coming.done()
            first()
        return coming.result()
