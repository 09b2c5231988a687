"""Ranks over conditions: the worked example of Demsar (2006), his table, values by hand."""

import math

import numpy as np
import pytest
from scipy.stats import wilcoxon

from echolearn.checks import BadValue
from echolearn.evaluation import ranks

DEMSAR = np.array(
    """
    .763 .768 .771 .798  .599 .591 .590 .569  .954 .971 .968 .967  .628 .661 .654 .657
    .882 .888 .886 .898  .936 .931 .916 .931  .661 .668 .609 .685  .583 .583 .563 .625
    .775 .838 .866 .875  1.   1.   1.   1.    .940 .962 .965 .962  .619 .666 .614 .669
    .972 .981 .9751 .975  .957 .978 .946 .970
    """.split(),
    dtype=float,
).reshape(14, 4)
"""AUC of four variants of C4.5 on 14 sets, table 6 of the paper; of what it rounds to one figure,
.975, its ranks tell which is larger."""


def test_the_worked_example():
    """The paper's F is 3.69; four sets have ties, for which its formula has no correction."""
    found = ranks.mean_ranks(DEMSAR)
    assert found == pytest.approx([3.143, 2.000, 2.893, 1.964], abs=5e-4)
    statistic = 12 * 14 / (4 * 5) * (np.square(found).sum() - 4 * 25 / 4)
    assert statistic == pytest.approx(9.28, abs=0.01)
    # Two of four level in three sets, all four in one: sum of (t^3 - t) over N (k^3 - k).
    corrected = statistic / (1 - (3 * 6 + 60) / (14 * 60))
    f, p = ranks.friedman(DEMSAR)
    assert f == pytest.approx(13 * corrected / (14 * 3 - corrected))
    assert 13 * statistic / (14 * 3 - statistic) == pytest.approx(3.69, abs=0.01)
    assert 0.01 < p < 0.02

    apart = ranks.critical_difference(4, conditions=14)
    assert apart == pytest.approx(1.25, abs=0.005)
    # The first and the last model are 1.18 apart: too little to tell.
    assert ranks.cliques(found, difference=apart) == [(3, 1, 2, 0)]
    assert ranks.cliques(found, difference=1.0) == [(3, 1, 2), (2, 0)]


@pytest.mark.parametrize(
    ("models", "quantile"), [(2, 1.960), (3, 2.343), (4, 2.569), (6, 2.850), (10, 3.164)]
)
def test_the_table_of_quantiles(models, quantile):
    found = ranks.critical_difference(models, conditions=1)
    assert found == pytest.approx(quantile * math.sqrt(models * (models + 1) / 6), rel=5e-4)


def test_pairs_are_scipys_corrected_by_hand():
    values = np.random.default_rng(2).normal([0, 0.2, 1.5], 1, size=(12, 3))
    found = ranks.wilcoxon_holm(values)
    raw = {pair: wilcoxon(*values[:, pair].T).pvalue for pair in ((0, 1), (0, 2), (1, 2))}
    steps = 0.0
    for left, (pair, p) in zip(
        (3, 2, 1), sorted(raw.items(), key=lambda each: each[1]), strict=True
    ):
        steps = max(steps, min(1.0, left * p))
        assert found[pair] == found[pair[::-1]] == pytest.approx(steps)
    assert (found.diagonal() == 1).all()


def test_models_that_never_differ_and_conditions_that_all_agree():
    same = np.ones((5, 3))
    assert ranks.friedman(same) == (0.0, 1.0)
    assert ranks.mean_ranks(same).tolist() == [2, 2, 2]
    assert (ranks.wilcoxon_holm(same) == 1).all()
    assert ranks.friedman(np.tile([3.0, 2.0, 1.0], (5, 1))) == (math.inf, 0.0)


@pytest.mark.parametrize(
    ("given", "difference", "expected"),
    [
        ([1, 2, 3, 4], 1.0, [(0, 1), (1, 2), (2, 3)]),
        ([4, 1.5, 3, 1.4], 0.2, [(3, 1)]),
        ([1, 1.5, 2, 9], 1.0, [(0, 1, 2)]),
        ([1, 5, 9], 1.0, []),
    ],
)
def test_cliques_by_hand(given, difference, expected):
    assert ranks.cliques(np.array(given), difference=difference) == expected


@pytest.mark.parametrize(
    ("values", "message"),
    [(np.ones((1, 3)), "two conditions"), (np.array([[1.0, 2], [3, np.nan]]), "NaN")],
)
def test_what_cannot_be_ranked(values, message):
    with pytest.raises(BadValue, match=message):
        ranks.mean_ranks(values)
    with pytest.raises(BadValue, match="^models=2: must be at least three"):
        ranks.friedman(np.ones((4, 2)))
