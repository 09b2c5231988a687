"""McNemar, and Nadeau and Bengio: by hand, and where they become simpler tests."""

import numpy as np
import pytest
from scipy.stats import chi2, ttest_1samp

from echolearn.checks import BadValue
from echolearn.evaluation.paired_tests import corrected_t, mcnemar


def right(better, worse, equal=7):
    """Return where two models are right: the first alone, the second alone, both."""
    first = [True] * better + [False] * worse + [True] * equal
    second = [False] * better + [True] * worse + [True] * equal
    return np.array(first), np.array(second)


@pytest.mark.parametrize(
    ("better", "worse", "p"),
    # 2 sum_{i <= 3} C(13, i) / 2^13; one coin is no evidence; nor are equal numbers.
    [(10, 3, 2 * (1 + 13 + 78 + 286) / 8192), (1, 0, 1.0), (6, 6, 1.0), (6, 0, 2 / 64), (0, 0, 1)],
)
def test_mcnemar_of_independent_rows_is_a_sign_test(better, worse, p):
    first, second = right(better, worse)
    alone = np.arange(len(first))
    assert mcnemar(first, second, groups=alone) == pytest.approx(p)
    assert mcnemar(second, first, groups=alone) == pytest.approx(p)


def test_mcnemar_of_clusters_sums_within_them():
    """Sums of +2, +1, -1 and +1, of which the first cluster's two rows count as one."""
    first, second = right(4, 1, equal=0)
    groups = np.array([0, 0, 1, 2, 3])
    assert mcnemar(first, second, groups=groups) == pytest.approx(chi2.sf(9 / 7, 1))
    # Rows that are there five times over are no more evidence than once.
    five = [np.repeat(each, 5) for each in (first, second, groups)]
    assert mcnemar(five[0], five[1], groups=five[2]) == pytest.approx(chi2.sf(9 / 7, 1))
    assert mcnemar(*right(1, 1, equal=0), groups=np.zeros(2)) == 1.0
    with pytest.raises(BadValue, match="no rows"):
        mcnemar(*right(0, 0, equal=0), groups=np.empty(0))


def test_corrected_t_by_hand():
    """Mean 0.03, s^2 = 0.00025, error sqrt((1/5 + 1/4) s^2) = 0.0106066, t = 2.8284."""
    found, p = corrected_t(np.array([0.02, 0.04, 0.01, 0.03, 0.05]), test_to_training=0.25)
    half = 2.776445 * 0.0106066
    assert found == pytest.approx((0.03, 0.03 - half, 0.03 + half), abs=1e-6)
    assert p == pytest.approx(0.047421, abs=1e-6)


def test_without_overlap_it_is_a_plain_t_test():
    differences = np.random.default_rng(3).normal(0.3, size=9)
    plain = ttest_1samp(differences, 0)
    found, p = corrected_t(differences, test_to_training=0)
    assert p == pytest.approx(plain.pvalue)
    assert found[1:] == pytest.approx(tuple(plain.confidence_interval(0.95)))
    assert corrected_t(differences, test_to_training=0.25)[1] > p


def test_folds_that_all_agree_and_folds_that_are_none():
    assert corrected_t(np.zeros(5), test_to_training=0.25)[1] == 1.0
    assert corrected_t(np.full(4, 0.5), test_to_training=0.25)[1] == 0.0
    with pytest.raises(BadValue, match="^folds=1: must be at least two"):
        corrected_t(np.array([0.1]), test_to_training=0.25)
    with pytest.raises(BadValue, match="^test_to_training=-1"):
        corrected_t(np.zeros(5), test_to_training=-1)
