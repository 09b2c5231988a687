"""How often each test finds a difference where there is none: should be near 5 %.

    python tests/null_rates.py [cases [page]]

Two models that are equally good, or k of them, by simulation; an interval counts as a finding where
it leaves the truth out. What is known to be wrong stands beside it: rows taken for independent,
folds taken for independent, several tests without a correction. The table is printed, and put into
the page (docs/statistics.md).
"""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from scipy.stats import ttest_1samp

from echolearn.acoustics.types import Array
from echolearn.evaluation import pairs, pooling, ranks, stats
from echolearn.evaluation.metrics import kept
from echolearn.evaluation.paired_tests import corrected_t, mcnemar
from echolearn.storage.marked_page import Markers, write_between

PAGE = Markers(
    "<!-- null rates: written by `python tests/null_rates.py` -->",
    "<!-- end of null rates -->",
    "page",
)
"""Lines of a page between which the table stands."""

Found = dict[str, bool]
"""Which tests found a difference in one case."""


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
        values = 0.2 * rng.normal(size=(rooms, 1)) + rng.normal(size=(rooms, 40))
        weights = rng.multinomial(40, [1 / 40] * 40, size=200) / 40
        pooled = pooling.pool(values.mean(axis=1), values @ weights.T, units=values.size)
        found[f"interval over {rooms} rooms"] = not pooled.figure.low <= 0 <= pooled.figure.high
        mean = stats.interval(_mean(values.ravel()), _rows(rng, values.size))
        found[f"rows of {rooms} rooms as if independent"] = not mean.low <= 0 <= mean.high
    noise = rng.normal(size=164)
    walk = np.convolve(noise, np.ones(5) / np.sqrt(5), "valid")
    poses = np.arange(len(walk))
    seed = int(rng.integers(2**31))
    weights = stats.walk_weights(poses, resamples=200, seed=seed)
    units = len(walk) // stats.stretch(len(walk))
    stretches, _ = pooling.bounded(walk.mean(), _mean(walk)(weights), units=units)
    found["interval over stretches of a walk"] = not stretches.low <= 0 <= stretches.high
    mean = stats.interval(_mean(walk), _rows(rng, len(walk)))
    found["poses of a walk as if independent"] = not mean.low <= 0 <= mean.high
    return found


def _rows(rng: np.random.Generator, count: int) -> Array:
    """Return 200 resamples of rows, one by one."""
    seed = int(rng.integers(2**31))
    return stats.cluster_weights(np.arange(count), resamples=200, seed=seed)


def _mean(values: Array) -> stats.Statistic:
    """Return the mean of values (B,) as a function of weights."""
    return lambda w: values.mean() if w is None else w @ values / w.sum(axis=-1)


def rates(cases: int) -> Iterator[tuple[str, float]]:
    """Yield each test's name with the share of cases in which it found a difference."""
    draws: tuple[Callable[[np.random.Generator], Found], ...] = (
        rows, folds, ranked, several, intervals
    )  # fmt: skip
    for draw in draws:
        found = [draw(np.random.default_rng([case, 17])) for case in range(cases)]
        for name in found[0]:
            yield name, float(np.mean([each[name] for each in found]))


def table(cases: int) -> str:
    """Return a Markdown table of all rates."""
    lines = ["| test | finds a difference in |", "|---|---|"]
    lines += [f"| {name} | {rate:.1%} |" for name, rate in rates(cases)]
    chance = 1.96 * (0.05 * 0.95 / cases) ** 0.5
    return "\n".join([*lines, "", f"{cases} cases; of 5 %, chance alone is worth +-{chance:.1%}."])


if __name__ == "__main__":
    written = table(int(sys.argv[1]) if len(sys.argv) > 1 else 2000)
    print(written)
    if len(sys.argv) > 2:
        write_between(Path(sys.argv[2]), written, markers=PAGE)
