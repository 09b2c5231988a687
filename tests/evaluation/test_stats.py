"""Intervals must cover, tests must not cry wolf: simulations with a known truth, and values by
hand."""

from functools import partial

import numpy as np
import pytest
from scipy.stats import binomtest

from echolearn.checks import BadValue
from echolearn.evaluation import metrics, stats


def clustered(rng, *, clusters=40, rows=6, shared=1.0):
    """Draw rows whose chance of being right varies from cluster to cluster around 1/2."""
    chance = 1 / (1 + np.exp(-shared * rng.normal(size=clusters)))
    groups = np.repeat(np.arange(clusters), rows)
    return rng.random(len(groups)) < chance[groups], groups


def test_weights_draw_whole_clusters_with_replacement():
    groups = np.array([7, 3, 3, 9, 7, 7])
    weights = stats.cluster_weights(groups, resamples=4000, seed=1)
    assert weights.shape == (4000, 6)
    assert (weights[:, [0, 0, 1]] == weights[:, [4, 5, 2]]).all()
    assert (weights[:, [0, 1, 3]].sum(axis=1) == 3).all()
    np.testing.assert_allclose(weights.mean(axis=0), 1.0, atol=0.06)
    np.testing.assert_allclose(weights.var(axis=0), 2 / 3, atol=0.06)


def test_weights_repeat_with_the_seed():
    groups = np.arange(20)
    assert (stats.cluster_weights(groups, seed=3) == stats.cluster_weights(groups, seed=3)).all()
    assert (stats.cluster_weights(groups, seed=3) != stats.cluster_weights(groups, seed=4)).any()


def test_interval_of_a_mean_is_the_textbook_one():
    values = np.random.default_rng(0).normal(2.0, 3.0, size=400)
    weights = stats.cluster_weights(np.arange(400), resamples=4000)
    kept = np.full(400, True)
    found = stats.interval(lambda w: metrics.error_mean(values, kept, weights=w), weights)
    half = 1.96 * values.std() / 20
    assert found.value == pytest.approx(values.mean())
    assert (found.low, found.high) == pytest.approx(
        (values.mean() - half, values.mean() + half), abs=0.03
    )


def test_blocks_change_nothing():
    groups = np.arange(700)
    weights = stats.cluster_weights(groups, resamples=300)
    values, kept = np.random.default_rng(0).random(700), np.full(700, True)
    draws = metrics.error_mean(values, kept, weights=weights)
    found = stats.interval(lambda w: metrics.error_mean(values, kept, weights=w), weights)
    assert (found.low, found.high) == pytest.approx(tuple(np.quantile(draws, [0.025, 0.975])))


def test_interval_covers_the_truth_in_about_95_of_100_cases():
    rng, hits, naive_hits, cases = np.random.default_rng(5), 0, 0, 300
    for case in range(cases):
        right, groups = clustered(rng)
        every = np.full(len(right), True)
        for by, counter in ((groups, "clusters"), (np.arange(len(groups)), "rows")):
            weights = stats.cluster_weights(by, resamples=300, seed=case)
            found = stats.interval(
                lambda w, y=right, k=every: metrics.accuracy(y, k, weights=w), weights
            )
            hit = found.low <= 0.5 <= found.high
            hits, naive_hits = (
                hits + (hit and counter == "clusters"),
                naive_hits + (hit and counter == "rows"),
            )
    assert 0.90 <= hits / cases <= 0.985
    assert naive_hits < hits


def test_correlated_clusters_widen_the_interval():
    right, groups = clustered(np.random.default_rng(2), shared=3.0)
    every = np.full(len(right), True)

    def width(by):
        found = stats.interval(
            lambda w: metrics.accuracy(right, every, weights=w), stats.cluster_weights(by)
        )
        return found.high - found.low

    assert width(groups) > 1.5 * width(np.arange(len(groups)))


