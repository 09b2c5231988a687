"""One labelled set and one classifier make one run: a folder with a calibrated, exported, judged
model.

`fit` sees the training part, and the validation part for early stopping only. The validation part
also fixes the calibration and the threshold, by the same rule for every classifier
(`classify.calibration`). The test part is looked at once.

A run's folder is named after its configuration and its data. It holds `config.json`, `model.onnx`
(raw inputs to confidence, the only form in which a model is ever loaded again), `timing.json`,
logs, and `metrics.json`, written
last: without it the run is unfinished and the same command redoes it, with equal metrics.

torch and scikit-learn are imported only when there is something to fit: finding forty finished runs
takes milliseconds.
"""

import math
import shutil
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check, check_name
from echolearn.classifiers.calibration import Calibrated, calibrate
from echolearn.classifiers.classifier import Classifier
from echolearn.classifiers.inputs import Rows, as_input
from echolearn.evaluation import metrics
from echolearn.storage import files, manifests
from echolearn.storage.identity import canonical, digest, kind_of
from echolearn.storage.once import locked
from echolearn.training.split import Parts, Task

FORMAT = 4
"""Version of the run folder; part of every digest."""

BASELINES = ("threshold",)
"""Methods that learn a cut and nothing else."""


def train(
    task: Task,
    *,
    name: str,
    classifier: Callable[[], Classifier],
    config: Mapping[str, Any],
    runs: Path,
    folds: int = 0,
    command: str | None = None,
) -> dict[str, Any]:
    """Fit, calibrate, export and judge one classifier, unless that has been done.

    Args:
        task: what to learn from which rows; its seed is the classifier's too.
        name: of the classifier, as its configuration file has it.
        classifier: makes it, unfitted; called only if the run is not finished yet.
        config: what `classifier` is made from, as plain containers; part of the run's identity.
        runs: folder of everything generated.
        folds: also cross-validate on all that is not for testing (the paper has 5); 0 for not.
        command: what makes the run again, for its metrics; None says nothing about it.

    Returns:
        The content of the run's `metrics.json`.

    Raises:
        BadValue: an argument out of range, a column that the set lacks, a part without both labels,
            a full disk.
    """
    check_name("name", name)
    check(folds in (0, *range(2, 21)), "folds", folds, allowed="0, or from 2 to 20")
    identity = {
        "format": FORMAT,
        "name": name,
        "classifier": dict(config),
        "task": task.identity(),
        "folds": folds,
    }
    folder = Path(runs) / "train" / f"{name}-{task.dataset.name}-s{task.seed}-{digest(identity)}"
    done = finished(folder, identity)
    if done is not None:
        return done
    from echolearn.training.tensorboard import writable

    with writable(folder):
        return run(task, classifier, identity, folder, about=manifests.command_entry(command))


