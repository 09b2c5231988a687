"""`train init=`: a filter that was trained before, adapted to a few labelled recordings.

    bundle or run, labelled set --earlier_filter--> EarlierFilter
    its maker, EarlierFilter --begun--> a classifier that begins from it

What is fitted, calibrated, exported and evaluated is a run like any other, whose metrics say as
`adapted_from` what it began from, by name and digest, and on which sets that had learned. Rows are
divided by places: those of one, and what is within 0.1 m of it, are on one side of every division
(`group` of a labelled set). Of fewer than `LEAST` places each part has one or two, and what a test
says of them is chance.
"""

import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.checks import check
from echolearn.classifiers.calibration import Mapping, Sigmoid, Steps
from echolearn.classifiers.classifier import Classifier
from echolearn.classifiers.earlier import EarlierFilter, Learned
from echolearn.classifiers.inputs import is_tensor
from echolearn.dataset.labelled_set import Dataset
from echolearn.robot.bundle import read_bundle
from echolearn.robot.shipped import find_bundle
from echolearn.storage import manifests
from echolearn.storage.named import folder_named
from echolearn.training.export import set_of
from echolearn.training.predictions import load_scorer
from echolearn.training.runs import Run, read_run
from echolearn.training.split import LearningProblem

LEAST = 10
"""Places of a set that a filter is adapted to."""

ALLOWED = "must be the folder of a bundle or a run, or the name of one"

WEIGHTS = "best.safetensors"


def earlier_filter(
    given: str, problem: LearningProblem, *, runs: Path, force: bool = False
) -> EarlierFilter:
    """Return the filter of a bundle or a run, if it is of use to adapt it to a set.

    Args:
        given: name, beginning of the name of a run, or path.
        problem: what is to be learned, and how its rows are divided.
        runs: folder of everything generated.
        force: whether few places are taken.

    Raises:
        BadValue: neither, or one that is damaged; few places, rows that are not divided by them, a
            set that the filter has learned from, or a tensor of another array.
    """
    place = folder_named(given, "train", runs=runs, key="init")
    if (place / manifests.METRICS).is_file():
        found = _of_run(read_run(place.resolve()))
    else:
        found = _of_bundle(find_bundle(given, runs, key="init", allowed=ALLOWED))
    _check_divided(problem, force=force)
    _check_fits(found, problem.dataset)
    places = len(np.unique(problem.groups()))
    return replace(found, told={**found.told, "places": places})


def _of_bundle(folder: Path) -> EarlierFilter:
    found = read_bundle(folder)
    about = found.about
    data = [about["data"]["digest"], *about.get("adapted_from", {}).get("data", [])]
    return EarlierFilter(
        {"kind": "bundle", "name": about["name"], "sha256": about["sha256"], "data": data},
        classifier=about["name"],
        inputs=found.inputs,
        microphones=found.array.positions.tolist(),
        model=found.model,
        open=partial(load_scorer, folder),
    )


def _of_run(run: Run) -> EarlierFilter:
    told = {"kind": "run", "name": run.identity, "sha256": run.metrics["sha256"]}
    # A network's run has them; what else learns has none, and cannot go on.
    trained = (run.folder / WEIGHTS).is_file()
    return EarlierFilter(
        {**told, "data": [*run.learned_from]},
        classifier=run.model.classifier,
        inputs=tuple(run.inputs),
        microphones=run.metrics.get("microphones"),
        model=(run.folder / "model.onnx").read_bytes(),
        open=partial(load_scorer, run.folder),
        learned=partial(_learned, run) if trained else None,
    )


def _learned(run: Run) -> Learned:
    """Return what a run of a network has learned; its set must still be there."""
    told = ("target", "seed", "split", "test_share", "validation_share", "train_rows")
    division = {key: run.metrics[key] for key in told if key in run.metrics}
    problem = LearningProblem(set_of(run), **division)
    rows = problem.inputs(run.inputs).part(problem.parts().train)
    return Learned(rows, (run.folder / WEIGHTS).read_bytes(), _mapping(run.metrics["calibration"]))


def _mapping(calibration: dict[str, Any]) -> Mapping:
    """Return the mapping of decisions that a run's metrics tell."""
    if "knots" not in calibration:
        return Sigmoid(calibration["slope"], calibration["intercept"])
    decision, confidence = np.array(calibration["knots"]).T
    return Steps(tuple(decision.tolist()), tuple(confidence.tolist()))


def _check_divided(problem: LearningProblem, *, force: bool) -> None:
    """Raise `BadValue` unless rows are divided by places, which are enough or taken by force."""
    allowed = "must be position where a filter is adapted"
    check(problem.split == "position", "split", problem.split, allowed=allowed)
    places = len(np.unique(problem.groups()))
    allowed = f"must be at least {LEAST}, so that each part of them has several"
    hint = "label recordings of more places, or take what comes by force=true"
    check(force or places >= LEAST, "places", places, allowed=allowed, hint=hint)


def _check_fits(earlier: EarlierFilter, dataset: Dataset) -> None:
    """Raise `BadValue` unless a filter is of use for a set; tell of another array."""
    name = earlier.told["name"]
    allowed = "must not have learned from this set"
    hint = "what it has seen says nothing of what adapting adds"
    check(dataset.digest not in earlier.told["data"], "init", name, allowed=allowed, hint=hint)
    array = dataset.array
    known = earlier.microphones
    if array is None or known is None or array.positions.tolist() == known:
        return
    allowed = "must be of the set's array, as it sees a tensor"
    check(not is_tensor(earlier.inputs), "init", name, allowed=allowed)
    said = f"init={name}: made for another array; compare it with a filter for this one"
    print(said, file=sys.stderr, flush=True)


def begun(make: Callable[[], Any], earlier: EarlierFilter) -> Classifier:
    """Return a classifier, made and not fitted, that begins from an earlier filter.

    Raises:
        BadValue: a classifier that cannot.
    """
    model = make()
    allowed = "must be adapted, or the network whose run init is"
    able = hasattr(model, "begin")
    check(able, "classifier", type(model).__name__.lower(), allowed=allowed, hint="leave it out")
    found: Classifier = model.begin(earlier)
    return found