def test_intervals_of_every_metric_at_once():
    rng = np.random.default_rng(4)
    reference = rng.random(200) < 0.5
    confidence = np.clip(0.3 * reference + 0.7 * rng.random(200), 0, 1)
    weights = stats.cluster_weights(np.arange(200) // 2)
    found = stats.intervals(
        lambda w: metrics.evaluate_labels(reference, confidence, weights=w), weights
    )
    assert found["auc"] == stats.interval(
        lambda w: metrics.auc(reference, confidence, weights=w), weights
    )
    assert all(
        one.low <= one.value <= one.high for name, one in found.items() if "calibration" not in name
    )
    assert set(found) == set(metrics.evaluate_labels(reference, confidence))


def test_a_metric_without_weighted_form_has_a_value_and_no_interval():
    found = stats.intervals(lambda w: {"a": np.array(0.5)} if w is None else {}, np.ones((10, 3)))
    assert found["a"].value == 0.5
    assert np.isnan([found["a"].low, found["a"].high]).all()


def test_an_undefined_metric_has_no_interval():
    nothing = np.full(5, False)
    weights = stats.cluster_weights(np.arange(5))
    found = stats.interval(lambda w: metrics.precision(~nothing, nothing, weights=w), weights)
    assert np.isnan(found).all()


@pytest.mark.parametrize(("successes", "trials"), [(0, 10), (8, 10), (10, 10), (82, 100), (1, 3)])
def test_wilson_agrees_with_scipy(successes, trials):
    expected = binomtest(successes, trials).proportion_ci(method="wilson")
    found = stats.wilson(successes, trials)
    assert found == pytest.approx((successes / trials, expected.low, expected.high), abs=1e-12)


def test_wilson_without_trials_and_with_too_many_successes():
    assert np.isnan(stats.wilson(0, 0).value)
    assert stats.wilson(0, 0)[1:] == (0.0, 1.0)
    with pytest.raises(BadValue, match="more successes"):
        stats.wilson(4, 3)


def pair(rng, *, clusters=60, rows=3, better=0.0):
    """Draw two classifiers' confidences that share their cluster's difficulty; the first is better
    by `better`."""
    groups = np.repeat(np.arange(clusters), rows)
    reference = rng.random(len(groups)) < 0.5
    signal = 2.0 * reference + rng.normal(size=clusters)[groups]
    first = (
        (1 + better) * signal
        + rng.normal(size=clusters)[groups]
        + 0.5 * rng.normal(size=len(groups))
    )
    second = signal + rng.normal(size=clusters)[groups] + 0.5 * rng.normal(size=len(groups))
    return reference, first, second, groups


auc_test = partial(stats.paired_test, metrics.auc, shares=metrics.auc_shares)


@pytest.mark.parametrize("name", ["auc", "balanced_accuracy"])
def test_no_difference_is_found_where_there_is_none(name):
    rng, cases, found = np.random.default_rng(8), 300, 0
    for case in range(cases):
        reference, first, second, groups = pair(rng)
        if name == "balanced_accuracy":
            first, second = first > 1, second > 1
        result = stats.paired_test(
            getattr(metrics, name),
            reference,
            shares=getattr(metrics, f"{name}_shares"),
            first=first,
            second=second,
            groups=groups,
            weights=np.ones((2, len(groups))),
            ranked=name == "auc",
            swaps=199,
            seed=case,
        )
        found += result.p <= 0.05
    assert 0.02 <= found / cases <= 0.09


@pytest.mark.parametrize("name", ["auc", "balanced_accuracy"])
def test_swapping_is_linear_in_the_shares(name):
    rng = np.random.default_rng(4)
    reference, first, second, _ = pair(rng, clusters=12)
    first, second = (
        (first > 1, second > 1) if name == "balanced_accuracy" else (first.round(), second.round())
    )
    metric, shares = (
        getattr(metrics, name),
        getattr(metrics, f"{name}_shares")(reference, first, second),
    )
    assert len(set(first)) < len(first)
    for _ in range(20):
        swap = rng.integers(2, size=len(reference)).astype(bool)
        one, other = np.where(swap, second, first), np.where(swap, first, second)
        expected = metric(reference, one) - metric(reference, other)
        assert np.where(swap, -shares, shares).sum() == pytest.approx(expected, abs=1e-12)


def test_the_p_value_counts_literal_swaps():
    reference, first, second, groups = pair(np.random.default_rng(11), clusters=30, better=0.3)
    found = stats.paired_test(
        metrics.auc,
        reference,
        shares=metrics.auc_shares,
        first=first,
        second=second,
        groups=groups,
        swaps=4000,
    )
    rng, extreme, swaps = np.random.default_rng(0), 0, 1500
    for _ in range(swaps):
        swap = rng.integers(2, size=30).astype(bool)[groups]
        one, other = np.where(swap, second, first), np.where(swap, first, second)
        extreme += abs(metrics.auc(reference, one) - metrics.auc(reference, other)) >= abs(
            found.value
        )
    assert 0.02 < found.p < 0.9
    assert found.p == pytest.approx(extreme / swaps, abs=4 * np.sqrt(0.25 / swaps))


def test_a_real_difference_is_found():
    reference, first, second, groups = pair(np.random.default_rng(3), clusters=200, better=2.0)
    one = auc_test(reference, first=first, second=second, groups=groups, ranked=True)
    other = auc_test(reference, first=second, second=first, groups=groups, ranked=True)
    assert one.p < 0.01
    assert 0 < one.low < one.value < one.high
    assert one.value == metrics.auc(reference, first) - metrics.auc(reference, second)
    assert (other.value, other.low, other.high) == pytest.approx((-one.value, -one.high, -one.low))


def test_the_scale_of_a_classifier_does_not_matter_if_ranked():
    reference, first, second, groups = pair(np.random.default_rng(6))
    case = {"second": second, "groups": groups, "ranked": True}
    plain = auc_test(reference, first=first, **case)
    assert auc_test(reference, first=100 * first - 3, **case) == plain


def test_a_classifier_does_not_differ_from_itself():
    reference, first, _, groups = pair(np.random.default_rng(6))
    assert auc_test(reference, first=first, second=first, groups=groups) == (0, 0, 0, 1)


def test_pairing_narrows_the_difference():
    reference, first, second, groups = pair(np.random.default_rng(9), clusters=200)
    weights = stats.cluster_weights(groups)
    paired = auc_test(reference, first=first, second=second, groups=groups, weights=weights)
    single = stats.interval(lambda w: metrics.auc(reference, first, weights=w), weights)
    assert paired.high - paired.low < np.sqrt(2) * (single.high - single.low)


def test_unequal_columns_are_refused():
    rows = np.full(4, True)
    with pytest.raises(BadValue, match="second=3 rows"):
        auc_test(rows, first=rows, second=rows[:3], groups=np.arange(4))
    with pytest.raises(BadValue, match="no rows"):
        stats.cluster_weights(np.empty(0))


def test_holm_by_hand():
    found = stats.holm(np.array([0.01, 0.04, 0.03, 0.005]))
    np.testing.assert_allclose(found, [0.03, 0.06, 0.06, 0.02])


def test_holm_stops_at_one_and_skips_what_was_not_tested():
    np.testing.assert_allclose(stats.holm(np.array([0.6, np.nan, 0.5])), [1.0, np.nan, 1.0])
    assert stats.holm(np.empty(0)).shape == (0,)
