"""Evaluate models: on labelled sets row by row, on surveys by the map they leave.

Every figure is the mean over a model's seeds. Its interval is a bootstrap over positions (or poses)
that all models share.

The rows are those of `results.csv`: the columns of `rows.Model` and
`rows.Recordings`, then seed (empty: mean over seeds), snr_db (empty: all; "low:high": a band), n,
metric, value, ci_low, ci_high.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.evaluation import map_metrics, metrics, stats
from echolearn.evaluation.pairs import PAIRED
from echolearn.evaluation.reliability import evaluate_calibration
from echolearn.evaluation.rows import (
    SNR_BANDS_DB,
    LabelledRows,
    LocalizedSurvey,
    MeasuredRows,
    Model,
    Predictions,
    Row,
    in_band,
    pick,
)

SURE = 0.9
"""Precision that the metric `r90` asks for."""

POOLED = ("auc", "balanced_accuracy")
"""Metrics of whole sets whose draws a row keeps, as `draws`, (resamples,): they are pooled."""

Evaluate = Callable[[Predictions, Array | None], Mapping[str, Array]]
"""Metrics by name, of predictions and of weights (resamples, B) or None."""


def score_labels(
    model: Model, predictions: Sequence[Predictions], *, labelled: LabelledRows
) -> Iterator[Row]:
    """Yield the rows of a model on a labelled set, over all rows and by SNR band.

    Args:
        model: the model.
        predictions: what it says, one for each seed.
        labelled: the test set.
    """

    def every(given: Predictions, weights: Array | None) -> Mapping[str, Array]:
        """Return all metrics of one seed's predictions."""
        return metrics.evaluate_labels(
            labelled.reference[given.rows],
            given.confidence,
            threshold=given.threshold,
            weights=weights,
        )

    def banded(given: Predictions, weights: Array | None) -> Mapping[str, Array]:
        """Return the two metrics that are given for each SNR band."""
        reference = labelled.reference[given.rows]
        found = {}
        for name, paired in PAIRED.items():
            answers = getattr(given, paired.answers)
            found[name] = paired.value(reference, answers, weights=weights)
        return found

    about: dict[str, Any] = {"model": model, "predictions": predictions, "labelled": labelled}
    yield from tabulate(every, **about)
    yield from tabulate_bands(banded, SNR_BANDS_DB, **about)


def score_measured(
    model: Model, predictions: Sequence[Predictions], *, measured: MeasuredRows
) -> Iterator[Row]:
    """Yield the rows of a model on recorded surveys: over all of them, and at each SNR.

    Metrics by time alone begin with `time_`.

    Args:
        model: the model.
        predictions: what it says about every echo, one for each seed.
        measured: the echoes.
    """
    labelled = measured.labelled

    def every(given: Predictions, weights: Array | None) -> Mapping[str, Array]:
        """Return all metrics of one seed's predictions."""
        found: dict[str, Array] = {}
        if measured.label != "reflector":
            found |= evaluate_echoes(labelled.reference, given, weights=weights)
        if measured.by_time is not None:
            timed = evaluate_echoes(measured.by_time, given, weights=weights)
            found |= {f"time_{name}": value for name, value in timed.items()}
        return found

    about: dict[str, Any] = {"model": model, "labelled": labelled}
    yield from tabulate(every, predictions=predictions, **about)
    levels = np.unique(labelled.joint_snr_db[np.isfinite(labelled.joint_snr_db)])
    for level in levels if len(levels) > 1 else ():
        cut = [given.within(labelled.joint_snr_db == level) for given in predictions]
        rows = tabulate(every, predictions=cut, snr_db=f"{level:g}", **about)
        yield from pick(rows, seed="")


def evaluate_echoes(
    reference: Array, given: Predictions, *, weights: Array | None
) -> dict[str, Array]:
    """Return the metrics of measured echoes, by name.

    Args:
        reference: truth of all rows, shape (B,), bool.
        given: what one seed says about some of them.
        weights: of these, shape (..., b), or None.
    """
    true = reference[given.rows]
    found = metrics.evaluate_labels(
        true, given.confidence, threshold=given.threshold, weights=weights
    )
    sure = metrics.recall_at(true, given.confidence, precision=SURE, weights=weights)
    return {
        "auc": found["auc"],
        "r90": sure,
        "precision": found["precision"],
        "true_retention": found["recall"],
        "spurious_removal": found["specificity"],
        "balanced_accuracy": found["balanced_accuracy"],
        "average_precision": found["average_precision"],
        "expected_calibration_error": found["expected_calibration_error"],
        **evaluate_calibration(true, given.confidence, weights=weights),
    }


