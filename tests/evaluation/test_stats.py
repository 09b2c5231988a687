"""Intervals must cover: simulations of a known truth, values by hand."""

import numpy as np
import pytest
from scipy.stats import norm

from echolearn.checks import BadValue
from echolearn.evaluation import metrics, stats


def test_weights_draw_whole_clusters_with_replacement():
    groups = np.array([7, 3, 3, 9, 7, 7])
    weights = stats.cluster_weights(groups, resamples=4000, seed=1)
    assert weights.shape == (4000, 6)
    assert (weights[:, [0, 0, 1]] == weights[:, [4, 5, 2]]).all()
    assert (weights[:, [0, 1, 3]].sum(axis=1) == 3).all()
    np.testing.assert_allclose(weights.mean(axis=0), 1.0, atol=0.06)
    np.testing.assert_allclose(weights.var(axis=0), 2 / 3, atol=0.06)
    again, other = (stats.cluster_weights(groups, resamples=4000, seed=seed) for seed in (1, 2))
    assert (weights == again).all() and (weights != other).any()
    with pytest.raises(BadValue, match="no rows"):
        stats.cluster_weights(np.empty(0), resamples=9)


def of_mean(values, by, *, resamples=300, seed=0):
    """Return the interval of a mean."""
    weights = stats.cluster_weights(by, resamples=resamples, seed=seed)

    def mean(each):
        return values.mean() if each is None else each @ values / each.sum(axis=-1)

    return stats.interval(mean, weights)


def test_blocks_change_nothing():
    values = np.random.default_rng(0).random(700)
    weights = stats.cluster_weights(np.arange(700), resamples=300)
    assert weights.size > stats.BLOCK
    expected = np.quantile(weights @ values / 700, [0.025, 0.975])
    found = of_mean(values, np.arange(700))
    assert found == pytest.approx((values.mean(), *expected))


def test_interval_covers_the_truth_in_about_95_of_100_cases():
    """By clusters; by rows, as if they were independent, it covers less often."""
    rng = np.random.default_rng(5)
    hits = {"clusters": 0, "rows": 0}
    groups = np.repeat(np.arange(40), 6)
    for case in range(300):
        # The chance of being right varies from one cluster to the next.
        chance = 1 / (1 + np.exp(-rng.normal(size=40)))
        right = rng.random(240) < chance[groups]
        for name, by in (("clusters", groups), ("rows", np.arange(240))):
            found = of_mean(right, by, seed=case)
            hits[name] += found.low <= 0.5 <= found.high
    assert 0.90 <= hits["clusters"] / 300 <= 0.985
    assert hits["rows"] < hits["clusters"]


def test_intervals_of_every_metric_at_once():
    rng = np.random.default_rng(4)
    reference = rng.random(200) < 0.5
    confidence = np.clip(0.3 * reference + 0.7 * rng.random(200), 0, 1)
    weights = stats.cluster_weights(np.arange(200) // 2, resamples=1000)

    def every(w):
        return metrics.evaluate_labels(reference, confidence, threshold=0.5, weights=w)

    found = stats.intervals(every, weights)
    assert set(found) == set(every(None))
    assert found["auc"] == stats.interval(lambda w: every(w)["auc"], weights)
    del found["expected_calibration_error"]  # it is biased: every draw is worse calibrated
    for name, each in found.items():
        assert each.low <= each.value <= each.high, name


def test_what_has_no_draws_or_is_undefined_has_no_interval():
    found = stats.intervals(lambda w: {"a": np.array(0.5)} if w is None else {}, np.ones((10, 3)))
    assert found["a"].value == 0.5
    assert np.isnan(found["a"][1:]).all()
    nan = stats.interval(
        lambda w: np.array(np.nan) if w is None else np.ones(len(w)), np.ones((9, 3))
    )
    assert np.isnan(nan).all()


@pytest.mark.parametrize(("successes", "trials"), [(0, 10), (8, 10), (10, 10), (82, 100), (1, 3)])
def test_wilson_is_the_root_of_its_equation(successes, trials):
    """Its ends are the shares q with (share - q)^2 = z^2 q (1 - q) / trials."""
    found = stats.wilson(successes, trials)
    share = successes / trials
    assert found.value == share
    for end in found[1:]:
        bound = norm.ppf(0.975) ** 2 * end * (1 - end) / trials
        assert (share - end) ** 2 == pytest.approx(bound, abs=1e-12)
    assert found.low <= share <= found.high


@pytest.mark.parametrize("counts", [(4, 3), (0, 0), (-1, 3)])
def test_wilson_wants_trials_and_no_more_successes_than_these(counts):
    with pytest.raises(BadValue):
        stats.wilson(*counts)


def test_holm_by_hand():
    """It stops at one, and skips what was not tested."""
    for given, expected in (
        ([0.01, 0.04, 0.03, 0.005], [0.03, 0.06, 0.06, 0.02]),
        ([0.6, np.nan, 0.5], [1.0, np.nan, 1.0]),
        ([], []),
    ):
        np.testing.assert_allclose(stats.holm(np.array(given)), expected)
