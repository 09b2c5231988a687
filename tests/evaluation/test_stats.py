"""Intervals must cover, tests must not cry wolf: simulations of a known truth, values by hand."""

import numpy as np
import pytest
from scipy.stats import norm, rankdata

from echolearn.checks import BadValue
from echolearn.evaluation import map_metrics, metrics, stats
from echolearn.evaluation.pairs import PAIRED


def clustered(rng, *, shared=1.0):
    """Draw 40 clusters of 6 rows whose chance of being right varies from one to the next."""
    chance = 1 / (1 + np.exp(-shared * rng.normal(size=40)))
    groups = np.repeat(np.arange(40), 6)
    return rng.random(len(groups)) < chance[groups], groups


def of_mean(values, by, *, resamples=1000, seed=0):
    """Return the interval of a mean."""
    weights = stats.cluster_weights(by, resamples=resamples, seed=seed)
    every = np.full(len(values), True)
    return stats.interval(lambda w: map_metrics.error_mean(values, every, weights=w), weights)


def test_weights_draw_whole_clusters_with_replacement():
    groups = np.array([7, 3, 3, 9, 7, 7])
    weights = stats.cluster_weights(groups, resamples=4000, seed=1)
    assert weights.shape == (4000, 6)
    assert (weights[:, [0, 0, 1]] == weights[:, [4, 5, 2]]).all()
    assert (weights[:, [0, 1, 3]].sum(axis=1) == 3).all()
    np.testing.assert_allclose(weights.mean(axis=0), 1.0, atol=0.06)
    np.testing.assert_allclose(weights.var(axis=0), 2 / 3, atol=0.06)


def test_weights_repeat_with_the_seed():
    one, again, other = (
        stats.cluster_weights(np.arange(20), resamples=9, seed=seed) for seed in (3, 3, 4)
    )
    assert (one == again).all() and (one != other).any()


def test_interval_of_a_mean_is_the_textbook_one():
    values = np.random.default_rng(0).normal(2.0, 3.0, size=400)
    found = of_mean(values, np.arange(400), resamples=4000)
    mean, half = values.mean(), 1.96 * values.std() / 20
    assert found.value == pytest.approx(mean)
    assert found[1:] == pytest.approx((mean - half, mean + half), abs=0.03)


def test_blocks_change_nothing():
    values = np.random.default_rng(0).random(700)
    weights = stats.cluster_weights(np.arange(700), resamples=300)
    assert weights.size > stats.BLOCK
    expected = np.quantile(weights @ values / 700, [0.025, 0.975])
    assert of_mean(values, np.arange(700), resamples=300)[1:] == pytest.approx(tuple(expected))


def test_interval_covers_the_truth_in_about_95_of_100_cases():
    """By clusters; by rows, as if they were independent, it covers less often."""
    rng = np.random.default_rng(5)
    hits = {"clusters": 0, "rows": 0}
    for case in range(300):
        right, groups = clustered(rng)
        for name, by in (("clusters", groups), ("rows", np.arange(len(groups)))):
            found = of_mean(right, by, resamples=300, seed=case)
            hits[name] += found.low <= 0.5 <= found.high
    assert 0.90 <= hits["clusters"] / 300 <= 0.985
    assert hits["rows"] < hits["clusters"]


def test_correlated_clusters_widen_the_interval():
    right, groups = clustered(np.random.default_rng(2), shared=3.0)
    wide, narrow = (of_mean(right, by) for by in (groups, np.arange(len(groups))))
    assert wide.high - wide.low > 1.5 * (narrow.high - narrow.low)


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


def test_wilson_without_trials_and_with_too_many_successes():
    assert np.isnan(stats.wilson(0, 0).value)
    assert stats.wilson(0, 0)[1:] == (0.0, 1.0)
    with pytest.raises(BadValue, match="more successes"):
        stats.wilson(4, 3)


def pair(rng, *, clusters=60, better=0.0):
    """Draw two models' confidences that share their cluster's difficulty; the first is `better`."""
    groups = np.repeat(np.arange(clusters), 3)
    reference = rng.random(len(groups)) < 0.5
    signal = 2.0 * reference + rng.normal(size=clusters)[groups]
    answers = []
    for strength in (1 + better, 1.0):
        own = rng.normal(size=clusters)[groups] + 0.5 * rng.normal(size=len(groups))
        answers.append(strength * signal + own)
    return reference, *answers, groups


