"""Trained runs: seconds of training, and of their exported models per observation.

Inference is that of onnxruntime on one thread, one row at a time as on a robot and 256 at a time as
in a comparison; its peer is the `onnx` package's own evaluator, which computes the same graph node
by node in NumPy. Rows are of the set that a run was trained on.
"""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.bench.measurement import Measurement, Setting, times
from echolearn.classifiers.inputs import COVARIANCE, view_of
from echolearn.dataset.labelled_set import Dataset
from echolearn.runtime.progress import track
from echolearn.runtime.timing import Contestant, race
from echolearn.storage import files, manifests
from echolearn.storage.identity import digest
from echolearn.training.predictions import load_scorer
from echolearn.training.runs import Run, finished_runs

ROWS = 256
EVALUATOR = "NumPy"
RUNTIME = "onnxruntime"
BRIEF = 0.5
"""Seconds for each run: there may be a hundred of them."""


def finished(setting: Setting) -> list[Run]:
    """Return the finished runs; says so if there are none."""
    runs = list(finished_runs(setting.runs))
    if not runs:
        print(f"bench: no trained runs under {setting.runs / 'train'}", file=sys.stderr, flush=True)
    for run in runs:
        manifests.verify(run.folder)
    return runs


def training(setting: Setting) -> Iterator[Measurement]:
    """Return how long each run took to be fitted and in all, by its own record."""
    for run in finished(setting):
        spent = files.load_json(run.folder / "timing.json")
        for measure in ("fit", "total"):
            about = ("train", run.identity, "rows", run.metrics["rows"]["train"], measure, "s")
            yield Measurement(*about, [spent[measure]], group=run.classifier)


def inference(setting: Setting) -> Iterator[Measurement]:
    """Time each run's model per observation, one row at a time and many."""
    sets: dict[str, Dataset] = {}
    for folder in sorted((setting.runs / "data").glob(f"*/{manifests.MANIFEST}")):
        key = digest(manifests.load_manifest(folder.parent)["files"])
        sets[key] = Dataset(folder.parent)
    for run in track(finished(setting), "bench models", unit="runs"):
        if run.data_digest not in sets:
            print(
                f"bench models: the set of {run.identity} is gone; left out",
                file=sys.stderr,
                flush=True,
            )
            continue
        x, score = inputs_of(run, sets[run.data_digest]), load_scorer(run.folder)
        for rows in (1, len(x)):
            contestants = {
                f"{run.identity}, {RUNTIME}": score,
                f"{run.identity}, {EVALUATOR}": evaluator(run.folder),
            }
            yield from raced(contestants, x[:rows], setting, group=run.classifier)


def raced(
    contestants: dict[str, Callable[[Array], Any]], x: Array, setting: Setting, *, group: str
) -> Iterator[Measurement]:
    """Time functions of the same rows per row, in turns; the first is the reference."""
    asked = {
        name: Contestant(lambda score=score: score(x), units=len(x))
        for name, score in contestants.items()
    }  # type: ignore[misc]
    laps = race(asked, laps=setting.repetitions, seconds=min(BRIEF, setting.seconds))
    yield from times(
        "models", laps, reference=next(iter(laps)), parameter="batch", value=len(x), group=group
    )


def inputs_of(run: Run, dataset: Dataset) -> Array:
    """Return up to `ROWS` rows of what a run looks at, float32."""
    if view_of(run.inputs) == COVARIANCE:
        return np.asarray(dataset[run.inputs[0]][:ROWS], dtype=np.float32)
    return np.stack([dataset[name][:ROWS] for name in run.inputs], axis=1).astype(np.float32)


def evaluator(folder: Path) -> Callable[[Array], Any]:
    """Return a run's model as the `onnx` package evaluates it, in NumPy."""
    from onnx.reference import ReferenceEvaluator

    model = ReferenceEvaluator((folder / "model.onnx").read_bytes())
    return lambda x: model.run(None, {"x": x})
