"""How often each test finds a difference where there is none: should be near 5 %.

    python tests/null_rates.py [cases [page]]

Two models that are equally good, or k of them, by simulation; an interval counts as a finding where
it leaves the truth out. What is known to be wrong stands beside it: rows taken for independent,
folds taken for independent, several tests without a correction. And how often each interval holds a
difference that is there and known: should be near 95 %. Both tables are printed, and put into the
page (docs/statistics.md).
"""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from scipy.stats import norm, ttest_1samp

from echolearn.acoustics.types import Array
from echolearn.evaluation import pairs, pooling, ranks, stats
from echolearn.evaluation.metrics import auc, kept
from echolearn.evaluation.paired_tests import corrected_t, mcnemar
from echolearn.storage.marked_page import Markers, write_between

PAGE = Markers(
    "<!-- null rates: written by `python tests/null_rates.py` -->",
    "<!-- end of null rates -->",
    "page",
)
"""Lines of a page between which the table stands."""

Found = dict[str, bool]
"""Which tests found a difference in one case, or which intervals held it."""

WALKS = 60, 160
"""Poses of a short walk, and of one as `echolearn survey` makes it."""

SHARES = 0.8, 0.7
"""Of right answers of two models that are not equally good."""

RESAMPLES = 1000
"""Draws of each interval, as many as a comparison makes."""


def equal_models(
    rng: np.random.Generator, *, clusters: int = 60, each: int = 3
) -> tuple[Array, ...]:
    """Return truth, clusters and confidences of two equally good models, each (B,).

    Both see the difficulty that the rows of a cluster share, and each errs by cluster besides.
    """
    groups = np.repeat(np.arange(clusters), each)
    reference = rng.random(len(groups)) < 0.5
    signal = 2.0 * reference + rng.normal(size=clusters)[groups]
    own = rng.normal(size=(2, clusters))[:, groups] + 0.5 * rng.normal(size=(2, len(groups)))
    return reference, groups, *(signal + own)


def rows(rng: np.random.Generator) -> Found:
    """Test two models on clustered rows: swapped answers, and McNemar."""
    reference, groups, first, second = equal_models(rng)
    alone = np.arange(len(groups))
    found = {}
    for name, by in (("swaps", groups), ("swaps, rows as if independent", alone)):
        shares = pairs.auc_shares(reference, first=first, second=second)
        null = stats.swapped(shares, by, swaps=199, seed=int(rng.integers(2**31)))
        p = (1 + (np.abs(null) >= abs(shares.sum()) - 1e-12).sum()) / 200
        found[name] = bool(p <= 0.05)
    right = [kept(each, 1.0) == reference for each in (first, second)]
    found["McNemar"] = mcnemar(*right, groups=groups) <= 0.05
    found["McNemar, rows as if independent"] = mcnemar(*right, groups=alone) <= 0.05
    return found


def folds(rng: np.random.Generator) -> Found:
    """Test two learners over five folds of three seeds, each on five columns of its own."""
    y = rng.random(100) < 0.5
    columns = rng.normal(size=(2, 100, 5)) + 0.5 * y[:, None]
    differences = []
    for _ in range(3):
        for test in np.array_split(rng.permutation(100), 5):
            taught = np.setdiff1d(np.arange(100), test)
            right = [_nearest_mean(x, y, taught=taught, test=test) for x in columns]
            differences.append(right[0] - right[1])
    d = np.array(differences)
    naive = bool(d.any() and ttest_1samp(d, 0).pvalue <= 0.05)
    return {
        "Nadeau and Bengio, 5 folds, 3 seeds": corrected_t(d, test_to_training=1 / 4)[1] <= 0.05,
        "t over these folds as if independent": naive,
    }


def _nearest_mean(x: Array, y: Array, *, taught: Array, test: Array) -> float:
    """Return the share of test rows that lie nearer to the mean of their own class."""
    means = [x[taught][y[taught] == label].mean(axis=0) for label in (False, True)]
    far = [np.square(x[test] - mean).sum(axis=1) for mean in means]
    return float(np.mean((far[1] < far[0]) == y[test]))


