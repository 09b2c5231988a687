"""Ranks of k models over N conditions (Demsar, Journal of Machine Learning Research 7, 2006).

In each condition the best model has rank 1, ties share the mean of theirs; R_j is a model's mean
rank. Whether any two differ, Friedman's test tells, in the form of Iman and Davenport:

    X^2 = 12 N / (k (k + 1)) (sum_j R_j^2 - k (k + 1)^2 / 4),   F = (N - 1) X^2 / (N (k - 1) - X^2)

with k - 1 and (k - 1)(N - 1) degrees of freedom. Which two differ, Nemenyi's test tells: mean ranks
further apart than the critical difference

    CD = q sqrt(k (k + 1) / (6 N)),

q sqrt 2 the quantile of the studentized range of k models with infinite degrees of freedom.

It depends on which other models are ranked; Wilcoxon's signed-rank test of each pair, corrected by
Holm, does not (Benavoli, Corani, Mangili, JMLR 17, 2016), and needs more conditions: with N of them
no p value is below 2^(1 - N). Conditions must not share rows.
"""

import math
from itertools import combinations

import numpy as np
from scipy.stats import f as fisher
from scipy.stats import friedmanchisquare, rankdata, studentized_range, wilcoxon

from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.evaluation.stats import LEVEL, holm


def mean_ranks(values: Array) -> Array:
    """Return the mean rank of each model, shape (k,); 1 is best.

    The values, shape (N, k), are those of N conditions and k models, the larger the better.
    """
    return np.asarray(rankdata(-_table(values), axis=1).mean(axis=0))


def friedman(values: Array) -> tuple[float, float]:
    """Return F of Iman and Davenport and its p value, of values (N, k)."""
    table = _table(values)
    conditions, models = table.shape
    # Of two models alone scipy's function, which knows about ties, has no statistic.
    check(models > 2, "models", models, allowed="must be at least three to be ranked")
    if (table == table[:, :1]).all():
        return 0.0, 1.0
    statistic = float(friedmanchisquare(*table.T).statistic)
    left = conditions * (models - 1) - statistic
    # All conditions agree in every rank.
    if left <= 1e-9:
        return math.inf, 0.0
    ratio = (conditions - 1) * statistic / left
    return ratio, float(fisher.sf(ratio, models - 1, (models - 1) * (conditions - 1)))


def critical_difference(models: int, *, conditions: int) -> float:
    """Return Nemenyi's critical difference of mean ranks, at 5 %."""
    quantile = float(studentized_range.ppf(LEVEL, models, np.inf)) / math.sqrt(2)
    return quantile * math.sqrt(models * (models + 1) / (6 * conditions))


def wilcoxon_holm(values: Array) -> Array:
    """Return p values of all pairs, corrected by Holm, shape (k, k); 1 on the diagonal.

    The values, shape (N, k), are those of N conditions and k models.
    """
    table = _table(values)
    models = table.shape[1]
    pairs = list(combinations(range(models), 2))
    raw = []
    for one, other in pairs:
        differences = table[:, one] - table[:, other]
        # Without any difference scipy divides by zero.
        raw.append(float(wilcoxon(differences).pvalue) if differences.any() else 1.0)
    found = np.ones((models, models))
    for (one, other), p in zip(pairs, holm(np.array(raw)), strict=True):
        found[one, other] = p
        found[other, one] = p
    return found


def cliques(ranks: Array, *, difference: float) -> list[tuple[int, ...]]:
    """Return the largest groups of models whose mean ranks lie within a critical difference.

    Each group names models by their place in `ranks` (k,), best first; single ones are no group.
    """
    order = np.argsort(ranks, kind="stable")
    rising = np.asarray(ranks)[order]
    found: list[tuple[int, ...]] = []
    reached = 0
    for start, low in enumerate(rising):
        end = int(np.searchsorted(rising, low + difference, "right"))
        # A group that ends where the one before ends is part of it.
        if end - start > 1 and end > reached:
            found.append(tuple(order[start:end].tolist()))
        reached = max(reached, end)
    return found


def _table(values: Array) -> Array:
    """Return values (N, k) as floats, all of them there."""
    table = np.asarray(values, dtype=float)
    fits = table.ndim == 2 and table.shape[0] > 1 and table.shape[1] > 1
    allowed = "must be (N, k), of two conditions and two models at least"
    check(fits, "values.shape", table.shape, allowed=allowed)
    finite = bool(np.isfinite(table).all())
    check(finite, "values", "NaN", allowed="must be there for each model in each condition")
    return table
