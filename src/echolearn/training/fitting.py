"""Fit a classifier, calibrate it, and say what it is worth: on one split, or fold by fold.

    model, problem, parts --fit_calibrated--> confidence, threshold --evaluate_rows--> metrics
    problem, folds        --cross_validate--> mean, deviation and values of every metric

A fold is fitted, calibrated and cut as the run itself is.
"""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.classifiers.calibration import PLATT, Calibrated, calibrate, plain_calibration
from echolearn.classifiers.classifier import Classifier, Examples
from echolearn.classifiers.operating_point import BALANCED, point_of, read_aim
from echolearn.evaluation import metrics
from echolearn.evaluation.reliability import evaluate_calibration
from echolearn.storage.identity import kind_of
from echolearn.training.split import LearningProblem, Parts

BASELINES = ("threshold",)
"""Methods that learn a cut and nothing else."""

Metrics = dict[str, Any]


def fit_calibrated(
    model: Classifier,
    problem: LearningProblem,
    *,
    parts: Parts,
    folder: Path,
    calibration: str = PLATT,
    aim: str = BALANCED,
    loggers: Sequence[Any] = (),
) -> Calibrated:
    """Fit a classifier to the training rows of `parts`, calibrate it on the validation rows.

    Args:
        model: classifier, unfitted.
        problem: what to learn.
        parts: rows of the problem's set.
        folder: place of the classifier's own logs.
        calibration, aim: as those of `train`.
        loggers: as those of `Examples`.
    """
    about: Any = {"parts": parts, "folder": folder, "loggers": loggers}
    examples = examples_of(model, problem, **about)
    model.fit(examples)
    return calibrate(model, *examples.validation, method=calibration, aim=read_aim(aim))


def examples_of(
    model: Classifier, problem: LearningProblem, *, parts: Parts, folder: Path, **about: Any
) -> Examples:
    """Return what a classifier learns from.

    Args:
        model: classifier, unfitted.
        problem: what to learn.
        parts: rows of the problem's set.
        folder: place of the classifier's own logs.
        about: further fields, as `watch`.
    """
    x = problem.inputs(model.inputs)
    y = problem.labels()
    return Examples(
        x.part(parts.train),
        y[parts.train],
        groups=problem.groups()[parts.train],
        validation=(x.part(parts.validation), y[parts.validation]),
        folder=folder,
        seed=problem.seed,
        **about,
    )


def facts_of(fitted: Calibrated) -> Metrics:
    """Return what a fitted classifier says about itself, for the run's metrics."""
    model = fitted.classifier
    method = kind_of(model)
    return {
        "method": method,
        "role": "baseline" if method in BASELINES else "learned",
        "inputs": list(model.inputs),
        "threshold": fitted.threshold,
        "operating_point": point_of(fitted.point) | {"missed": fitted.missed or None},
        "calibration": plain_calibration(fitted),
        "grid_search": getattr(model, "cross_validation", None),
        "accelerator": getattr(model, "device", "cpu"),
    } | _where_there(edges=list(edges_of(model)), adapted_from=_origin(model))


def _where_there(**facts: Any) -> Metrics:
    return {key: value for key, value in facts.items() if value}


def _origin(model: Classifier) -> Metrics:
    """Return what a classifier tells of the filter that it began from; nothing if there is none."""
    earlier = getattr(model, "earlier", None)
    return dict(earlier.told) if earlier else {}


def edges_of(model: Classifier) -> Iterator[str]:
    """Yield a line for each grid of a fitted classifier at whose edge the best value lies."""
    found = getattr(model, "cross_validation", None) or {}
    for key in ("c", "gamma"):
        grid = getattr(model, f"{key}_grid", ())
        if len(grid) > 1 and found.get(key) in (min(grid), max(grid)):
            yield f"{key}={found[key]:g}, the best, lies on the edge of its grid; widen {key}_grid"


def evaluate_rows(
    fitted: Calibrated, problem: LearningProblem, *, rows: Array
) -> dict[str, float | None]:
    """Return every metric of labels on some rows; those without a value are None.

    Args:
        fitted: classifier with its calibration.
        problem: what it has learned.
        rows: numbers of rows of the problem's set, shape (B,).
    """
    confidence = fitted.confidence(problem.inputs(fitted.classifier.inputs).part(rows))
    reference = problem.labels()[rows]
    values = metrics.evaluate_labels(reference, confidence, threshold=fitted.threshold)
    values |= evaluate_calibration(reference, confidence)
    return {name: metrics.finite(value) for name, value in values.items()}


def cross_validate(
    problem: LearningProblem,
    classifier: Callable[[], Classifier],
    *,
    folds: int,
    folder: Path,
    **cut: str,
) -> Metrics | None:
    """Return each metric's mean, standard deviation and values over folds; None without folds.

    Args:
        problem: what to learn; its test rows are not looked at.
        classifier: makes an unfitted one for each fold.
        folds: number of folds.
        folder: folder of the run, in which each fold has a temporary one.
        cut: `calibration` and `aim`, as those of `train`.
    """
    if not folds:
        return None
    scores = []
    shares = []
    for parts in problem.folds(folds):
        # A network's logs of a fold would pass for those of the run.
        with TemporaryDirectory(dir=folder) as place:
            about: Any = {"parts": parts, "folder": Path(place)} | cut
            fitted = fit_calibrated(classifier(), problem, **about)
        scores.append(evaluate_rows(fitted, problem, rows=parts.test))
        shares.append(len(parts.test) / len(parts.train))
    # What a corrected test needs, beside the folds themselves (`evaluation.paired_tests`).
    result: Metrics = {"test_to_training": float(np.mean(shares))}
    for name in scores[0]:
        values = np.array([score[name] for score in scores], dtype=float)
        result[name] = {
            "mean": float(values.mean()),
            "sd": float(values.std(ddof=1)),
            "values": [score[name] for score in scores],
        }
    return result