def score_map(
    model: Model, predictions: Sequence[Predictions], *, survey: LocalizedSurvey
) -> Iterator[Row]:
    """Yield the rows of a model on a survey, by the map that it leaves.

    Args:
        model: the model.
        predictions: what it says about every echo, one for each seed.
        survey: the survey.
    """

    def every(given: Predictions, weights: Array | None) -> Mapping[str, Array]:
        """Return all metrics of one seed's map."""
        return map_metrics.evaluate_map(
            survey.walls,
            survey.points,
            kept=given.kept,
            confidence=given.confidence,
            poses=survey.poses,
            weights=weights,
        )

    true = int(survey.labelled.reference.sum())
    trials = {"true_retention": true, "spurious_removal": len(survey.points) - true}
    labelled, snr_db = survey.labelled, survey.snr_db
    rows = tabulate(every, model=model, predictions=predictions, labelled=labelled, snr_db=snr_db)
    for row in rows:
        yield _bounded(row, trials.get(row["metric"], 0))


def _bounded(row: Row, trials: int) -> Row:
    """Return a row of a share with Wilson's interval where a bootstrap has no width.

    That is where all of the `trials` points are kept, or none.
    """
    # Where all resamples agree, a bootstrap would claim to be certain.
    if row["seed"] != "" or row["value"] not in (0.0, 1.0) or trials == 0:
        return row
    found = stats.wilson(round(row["value"] * trials), trials)
    return row | {"ci_low": found.low, "ci_high": found.high}


def tabulate(
    evaluate: Evaluate,
    *,
    model: Model,
    predictions: Sequence[Predictions],
    labelled: LabelledRows,
    snr_db: str = "",
) -> Iterator[Row]:
    """Yield a row for each metric and seed, and one for the mean over seeds with its interval.

    Args:
        evaluate: the metrics.
        model: the model.
        predictions: what it says, one for each seed; a lone seed is the mean.
        labelled: the test set.
        snr_db: entry of that column.
    """
    common = model.columns() | labelled.source._asdict()
    common |= {"snr_db": snr_db, "n": round(np.mean([len(given.rows) for given in predictions]))}
    each = [evaluate(given, None) for given in predictions]
    if len(predictions) > 1:
        for given, values in zip(predictions, each, strict=True):
            for metric, value in values.items():
                cells = {"value": float(value), "ci_low": "", "ci_high": ""}
                yield common | {"seed": given.seed, "metric": metric} | cells

    def over_seeds(weights: Array | None) -> dict[str, Array]:
        """Return each metric's mean over seeds, for weights (resamples, B) or None."""
        if weights is None:
            return mean_of(each)
        return mean_of([evaluate(given, weights[:, given.rows]) for given in predictions])

    # Every draw is the mean over seeds for the same drawn positions, so seeds are not resampled.
    for metric, (figure, draws) in stats.resampled(over_seeds, labelled.weights).items():
        _, low, high = stats.percentiles(figure, draws)
        row = common | {"seed": "", "metric": metric, "value": figure}
        kept = {"draws": draws} if metric in POOLED and not snr_db else {}
        yield row | {"ci_low": low, "ci_high": high} | kept


def tabulate_bands(
    evaluate: Evaluate,
    bands: Sequence[tuple[int, int]],
    *,
    model: Model,
    predictions: Sequence[Predictions],
    labelled: LabelledRows,
) -> Iterator[Row]:
    """Yield a row for each metric and band of SNR, of the mean over seeds.

    Args:
        evaluate: the metrics.
        bands: lowest and highest SNR of each, in dB.
        model, predictions, labelled: as those of `tabulate`.
    """
    for low, high in bands:
        inside = in_band(labelled.joint_snr_db, low=low, high=high)
        cut = [given.within(inside) for given in predictions]
        # A mean over seeds needs every seed: a band that one has no row in is left out.
        if all(len(given.rows) for given in cut):
            about: dict[str, Any] = {"predictions": cut, "snr_db": f"{low}:{high}"}
            rows = tabulate(evaluate, model=model, labelled=labelled, **about)
            yield from pick(rows, seed="")


def mean_of(evaluations: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Return the mean over seeds of each metric; NaN where any seed's is (nothing kept, say)."""
    names = evaluations[0]
    return {name: np.mean([values[name] for values in evaluations], axis=0) for name in names}


def trivial_predictions(reference: Array) -> dict[str, Predictions]:
    """Return what takes no training: keep everything, nothing, what is true, or toss a coin."""
    rows = np.arange(len(reference))
    confidence = {
        "keep_everything": np.ones(len(rows)),
        "keep_nothing": np.zeros(len(rows)),
        "oracle": reference.astype(float),
        "chance": np.random.default_rng(0).uniform(size=len(rows)),
    }
    return {name: Predictions(0, rows, values, 0.5) for name, values in confidence.items()}
