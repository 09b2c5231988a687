"""Test whether two models differ, on the same rows, seed by seed: the rows of `tests.csv`.

A metric can be tested if its difference is linear in the swaps of `stats.swapped`: then each
row has a share of it, whose sign turns when the two answers about that row are swapped.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.evaluation import metrics, stats
from echolearn.evaluation.paired_tests import mcnemar
from echolearn.evaluation.rows import LabelledRows, Predictions, Row

SWAPS = 5000
"""Permutations behind a p value; 1 / 5001 times the tests of a family must lie well below 0.05."""


def auc_shares(reference: Array, *, first: Array, second: Array) -> Array:
    """Return what each row adds to auc(first) - auc(second): the sign turns if answers are swapped.

    Confidences are replaced by their ranks, so that models of different scales can be swapped. A
    pair of a reflector i and a spurious row j adds K(a_i, a_j) - K(b_i, b_j), K = 1, 1/2 or 0 as
    the reflector is above, level or below. Over the four ways to swap i and j that is linear in the
    signs s_i, s_j, with the weights 1/2 sum_j [K(a_i, .) - K(b_i, .)] and 1/2 sum_i [K(., a_j) -
    K(., b_j)], where . runs over both answers.

    Args:
        reference: shape (B,), bool.
        first, second: confidences of the two, shape (B,).

    Returns:
        Shape (B,).
    """
    from scipy.stats import rankdata

    first, second = rankdata(first), rankdata(second)
    # Either answer of the other row may be the one it is compared with, so both are counted.
    true_ranks = np.append(first[reference], second[reference])
    false_ranks = np.append(first[~reference], second[~reference])
    above_false = _above(first, false_ranks) - _above(second, false_ranks)
    above_true = _above(first, true_ranks) - _above(second, true_ranks)
    shares = np.where(reference, above_false, -above_true)
    return shares / (2.0 * max(reference.sum() * (~reference).sum(), 1))


def balanced_accuracy_shares(reference: Array, *, first: Array, second: Array) -> Array:
    """Return what each row adds to balanced_accuracy(first) - balanced_accuracy(second).

    Args:
        reference: shape (B,), bool.
        first, second: what each of the two keeps, shape (B,), bool.

    Returns:
        Shape (B,).
    """
    true_share = 0.5 / max(reference.sum(), 1)
    false_share = 0.5 / max((~reference).sum(), 1)
    return (first.astype(float) - second) * np.where(reference, true_share, -false_share)


def _above(values: Array, others: Array) -> Array:
    """Return how many of `others` each value is above, ties counting half."""
    rising = np.sort(others)
    return (np.searchsorted(rising, values, "left") + np.searchsorted(rising, values, "right")) / 2


class Paired(NamedTuple):
    """A metric in which two models can be compared.

    Attributes:
        value: the metric, of reference, answers and weights.
        shares: what each row adds to its difference.
        answers: what `Predictions` call the answers that it is about.
    """

    value: Callable[..., Array]
    shares: Callable[..., Array]
    answers: str


PAIRED = {
    "auc": Paired(metrics.auc, auc_shares, "confidence"),
    "balanced_accuracy": Paired(metrics.balanced_accuracy, balanced_accuracy_shares, "kept"),
}
"""Metrics in which two models are compared."""


def pair_seeds(
    first: Sequence[Predictions], second: Sequence[Predictions]
) -> list[tuple[Predictions, Predictions]]:
    """Return pairs of the same seed; a lone one of the second goes with each of the first."""
    alone = len(second) == 1
    return [(a, b) for a in first for b in second if alone or a.seed == b.seed]


def paired_difference(
    first: Sequence[Predictions],
    second: Sequence[Predictions],
    *,
    labelled: LabelledRows,
    metric: str,
) -> Row:
    """Test whether two models differ in a metric, on the same rows, pooled over common seeds.

    Args:
        first, second: what they say, about the same rows seed by seed.
        labelled: the test set.
        metric: "auc" (of confidence) or "balanced_accuracy" (of what is kept).

    Raises:
        BadValue: no seed in common.
    """
    value, shares_of, answers = PAIRED[metric]
    rows, one, other = _pooled(first, second, answers=answers)
    reference = labelled.reference[rows]
    groups = labelled.groups[rows]

    def difference(weights: Array | None) -> Array:
        """Return the difference of the pooled predictions, for weights or None."""
        return value(reference, one, weights=weights) - value(reference, other, weights=weights)

    found = stats.interval(difference, labelled.weights[:, rows])
    shares = shares_of(reference, first=one, second=other)
    null = stats.swapped(shares, groups, swaps=SWAPS)
    # What differs by rounding alone counts as equal.
    extreme = (np.abs(null) >= abs(found.value) - 1e-12).sum()
    p = float(1 + extreme) / (1 + SWAPS)
    p = p if np.isfinite(found.value) else np.nan
    return _row("swaps", metric, found=found, p=p, n=len(np.unique(groups)))


def rightness_difference(
    first: Sequence[Predictions], second: Sequence[Predictions], *, labelled: LabelledRows
) -> Row:
    """Test by McNemar's test whether two models are right equally often about the same rows.

    Args:
        first, second: what they say, about the same rows seed by seed.
        labelled: the test set.

    Raises:
        BadValue: no seed in common.
    """
    rows, one, other = _pooled(first, second, answers="kept")
    right = [kept == labelled.reference[rows] for kept in (one, other)]
    # Summed over seeds, row by row: weights of all seeds' rows would not fit into memory.
    count = len(labelled.reference)
    differs = np.bincount(rows, right[0].astype(float) - right[1], minlength=count)
    answers = np.bincount(rows, minlength=count)

    def difference(weights: Array | None) -> Array:
        """Return the difference in accuracy, for weights or None."""
        each = metrics.each_weight(differs, weights)
        return metrics.ratio(each @ differs, each @ answers)

    groups = labelled.groups[rows]
    found = stats.interval(difference, labelled.weights)
    p = mcnemar(*right, groups=groups)
    return _row("mcnemar", "accuracy", found=found, p=p, n=len(np.unique(groups)))


def _pooled(
    first: Sequence[Predictions], second: Sequence[Predictions], *, answers: str
) -> tuple[Array, Array, Array]:
    """Return rows (B,) and both models' answers about them, of all common seeds.

    Args:
        first, second: what they say, about the same rows seed by seed.
        answers: what `Predictions` call the answers.

    Raises:
        BadValue: no seed in common.
    """
    pairs = pair_seeds(first, second)
    seeds = [given.seed for given in first]
    common = len(pairs) > 0
    check(common, "seeds", seeds, allowed="must have one at least in common with the other model")
    # Pooled over seeds: the positions are the clusters, so seeds make no rows independent.
    rows = np.concatenate([given.rows for given, _ in pairs])
    one, other = (
        np.concatenate([getattr(given, answers) for given in side])
        for side in zip(*pairs, strict=True)
    )
    return rows, one, other


def _row(test: str, metric: str, *, found: stats.Interval, p: float, n: int) -> Row:
    """Return the cells of a test.

    Args:
        test: its name.
        metric: what differs.
        found: the difference.
        p: its p value.
        n: number of clusters.
    """
    ends = {"ci_low": found.low, "ci_high": found.high}
    return {"test": test, "metric": metric, "difference": found.value, **ends, "p": p, "n": n}


def correct(tests: Iterable[Row]) -> list[Row]:
    """Add Holm's correction, as `p_holm`, for the tests of a family.

    Tests that are read as one table are one family: those of one metric and training against the
    threshold, or of what the row's own `family` says.
    """
    rows = [dict(row) for row in tests]
    families = defaultdict(list)
    for row in rows:
        families[row.get("family", (row["metric"], row["training"]))].append(row)
    for family in families.values():
        adjusted = stats.holm(np.array([row["p"] for row in family]))
        for row, p in zip(family, adjusted.tolist(), strict=True):
            row["p_holm"] = p
    return rows
