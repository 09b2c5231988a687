"""One learning problem and one classifier make one run: a folder with a calibrated, proved model.

    problem, classifier --fit, calibrate--> confidence, threshold --export--> model.onnx
                                                                  --evaluate--> metrics.json

`fit` sees the training part, and the validation part for early stopping only. The validation part
also fixes the calibration and the threshold, by the same rule for every classifier
(`classifiers.calibration`, `classifiers.operating_point`). The test part is looked at once.

A run's folder is named after its configuration and its data. It holds `config.json`, `model.onnx`
(raw inputs to confidence, the only form in which a model is ever loaded again), `timing.json`,
logs, and `metrics.json`, written last: without it the run is unfinished and the same command redoes
it, with equal metrics.

torch and scikit-learn are imported only when there is something to fit: finding forty finished runs
takes milliseconds.
"""

import shutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from glob import escape
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check, check_choice, check_name
from echolearn.classifiers.calibration import (
    METHODS,
    PLATT,
    Calibrated,
)
from echolearn.classifiers.classifier import Classifier
from echolearn.classifiers.inputs import Rows
from echolearn.classifiers.operating_point import BALANCED, read_aim
from echolearn.storage import files, manifests
from echolearn.storage.identity import canonical, digest
from echolearn.storage.once import once
from echolearn.training.fitting import (
    Metrics,
    cross_validate,
    evaluate_rows,
    facts_of,
    fit_calibrated,
)
from echolearn.training.runs import FORMAT
from echolearn.training.split import LearningProblem, Parts

CONFIG = "config.json"
MODEL = "model.onnx"


def train(
    problem: LearningProblem,
    *,
    name: str,
    classifier: Callable[[], Classifier],
    config: Mapping[str, Any],
    runs: Path,
    folds: int = 0,
    calibration: str = PLATT,
    aim: str = BALANCED,
    microphones: Array | None = None,
    without: Sequence[str] = (),
    variant: str = "",
    logger: Callable[[], Any] | None = None,
    command: str | None = None,
) -> Metrics:
    """Fit, calibrate, export and evaluate one classifier, once; return what `metrics.json` holds.

    Args:
        problem: what to learn from which rows; its seed is the classifier's too.
        name: name of the classifier, as its configuration file has it.
        classifier: makes it, unfitted; called only if the run is not finished yet.
        config: what `classifier` is made from, as plain containers; part of the run's identity.
        runs: folder of everything generated.
        folds: of a cross-validation on all that is not for testing (the paper has 5), or 0.
        calibration, aim: way to confidences, and what their cut shall do (`operating_point`).
        microphones: shape (M, 3), in m: metrics tell by them recordings of the same array.
        without, variant: columns that an ablation leaves out, what a sweep varies, for the metrics.
        logger: makes a logger of Lightning, which is told the run besides TensorBoard.
        command: what makes the run again, for its metrics.

    Raises:
        BadValue: an argument out of range, a column that the set lacks, a part of one label alone.
    """
    _check(name, folds, calibration=calibration)
    about = {"format": FORMAT, "name": name, "classifier": dict(config), "folds": folds}
    identity = about | {"problem": problem.identity()} | _unusual(calibration, aim)
    usual = Path(runs) / "train" / f"{title_of(identity)}-{digest(identity)}"
    place = partial(_place, usual, title=title_of(identity), variant=variant)
    finished = partial(_found_at, place, identity)
    if (found := finished()) is not None:
        return found
    # What is wrong with the classifier or the set is told before anything is written.
    problem.inputs(classifier().inputs)
    problem.parts()
    told = _told(command, microphones, without=without)
    more: Any = {"identity": identity, "told": told, "logger": logger}
    make = partial(_make_named, place, problem, classifier=classifier, **more)
    # Locked under the name without what is varied, so that two sweeps do not make one run twice.
    return once(usual, finished=finished, make=make, doing="trains this run")


def _found_at(place: Callable[[], Path], identity: Mapping[str, Any]) -> Metrics | None:
    """Return the metrics of a run wherever it is by now, if it is finished."""
    return finished_metrics(place(), identity)


