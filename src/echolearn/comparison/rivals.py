"""Who is tested against whom: the bare threshold, the best of a training, the whole model.

    predictions --against_baseline--> swapped answers against `threshold_peak`
                --further_tests--> against the best learned model of the training, against the model
                                   on all rows and columns; each pair by McNemar's test, too
    runs with folds --fold_tests--> Nadeau and Bengio against the threshold

What is read as one table is one family for Holm's correction: the test, the metric, the training,
and whom all are tested against.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from echolearn.evaluation import pairs
from echolearn.evaluation.paired_tests import corrected_t
from echolearn.evaluation.rows import LabelledRows, Model, Predictions, Recordings, Row
from echolearn.training.runs import Run

BASELINE = "threshold_peak"
"""The bare threshold that every other model is tested against."""

Given = Mapping[Model, Sequence[Predictions]]
"""What each model says about a test set, one for each seed."""


class Pair(NamedTuple):
    """A model and whom it is tested against.

    Attributes:
        model: the one.
        rival: the other.
        kind: "baseline", "best" or "full".
    """

    model: Model
    rival: Model
    kind: str


def baselines(models: Mapping[Model, object]) -> dict[str, Model]:
    """Return the bare threshold of each training: its scale is learned as well."""
    return {model.training: model for model in models if model.classifier == BASELINE}


def opponents(given: Given, best: Mapping[str, Model]) -> Iterator[Pair]:
    """Yield every pair that is tested; models of a leaky split are in none.

    Args:
        given: what each model says.
        best: best learned model of each training that is looked at so closely.
    """
    bare = baselines(given)
    for model in given:
        rivals = {
            "baseline": bare.get(model.training),
            "best": best.get(model.training),
            "full": model.full,
        }
        for kind, rival in rivals.items():
            if rival is None or rival not in given or rival == model or model.split == "row":
                continue
            if pairs.pair_seeds(given[model], given[rival]):
                yield Pair(model, rival, kind)


def against_baseline(
    given: Given, labelled: LabelledRows, *, metric: str, snr_db: str = ""
) -> Iterator[Row]:
    """Test every model against the bare threshold of the same training and seeds.

    Models of a leaky split are left out, and those that have no seed in common with the threshold.

    Args:
        given: what each model says about the test set.
        labelled: the test set.
        metric: "auc" or "balanced_accuracy".
        snr_db: entry of that column.
    """
    for pair in opponents(given, {}):
        if pair.kind == "baseline" and pair.model.classifier != BASELINE:
            both = given[pair.model], given[pair.rival]
            found = pairs.paired_difference(*both, labelled=labelled, metric=metric)
            yield about(pair, labelled.source) | {"snr_db": snr_db} | found


def further_tests(
    given: Given,
    labelled: LabelledRows,
    *,
    metric: str,
    best: Mapping[str, Model],
    snr_db: str = "",
) -> Iterator[Row]:
    """Yield the tests besides those of swapped answers against the threshold.

    Args:
        given: what each model says about the test set.
        labelled: the test set.
        metric: "auc" or "balanced_accuracy".
        best: best learned model of each training that is looked at so closely.
        snr_db: entry of that column.
    """
    for pair in opponents(given, best):
        both = given[pair.model], given[pair.rival]
        found = [pairs.rightness_difference(*both, labelled=labelled)]
        if pair.kind != "baseline":
            found.append(pairs.paired_difference(*both, labelled=labelled, metric=metric))
        for test in found:
            yield about(pair, labelled.source) | {"snr_db": snr_db} | _in_family(pair, test)


def fold_tests(models: Mapping[Model, Sequence[Run]]) -> Iterator[Row]:
    """Yield Nadeau and Bengio's test of each model against the threshold, over common folds.

    Runs of one set, seed and split have the same folds.
    """
    bare = baselines(models)
    for model, runs in models.items():
        rival = bare.get(model.training, model)
        both = {run.seed: run for run in models[rival]}
        crossed = [(run, both[run.seed]) for run in runs if run.seed in both]
        for metric in pairs.PAIRED:
            values = [_fold_values(run, other, metric=metric) for run, other in crossed]
            differences = np.concatenate([np.empty(0), *values])
            if rival == model or model.split == "row" or len(differences) < 2:
                continue
            ratios = [
                run.metrics["cross_validation"]["test_to_training"]
                for (run, _), found in zip(crossed, values, strict=True)
                if len(found)
            ]
            found, p = corrected_t(differences, test_to_training=float(np.mean(ratios)))
            ends = {"ci_low": found.low, "ci_high": found.high}
            cells = {"test": "nadeau_bengio", "metric": metric, "difference": found.value}
            cells |= {**ends, "p": p, "n": len(differences), "snr_db": ""}
            pair = Pair(model, rival, "baseline")
            source = Recordings(model.trained_on, kind="folds")
            yield about(pair, source) | _in_family(pair, cells)


def _fold_values(run: Run, other: Run, *, metric: str) -> np.ndarray:
    """Return a metric's differences over the folds of two runs, (J,); none without such folds."""
    both = [each.metrics.get("cross_validation") or {} for each in (run, other)]
    one, second = (each.get(metric, {}).get("values", []) for each in both)
    if len(one) != len(second) or None in (*one, *second):
        return np.empty(0)
    return np.subtract(one, second)


def about(pair: Pair, source: Recordings) -> Row:
    """Return the cells that tell what a test is about."""
    return pair.model.columns() | source._asdict() | {"against": pair.rival.classifier}


def _in_family(pair: Pair, test: Row) -> Row:
    """Return a test with what tells its family from others."""
    training = pair.rival.training
    return test | {
        "family": (test["test"], test["metric"], pair.kind, training),
        "rival": pair.kind,
    }