def ranked(rng: np.random.Generator) -> Found:
    """Rank six equal models over fifteen conditions of unequal difficulty."""
    values = rng.normal(size=(15, 1)) + 0.3 * rng.normal(size=(15, 6))
    mean = ranks.mean_ranks(values)
    apart = ranks.critical_difference(6, conditions=15)
    return {
        "Friedman, 6 models": ranks.friedman(values)[1] <= 0.05,
        "Nemenyi, any of 15 pairs": bool(np.ptp(mean) > apart),
        "Wilcoxon and Holm, any of 15 pairs": bool(ranks.wilcoxon_holm(values).min() <= 0.05),
    }


def several(rng: np.random.Generator) -> Found:
    """Test twelve equal models against one, with and without Holm."""
    p = rng.random(12)
    return {
        "Holm, any of 12": bool(stats.holm(p).min() <= 0.05),
        "any of 12": bool(p.min() <= 0.05),
    }


def intervals(rng: np.random.Generator) -> Found:
    """Draw a figure's interval: over rooms, over a walk whose neighbouring poses are alike."""
    found = {}
    for rooms in (pooling.LEAST_ROOMS, 2 * pooling.LEAST_ROOMS):
        values = _in_rooms(rng, rooms)
        found[f"interval over {rooms} rooms"] = not _holds(over_rooms(rng, values), 0.0)
        alone = over_rows(rng, values.ravel())
        found[f"rows of {rooms} rooms as if independent"] = not _holds(alone, 0.0)
    for poses in WALKS:
        values = _on_walk(rng, poses)
        found[f"interval over stretches of a walk of {poses} poses"] = not _holds(
            over_stretches(rng, values), 0.0
        )
        alone = over_rows(rng, values)
        found[f"{poses} poses of a walk as if independent"] = not _holds(alone, 0.0)
    return found


def effects(rng: np.random.Generator) -> Found:
    """Draw intervals of differences that are there: of shares of right answers, and of AUC."""
    share = SHARES[0] - SHARES[1]
    found = {}
    for rooms in (pooling.LEAST_ROOMS, 2 * pooling.LEAST_ROOMS):
        better = _lead(*(_in_rooms(rng, rooms) for _ in range(3)))
        found[f"share right, {rooms} rooms, {share:+.2f}"] = _holds(over_rooms(rng, better), share)
    for poses in WALKS:
        better = _lead(*(_on_walk(rng, poses) for _ in range(3)))
        name = f"share right, stretches of a walk of {poses} poses, {share:+.2f}"
        found[name] = _holds(over_stretches(rng, better), share)

    reference, groups, first, second = equal_models(rng)
    weaker = second - 0.5 * reference
    weights = stats.cluster_weights(groups, resamples=RESAMPLES, seed=int(rng.integers(2**31)))
    lead = stats.interval(
        lambda w: auc(reference, first, weights=w) - auc(reference, weaker, weights=w), weights
    )
    # True rows are 2 (or 1.5) above false ones, and two rows differ with this variance.
    truth = float(norm.cdf(2.0 / 4.5**0.5) - norm.cdf(1.5 / 4.5**0.5))
    found[f"AUC, 60 positions, {truth:+.3f}"] = _holds(lead, truth)
    return found


def _in_rooms(rng: np.random.Generator, rooms: int) -> Array:
    """Return normal values of 40 positions in each room that are alike in a room, (R, 40)."""
    alike = 0.2 * rng.normal(size=(rooms, 1)) + rng.normal(size=(rooms, 40))
    return alike / np.sqrt(1.04)


def _on_walk(rng: np.random.Generator, poses: int) -> Array:
    """Return normal values of poses of which up to five in a row have something in common."""
    return np.convolve(rng.normal(size=poses + 4), np.ones(5) / np.sqrt(5), "valid")