def _make_named(
    place: Callable[[], Path],
    problem: LearningProblem,
    *,
    classifier: Callable[[], Classifier],
    identity: Mapping[str, Any],
    told: Mapping[str, Any],
    logger: Callable[[], Any] | None,
) -> Metrics:
    """Make a run in its folder, which another command may have named meanwhile.

    Args:
        place: tells the folder.
        problem, classifier, identity, told, logger: as those of `make_run`.
    """
    from echolearn.training.tensorboard import writable

    folder = place()
    parts = folder.name.removeprefix(f"{title_of(identity)}-").rpartition("-")
    about = {**told, "variant": parts[0]} if parts[0] else told
    with writable(folder):
        more: Any = {"identity": identity, "told": about, "logger": logger}
        return make_run(problem, classifier, folder=folder, **more)


def title_of(identity: Mapping[str, Any]) -> str:
    """Return the beginning of a run's name: classifier, plan and seed."""
    problem = identity["problem"]
    return f"{identity['name']}-{problem['plan']}-s{problem['seed']}"


def _place(usual: Path, *, title: str, variant: str) -> Path:
    """Return the folder of a run: where it is already, or one that tells what a sweep varies.

    Args:
        usual: folder without that.
        title: beginning of its name.
        variant: what is varied, or nothing.
    """
    known = usual.name.removeprefix(f"{title}-")
    # The same run by another command, or a part of what a killed one had made of it.
    there = sorted(usual.parent.glob(f"{escape(title)}-*{known}"))
    new = usual.with_name(f"{title}-{variant}-{known}") if variant else usual
    return there[0] if there else new


def _check(name: str, folds: int, *, calibration: str) -> None:
    check_name("name", name)
    check_choice("calibration", calibration, *METHODS)
    allowed = "must be 0 (no cross-validation) or from 2 to 20"
    check(folds in (0, *range(2, 21)), "folds", folds, allowed=allowed)


def _told(
    command: str | None, microphones: Array | None, *, without: Sequence[str]
) -> dict[str, Any]:
    """Return what metrics say besides: command, positions of the array, columns left out."""
    told: dict[str, Any] = {**manifests.command_entry(command)}
    if without:
        told["without"] = list(without)
    if microphones is not None:
        told["microphones"] = np.asarray(microphones).tolist()
    return told


def _unusual(calibration: str, aim: str) -> dict[str, str]:
    """Return what a run's identity says of calibration and cut.

    Runs of before, which had no choice, keep their names.
    """
    chosen = {"calibration": calibration, "aim": str(read_aim(aim))}
    usual = {"calibration": PLATT, "aim": BALANCED}
    return {key: value for key, value in chosen.items() if value != usual[key]}


def finished_metrics(folder: Path, identity: Mapping[str, Any]) -> Metrics | None:
    """Return a run's metrics if it is finished and whole, else None.

    Raises:
        BadValue: the folder holds a run of another configuration.
    """
    try:
        found = manifests.verify(folder)
        config = files.load_json(folder / CONFIG)
    except BadValue:
        return None
    same = canonical(config) == canonical(identity)
    allowed = "must be the run its name stands for"
    hint = "was it renamed? remove it"
    check(same, str(folder), "another run", allowed=allowed, hint=hint)
    return found


