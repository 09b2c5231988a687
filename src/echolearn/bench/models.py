"""Trained runs: seconds of training, and of their exported models per observation.

Inference is that of onnxruntime on one thread, one row at a time as on a robot and 256 at a time as
in a comparison; its peer is the `onnx` package's own evaluator, which computes the same graph node
by node in NumPy. Rows are of the set that a run was trained on.
"""

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.bench.measurement import Measurement, Setting
from echolearn.classifiers.inputs import stack_inputs
from echolearn.dataset.labelled_set import Dataset
from echolearn.runtime.progress import track
from echolearn.runtime.timing import Contestant
from echolearn.storage import files, manifests
from echolearn.storage.identity import digest
from echolearn.training.predictions import load_scorer
from echolearn.training.runs import Run, finished_runs

ROWS = 256
BRIEF = 0.5
"""Seconds for each run: there may be a hundred of them."""


def proved_runs(setting: Setting) -> list[Run]:
    """Return the finished runs, each proved whole; says so if there are none."""
    runs = list(finished_runs(setting.runs))
    if not runs:
        print(f"bench: no trained runs under {setting.runs / 'train'}", file=sys.stderr)
    for run in runs:
        manifests.verify(run.folder)
    return runs


def training(setting: Setting) -> Iterator[Measurement]:
    """Return how long each run took to be fitted and in all, by its own record."""
    for run in proved_runs(setting):
        spent = files.load_json(run.folder / "timing.json")
        for measure in ("fit", "total"):
            about = ("train", run.identity, "rows", run.metrics["rows"]["train"], measure, "s")
            yield Measurement(*about, [spent[measure]], group=run.model.classifier)


def inference(setting: Setting) -> Iterator[Measurement]:
    """Time each run's model per observation, one row at a time and many."""
    # A hundred runs at full length would take the hour that all else takes.
    brief = replace(setting, seconds=min(BRIEF, setting.seconds))
    # Runs name their set by its digest, whatever its folder is called.
    sets: dict[str, Dataset] = {}
    for manifest in sorted((setting.runs / "data").glob(f"*/{manifests.MANIFEST}")):
        key = digest(manifests.load_manifest(manifest.parent)["files"])
        sets[key] = Dataset(manifest.parent)
    for run in track(proved_runs(setting), "bench models", unit="runs"):
        if run.data_digest not in sets:
            print(f"bench models: the set of {run.identity} is gone; left out", file=sys.stderr)
            continue
        dataset = sets[run.data_digest]
        x = stack_inputs(run.inputs, dataset)[:ROWS].astype(np.float32)
        scorers = {"onnxruntime": load_scorer(run.folder), "NumPy": evaluator(run.folder)}
        for rows in (1, len(x)):
            contestants = {
                f"{run.identity}, {name}": Contestant(partial(score, x[:rows]), units=rows)
                for name, score in scorers.items()
            }
            about = {"parameter": "batch", "value": rows, "group": run.model.classifier}
            yield from brief.compare("models", contestants, **about)


def evaluator(folder: Path) -> Callable[[Array], Any]:
    """Return a run's model as the `onnx` package evaluates it, in NumPy."""
    from onnx.reference import ReferenceEvaluator

    model = ReferenceEvaluator((folder / "model.onnx").read_bytes())
    return lambda x: model.run(None, {"x": x})
