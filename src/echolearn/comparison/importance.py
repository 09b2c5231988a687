"""Permutation importance: what a column is worth to a classifier, the rows of `importance.csv`.

A column's values are exchanged among test rows, so that they tell nothing any more and keep their
distribution; what the AUC loses is the column's importance (Breiman, Machine Learning 45, 2001).
Rows of one position keep their values together: whole positions are exchanged, or other rows of a
position would tell what a row has lost. A column that another one can stand in for loses little.
"""

from collections.abc import Iterator

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.classifiers.inputs import FEATURES, stack_inputs, view_of
from echolearn.comparison.choice import Comparison, away, drawn, is_evaluated
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation import metrics, stats
from echolearn.evaluation.rows import Row
from echolearn.training.predictions import label_rows, load_scorer, predict_rows
from echolearn.training.runs import Run

COLUMNS = "classifier trained_on tested_on seed column metric value ci_low ci_high n".split()
"""Columns of `importance.csv`."""

REPEATS = 5
"""Exchanges of each column: their mean counts."""

MOST_RESAMPLES = 200
"""Bootstrap draws behind an interval, at most: each asks for the AUC of every exchange."""

MOST_ROWS = 1500
"""Rows that are looked at, at most: an SVM takes a minute for more."""


def importance_rows(comparison: Comparison, *, resamples: int) -> Iterator[Row]:
    """Yield the importance of each column for those of the drawn models that look at several.

    The set is the one whose curves are drawn; a model's first seed stands for it.
    """
    shown = away(comparison)
    dataset = comparison.sets[shown]
    for model in drawn(comparison):
        run = comparison.models[model][0]
        several = view_of(run.inputs) == FEATURES and len(run.inputs) > 1
        if several and is_evaluated(comparison, model, name=shown):
            about: Row = {"classifier": model.classifier, "trained_on": model.trained_on}
            about |= {"tested_on": dataset.name, "seed": run.seed, "metric": "auc"}
            for row in of_run(run, dataset, resamples=min(resamples, MOST_RESAMPLES)):
                yield about | row


def of_run(run: Run, dataset: Dataset, *, resamples: int) -> Iterator[Row]:
    """Yield column, loss of AUC, its interval over positions, and the number of rows.

    Args:
        run: finished run that looks at columns.
        dataset: set with labels; of that which it was trained on, the rows that it held out.
        resamples: bootstrap draws over positions.
    """
    labelled = label_rows(dataset, resamples=1)
    rows = predict_rows(run, dataset).rows[:MOST_ROWS]
    groups = labelled.groups[rows]
    reference = labelled.reference[rows]
    weights = stats.cluster_weights(groups, resamples=resamples)
    score = load_scorer(run.folder)
    x = stack_inputs(run.inputs, dataset)[rows]
    whole = score(x)
    for place, name in enumerate(run.inputs):
        rng = np.random.default_rng(place)
        without = []
        for _ in range(REPEATS):
            mixed = x.copy()
            mixed[:, place] = x[permuted(groups, rng), place]
            without.append(score(mixed))

        def loss(each: Array | None, without: list[Array] = without) -> Array:
            """Return what the AUC loses, for weights or None."""
            left = [metrics.auc(reference, given, weights=each) for given in without]
            return metrics.auc(reference, whole, weights=each) - np.mean(left, axis=0)

        found = stats.interval(loss, weights)
        figure = {"value": found.value, "ci_low": found.low, "ci_high": found.high}
        yield {"column": name, "n": len(rows)} | figure


def permuted(groups: Array, rng: np.random.Generator) -> Array:
    """Return for each row the row whose value it is given, shape (B,): whole groups are exchanged.

    A group that is given to a larger one is repeated, to a smaller one cut.
    """
    member, count = stats.numbered(groups)
    order = np.argsort(member, kind="stable")
    sizes = np.bincount(member, minlength=count)
    starts = np.cumsum(sizes) - sizes
    within = np.empty(len(member), dtype=int)
    within[order] = np.arange(len(member)) - starts[member[order]]
    other = rng.permutation(count)[member]
    return np.asarray(order[starts[other] + within % sizes[other]])