def _lead(common: Array, *own: Array) -> Array:
    """Return by how much one model is right more often than the other, -1, 0 or 1 each.

    Both find hard what is hard, a half, and the other half is their own.
    """
    limits = norm.ppf(SHARES)
    right = [(common + each) / np.sqrt(2) < limit for each, limit in zip(own, limits, strict=True)]
    return right[0].astype(float) - right[1]


def over_rooms(rng: np.random.Generator, values: Array) -> stats.Interval:
    """Return the mean of values (R, P) with its interval over rooms."""
    positions = values.shape[1]
    weights = rng.multinomial(positions, [1 / positions] * positions, size=RESAMPLES) / positions
    return pooling.pool(values.mean(axis=1), values @ weights.T, units=values.size).figure


def over_stretches(rng: np.random.Generator, values: Array) -> stats.Interval:
    """Return the mean of values (P,) along a walk with its interval over stretches."""
    count = len(values)
    seed = int(rng.integers(2**31))
    weights = stats.walk_weights(np.arange(count), resamples=RESAMPLES, seed=seed)
    units = count // stats.stretch(count)
    return pooling.bounded(values.mean(), _mean(values)(weights), units=units)[0]


def over_rows(rng: np.random.Generator, values: Array) -> stats.Interval:
    """Return the mean of values (B,) with its interval over rows, one by one."""
    seed = int(rng.integers(2**31))
    rows = np.arange(len(values))
    return stats.interval(
        _mean(values), stats.cluster_weights(rows, resamples=RESAMPLES, seed=seed)
    )


def _holds(found: stats.Interval, truth: float) -> bool:
    """Tell whether an interval holds the truth."""
    return found.low <= truth <= found.high


def _mean(values: Array) -> stats.Statistic:
    """Return the mean of values (B,) as a function of weights."""
    return lambda w: values.mean() if w is None else w @ values / w.sum(axis=-1)


def rates(cases: int) -> Iterator[tuple[str, float]]:
    """Yield each test's name with the share of cases in which it found a difference."""
    draws: tuple[Callable[[np.random.Generator], Found], ...] = (
        rows, folds, ranked, several, intervals
    )  # fmt: skip
    for draw in draws:
        yield from _shares(draw, cases)


def coverage(cases: int) -> Iterator[tuple[str, float]]:
    """Yield each figure's name with the share of cases in which its interval held the truth."""
    yield from _shares(effects, cases)


def _shares(
    draw: Callable[[np.random.Generator], Found], cases: int
) -> Iterator[tuple[str, float]]:
    """Yield by name in which share of cases each was so."""
    found = [draw(np.random.default_rng([case, 17])) for case in range(cases)]
    for name in found[0]:
        yield name, float(np.mean([each[name] for each in found]))


def table(cases: int) -> str:
    """Return Markdown tables of all rates and of all coverages, each with its own uncertainty."""
    lines = ["| test | finds a difference in | 95 % interval of that |", "|---|---|---|"]
    lines += [_line(*each, cases=cases) for each in rates(cases)]
    lines += ["", "| difference of | its interval holds it in | 95 % interval of that |"]
    lines += ["|---|---|---|", *(_line(*each, cases=cases) for each in coverage(cases))]
    return "\n".join([*lines, "", f"{cases} cases, intervals by {RESAMPLES} draws."])


def _line(name: str, share: float, *, cases: int) -> str:
    """Return a line of a table."""
    _, low, high = stats.wilson(round(share * cases), cases)
    return f"| {name} | {share:.1%} | {100 * low:.1f}-{100 * high:.1f}% |"


if __name__ == "__main__":
    written = table(int(sys.argv[1]) if len(sys.argv) > 1 else 2000)
    print(written)
    if len(sys.argv) > 2:
        write_between(Path(sys.argv[2]), written, markers=PAGE)