def finished(folder: Path, identity: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return a run's metrics if it is finished and whole, else None.

    Raises:
        BadValue: the folder holds a run of another configuration.
    """
    try:
        result = manifests.verify(folder)
        config = files.load_json(folder / "config.json")
    except BadValue:
        return None
    same = canonical(config) == canonical(identity)
    check(
        same,
        str(folder),
        "another run",
        allowed="the run its name stands for",
        hint="was it renamed? remove it",
    )
    return result


def run(
    task: Task,
    classifier: Callable[[], Classifier],
    identity: Mapping[str, Any],
    folder: Path,
    *,
    about: Mapping[str, Any],
) -> dict[str, Any]:
    """Do all the work of one run, unless another command just does; return its metrics, with what
    is said `about` it.

    Nothing is written before the classifier is made and the set has what it looks at.
    """
    model = classifier()
    x, y, parts = task.inputs(model.inputs), task.labels(), task.parts()
    with locked(folder, waiting=f"{folder.name}: waiting for another command that trains this run"):
        done = finished(folder, identity)
        if done is not None:
            return done
        began = time.monotonic()
        shutil.rmtree(folder, ignore_errors=True)
        files.save_json(folder / "config.json", identity)
        fitted = fit(model, task, x, y, parts=parts, folder=folder)
        fitting = time.monotonic() - began
        answers = {
            part: fitted.confidence(x.part(rows))
            for part, rows in parts._asdict().items()
            if part != "train"
        }
        result = {
            "run": folder.name,
            "format": FORMAT,
            "name": identity["name"],
            "method": kind_of(model),
            "role": "baseline" if kind_of(model) in BASELINES else "learned",
            **task.identity(),
            **about,
            "inputs": list(model.inputs),
            "rows": {part: len(rows) for part, rows in parts._asdict().items()},
            "threshold": fitted.threshold,
            "calibration": {"slope": fitted.slope, "intercept": fitted.intercept},
            "grid_search": getattr(model, "cross_validation", None),
            "cross_validation": cross_validate(
                classifier, task, x, y, folds=identity["folds"], folder=folder
            ),
            "model": export(fitted, x.part(parts.test), folder),
            "validation": judge(y[parts.validation], answers["validation"], fitted.threshold),
            "test": judge(y[parts.test], answers["test"], fitted.threshold),
        }
        log(folder, identity, result, reference=y[parts.test], confidence=answers["test"])
        seconds = {"fit": round(fitting, 3), "total": round(time.monotonic() - began, 3)}
        files.save_json(folder / "timing.json", seconds)
        say(result, seconds["total"])
        return manifests.finish(
            folder, result, ["config.json", "model.onnx"], last=manifests.METRICS
        )


def fit(
    model: Classifier, task: Task, x: Rows, y: Array, *, parts: Parts, folder: Path
) -> Calibrated:
    """Fit `model` on the training rows of `parts`, calibrate it on the validation rows."""
    train, held = parts.train, parts.validation
    validation, groups = (x.part(held), y[held]), task.groups()[train]
    model.fit(
        x.part(train), y[train], groups=groups, validation=validation, folder=folder, seed=task.seed
    )
    return calibrate(model, *validation)


def judge(reference: Array, confidence: Array, threshold: float) -> dict[str, float | None]:
    """Return every metric of labels; those without a value are None."""
    values = metrics.evaluate_labels(reference, confidence, threshold=threshold)
    return {name: float(value) if math.isfinite(value) else None for name, value in values.items()}


def cross_validate(
    classifier: Callable[[], Classifier], task: Task, x: Rows, y: Array, *, folds: int, folder: Path
) -> dict[str, Any] | None:
    """Return mean and standard deviation of each metric over the folds of `task`; None for no
    folds.
    """
    if not folds:
        return None
    scores = []
    for parts in task.folds(folds):
        with TemporaryDirectory(dir=folder) as place:
            fitted = fit(classifier(), task, x, y, parts=parts, folder=Path(place))
        scores.append(judge(y[parts.test], fitted.confidence(x.part(parts.test)), fitted.threshold))
    table = {name: np.array([score[name] for score in scores], dtype=float) for name in scores[0]}
    return {
        name: {"mean": float(v.mean()), "sd": float(v.std(ddof=1))} for name, v in table.items()
    }


def export(fitted: Calibrated, x: Rows, folder: Path) -> dict[str, Any]:
    """Write `model.onnx`, proved on inputs `x` (B, ...), and return its SHA-256, parity and trials."""
    from echolearn.classifiers import onnx_export

    data, parity, trials = onnx_export.export_proved(fitted, x)
    files.write_atomic(folder / "model.onnx", data)
    return {"sha256": files.sha256(folder / "model.onnx"), "parity": parity, "trials": trials}


def log(
    folder: Path,
    identity: Mapping[str, Any],
    result: Mapping[str, Any],
    *,
    reference: Array,
    confidence: Array,
) -> None:
    """Write the run's TensorBoard events."""
    from echolearn.training.tensorboard import write_board

    figures = {f"val/{key}": value for key, value in result["validation"].items()}
    figures |= {f"test/{key}": value for key, value in result["test"].items()}
    scalars = {tag: value for tag, value in figures.items() if value is not None}
    parameters = {
        "classifier": identity["name"],
        "argument": identity["classifier"],
        **identity["task"],
    }
    write_board(
        folder, parameters=parameters, scalars=scalars, reference=reference, confidence=confidence
    )


def say(result: Mapping[str, Any], seconds: float) -> None:
    """Report a finished run in one line."""
    test = result["test"]
    figures = f"test AUC {test['auc']:.3f}, balanced accuracy {test['balanced_accuracy']:.3f}"
    print(f"{result['run']}: {seconds:.1f} s, {figures}", file=sys.stderr, flush=True)


def load_scorer(folder: Path) -> Callable[[Array], Array]:
    """Return the confidence function of a finished run, evaluated by onnxruntime on one thread.

    Args:
        folder: of the run.

    Returns:
        Maps raw inputs, (B, K) columns or (B, bands, M * M), to confidences (B,).

    Raises:
        BadValue: the run is not finished, or a file of it is missing or damaged.
    """
    from echolearn.classifiers.onnx_export import open_onnx

    result = manifests.verify(folder)
    score = open_onnx((Path(folder) / "model.onnx").read_bytes())
    return lambda x: score(as_input(x, result["inputs"]))