def paired(reference, first, second, groups, *, metric="auc", resamples=200, swaps=1000, seed=0):
    """Return the paired test of two answers."""
    value, shares = PAIRED[metric]
    return stats.paired_test(
        lambda w: value(reference, first, weights=w) - value(reference, second, weights=w),
        shares=shares(reference, first=first, second=second),
        groups=groups,
        weights=stats.cluster_weights(groups, resamples=resamples),
        swaps=swaps,
        seed=seed,
    )


def cut(reference, first, second, groups):
    return reference, first > 1, second > 1, groups


@pytest.mark.parametrize("metric", PAIRED)
def test_no_difference_is_found_where_there_is_none(metric):
    rng = np.random.default_rng(8)
    found = 0
    for case in range(300):
        rows = pair(rng) if metric == "auc" else cut(*pair(rng))
        found += paired(*rows, metric=metric, resamples=2, swaps=199, seed=case).p <= 0.05
    assert 0.02 <= found / 300 <= 0.09


@pytest.mark.parametrize("metric", PAIRED)
def test_swapping_is_linear_in_the_shares(metric):
    rng = np.random.default_rng(4)
    reference, first, second, _ = pair(rng, clusters=12)
    if metric == "auc":
        first, second = rankdata(first.round()), rankdata(second.round())
    else:
        first, second = first > 1, second > 1
    value, shares_of = PAIRED[metric]
    shares = shares_of(reference, first=first, second=second)
    for _ in range(20):
        swap = rng.integers(2, size=len(reference)).astype(bool)
        one, other = np.where(swap, second, first), np.where(swap, first, second)
        expected = value(reference, one) - value(reference, other)
        assert np.where(swap, -shares, shares).sum() == pytest.approx(expected, abs=1e-12)


def test_the_p_value_counts_literal_swaps():
    reference, *answers, groups = pair(np.random.default_rng(11), clusters=30, better=0.3)
    first, second = (rankdata(answer) for answer in answers)
    found = paired(reference, first, second, groups, resamples=2, swaps=4000)
    rng, extreme = np.random.default_rng(0), 0
    for _ in range(1500):
        swap = rng.integers(2, size=30).astype(bool)[groups]
        one, other = np.where(swap, second, first), np.where(swap, first, second)
        difference = metrics.auc(reference, one) - metrics.auc(reference, other)
        extreme += abs(difference) >= abs(found.value)
    assert 0.02 < found.p < 0.9
    assert found.p == pytest.approx(extreme / 1500, abs=4 * np.sqrt(0.25 / 1500))


def test_a_real_difference_is_found_and_pairing_narrows_it():
    reference, first, second, groups = pair(np.random.default_rng(3), clusters=200, better=2.0)
    one = paired(reference, first, second, groups)
    other = paired(reference, second, first, groups)
    assert one.p < 0.01
    assert 0 < one.low < one.value < one.high
    assert one.value == metrics.auc(reference, first) - metrics.auc(reference, second)
    assert other[:3] == pytest.approx((-one.value, -one.high, -one.low))
    weights = stats.cluster_weights(groups, resamples=200)
    single = stats.interval(lambda w: metrics.auc(reference, first, weights=w), weights)
    assert one.high - one.low < np.sqrt(2) * (single.high - single.low)


def test_the_scale_of_a_model_does_not_matter():
    reference, first, second, groups = pair(np.random.default_rng(6))
    plain = paired(reference, first, second, groups)
    assert paired(reference, 100 * first - 3, second, groups) == plain
    assert paired(reference, first, first, groups) == (0, 0, 0, 1)


def test_unequal_columns_are_refused():
    case = {"shares": np.ones(4), "weights": np.ones((2, 4)), "swaps": 9}
    with pytest.raises(BadValue, match="groups=3 rows"):
        stats.paired_test(lambda w: np.zeros(2), groups=np.arange(3), **case)
    with pytest.raises(BadValue, match="no rows"):
        stats.cluster_weights(np.empty(0), resamples=9)


def test_holm_by_hand():
    """It stops at one, and skips what was not tested."""
    for given, expected in (
        ([0.01, 0.04, 0.03, 0.005], [0.03, 0.06, 0.06, 0.02]),
        ([0.6, np.nan, 0.5], [1.0, np.nan, 1.0]),
        ([], []),
    ):
        np.testing.assert_allclose(stats.holm(np.array(given)), expected)