def make_run(
    problem: LearningProblem,
    classifier: Callable[[], Classifier],
    *,
    identity: Mapping[str, Any],
    folder: Path,
    told: Mapping[str, Any],
    logger: Callable[[], Any] | None = None,
) -> Metrics:
    """Do all the work of one run and return its metrics.

    Args:
        problem, classifier: as those of `train`.
        identity: what the run is made from, for `config.json`.
        folder: folder of the run; what an interrupted command has left there goes.
        told: what the metrics say besides, such as the command that makes the run again.
        logger: as that of `train`; folds are not told.
    """
    began = time.monotonic()
    # What a killed command has left would stand among the results of this one.
    shutil.rmtree(folder, ignore_errors=True)
    files.save_json(folder / CONFIG, identity)
    parts = problem.parts()
    cut = {key: identity[key] for key in ("calibration", "aim") if key in identity}
    place: Any = {"parts": parts, "folder": folder}
    loggers = [logger()] if logger else []
    fitted = fit_calibrated(classifier(), problem, loggers=loggers, **place, **cut)
    fitting = time.monotonic() - began

    tested = problem.inputs(fitted.classifier.inputs).part(parts.test)
    folds = identity["folds"]
    result = {
        "run": folder.name,
        "format": FORMAT,
        "name": identity["name"],
        **problem.identity(),
        **told,
        **facts_of(fitted),
        "rows": {part: len(rows) for part, rows in parts._asdict().items()},
        "cross_validation": cross_validate(problem, classifier, folds=folds, folder=folder, **cut),
        "model": write_model(fitted, tested, folder=folder),
        "validation": evaluate_rows(fitted, problem, rows=parts.validation),
        "test": evaluate_rows(fitted, problem, rows=parts.test),
    }
    # TensorBoard and the times come before the metrics, whose presence says that all is there.
    _show(fitted, problem, result=result, identity=identity, loggers=loggers, **place)
    spent = {"fit": round(fitting, 3), "total": round(time.monotonic() - began, 3)}
    files.save_json(folder / "timing.json", spent)
    _report(result, spent["total"])
    return manifests.finish(folder, result, files=[CONFIG, MODEL], last=manifests.METRICS)


def _show(
    fitted: Calibrated,
    problem: LearningProblem,
    *,
    parts: Parts,
    folder: Path,
    result: Metrics,
    identity: Mapping[str, Any],
    loggers: Sequence[Any],
) -> None:
    """Write what TensorBoard shows of a run, and tell loggers what it is worth.

    Args:
        fitted: classifier with its calibration.
        problem: what it has learned.
        parts: rows of the problem's set.
        folder: of the run.
        result: its metrics.
        identity: what it is made from.
        loggers: those of Lightning that were asked for.
    """
    from echolearn.training import dashboard_figures
    from echolearn.training.tensorboard import log_run, write_events

    x = problem.inputs(fitted.classifier.inputs)
    reference = problem.labels()[parts.test]
    confidence = fitted.confidence(x.part(parts.test))
    validated = fitted.confidence(x.part(parts.validation))
    last = getattr(fitted.classifier, "epochs_seen", 0)
    placed: Any = {"confidence": validated, "cut": fitted.threshold}
    write_events(
        folder,
        identity=identity,
        result=result,
        reference=reference,
        confidence=confidence,
        curves=getattr(fitted.classifier, "curves", {}),
        last=last,
        figures={
            "test/reliability": dashboard_figures.reliability_diagram(reference, confidence),
            "test/precision_recall": dashboard_figures.precision_recall(reference, confidence),
            "val/map": dashboard_figures.filtered_map(problem.dataset, parts.validation, **placed),
        },
    )
    for logger in loggers:
        log_run(logger, identity, result=result, last=last)


def write_model(fitted: Calibrated, x: Rows, *, folder: Path) -> Metrics:
    """Write `model.onnx`, and return its SHA-256 with the proof of it.

    Args:
        fitted: classifier with its calibration.
        x: inputs that the file is proved on, shape (B, ...).
        folder: folder of the run.
    """
    from echolearn.classifiers.onnx_export import export_proved

    proved = export_proved(fitted, x)
    files.write_atomic(folder / MODEL, proved.data)
    sha256 = files.sha256(folder / MODEL)
    return {"sha256": sha256, "parity": proved.parity, "trials": proved.trials}


def _report(result: Mapping[str, Any], seconds: float) -> None:
    """Say in one line that a run is finished."""
    test = result["test"]
    figures = f"test AUC {test['auc']:.3f}, balanced accuracy {test['balanced_accuracy']:.3f}"
    spent = f"{seconds:.1f} s on {result['accelerator']}"
    count = result["rows"]["test"]
    told = "; ".join([f"{spent}, {figures} of {count} rows", *result.get("edges", ())])
    print(f"{result['run']}: {told}", file=sys.stderr, flush=True)
    missed = result["operating_point"]["missed"]
    if missed:
        print(f"{result['run']}: {missed}; cut for balanced", file=sys.stderr, flush=True)
