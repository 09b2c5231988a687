"""Tests must not cry wolf, and must find what is there: simulations, literal swaps, by hand."""

import numpy as np
import pytest
from scipy.stats import rankdata

from echolearn.checks import BadValue
from echolearn.evaluation import metrics, pairs, stats
from echolearn.evaluation.rows import LabelledRows, Predictions, Recordings


def exam(seed, *, clusters=60, better=0.0, resamples=200):
    """Draw rows and two models' answers that share their cluster's difficulty; the first is
    `better`."""
    rng = np.random.default_rng(seed)
    groups = np.repeat(np.arange(clusters), 3)
    reference = rng.random(len(groups)) < 0.5
    signal = 2.0 * reference + rng.normal(size=clusters)[groups]
    answers = []
    for strength in (1 + better, 1.0):
        own = rng.normal(size=clusters)[groups] + 0.5 * rng.normal(size=len(groups))
        answers.append(signal + own / strength)
    weights = stats.cluster_weights(groups, resamples=resamples)
    return LabelledRows(Recordings("", "set"), reference, groups, 0.0 * groups, weights), *answers


def says(answers, seed=0):
    return Predictions(seed, np.arange(len(answers)), np.array(answers, dtype=float), 1.0)


def paired(labelled, first, second, metric="auc"):
    about = {"labelled": labelled, "metric": metric}
    return pairs.paired_difference([says(first)], [says(second)], **about)


@pytest.mark.parametrize("metric", pairs.PAIRED)
def test_no_difference_is_found_where_there_is_none(metric, monkeypatch):
    monkeypatch.setattr(pairs, "SWAPS", 199)
    found = [paired(*exam(case, resamples=2), metric)["p"] <= 0.05 for case in range(300)]
    assert 0.02 <= np.mean(found) <= 0.09


@pytest.mark.parametrize("metric", pairs.PAIRED)
def test_swapping_is_linear_in_the_shares(metric):
    labelled, *answers = exam(4, clusters=12)
    reference = labelled.reference
    first, second = (rankdata(each.round()) if metric == "auc" else each > 1 for each in answers)
    value, shares_of, _ = pairs.PAIRED[metric]
    shares = shares_of(reference, first=first, second=second)
    for swap in np.random.default_rng(0).integers(2, size=(20, 36)).astype(bool):
        one, other = np.where(swap, second, first), np.where(swap, first, second)
        expected = value(reference, one) - value(reference, other)
        assert np.where(swap, -shares, shares).sum() == pytest.approx(expected, abs=1e-12)


def test_the_p_value_counts_literal_swaps():
    labelled, *answers = exam(11, clusters=30, better=0.3)
    first, second = map(rankdata, answers)
    found = paired(labelled, first, second)
    extreme = 0
    for swap in np.random.default_rng(0).integers(2, size=(1500, 30)).astype(bool):
        each = swap[labelled.groups]
        one, other = np.where(each, second, first), np.where(each, first, second)
        reference = labelled.reference
        difference = metrics.auc(reference, one) - metrics.auc(reference, other)
        extreme += abs(difference) >= abs(found["difference"])
    assert 0.02 < found["p"] < 0.9
    assert found["p"] == pytest.approx(extreme / 1500, abs=4 * np.sqrt(0.25 / 1500))


@pytest.mark.parametrize("metric", pairs.PAIRED)
def test_a_real_difference_is_found_and_pairing_narrows_it(metric):
    labelled, first, second = exam(3, clusters=200, better=9.0)
    one = paired(labelled, first, second, metric)
    other = paired(labelled, second, first, metric)
    assert one["p"] < 0.01 and one["n"] == 200 and one["metric"] == metric
    assert 0 < one["ci_low"] < one["difference"] < one["ci_high"]
    turned = [-one[key] for key in ("difference", "ci_high", "ci_low")]
    assert [other[key] for key in ("difference", "ci_low", "ci_high")] == pytest.approx(turned)
    value, _, answers = pairs.PAIRED[metric]
    alone, *both = (getattr(says(each), answers) for each in (first, first, second))
    values = [value(labelled.reference, each) for each in both]
    assert one["difference"] == pytest.approx(values[0] - values[1])
    single = stats.interval(lambda w: value(labelled.reference, alone, weights=w), labelled.weights)
    assert one["ci_high"] - one["ci_low"] < np.sqrt(2) * (single.high - single.low)


def test_the_scale_of_a_model_does_not_matter():
    labelled, first, second = exam(6)
    assert paired(labelled, 100 * first - 3, second) == paired(labelled, first, second)
    same = paired(labelled, first, first)
    assert [same[key] for key in ("difference", "ci_low", "ci_high", "p")] == [0, 0, 0, 1]


def test_what_is_undefined_has_no_p_value():
    labelled, first, second = exam(6)
    labelled.reference[:] = True
    assert np.isnan(paired(labelled, first, second)["p"])


@pytest.mark.parametrize(
    ("first", "second", "common"),
    [((0, 1, 2), (2, 1), ((1, 2), (2, 1))), ((0, 1), (7,), ((0, 1), (7,)))],
    ids=["common seeds", "a lone seed meets all"],
)
def test_the_difference_is_that_of_the_means(first, second, common):
    labelled, *_ = exam(1)

    def noisy(noise, seeds):
        found = []
        for seed in seeds:
            own = np.random.default_rng([seed, noise]).normal(size=180)
            found.append(says(2.0 * labelled.reference + noise * own, seed))
        return found

    about = {"labelled": labelled, "metric": "balanced_accuracy"}
    found = pairs.paired_difference(noisy(1, first), noisy(3, second), **about)
    means = []
    for noise, seeds in zip((1, 3), common, strict=True):
        each = [
            metrics.balanced_accuracy(labelled.reference, given.kept)
            for given in noisy(noise, seeds)
        ]
        means.append(np.mean(each))
    assert found["difference"] == pytest.approx(means[0] - means[1])


def test_without_a_common_seed_there_is_nothing_to_pair():
    labelled, first, second = exam(1)
    with pytest.raises(BadValue, match=r"^seeds=\[0, 1\]: must have one at least"):
        pairs.paired_difference(
            [says(first), says(first, 1)],
            [says(second, 2), says(second, 3)],
            labelled=labelled,
            metric="auc",
        )


def test_rows_of_one_position_swap_together():
    """Ten rows in two positions leave four swaps, half of them as far apart as the data."""
    reference = np.array([True] * 5 + [False] * 5)
    ones = np.ones((1, 10))
    two = LabelledRows(Recordings("", "set"), reference, np.array([0, 1] * 5), ones[0], ones)
    found = paired(two, reference, ~reference, "balanced_accuracy")
    assert (found["difference"], found["n"]) == (1.0, 2)
    assert found["p"] == pytest.approx(0.5, abs=0.07)


def test_holm_counts_the_tests_of_the_same_metric_and_training():
    tests = []
    for metric, training, *values in (
        ("auc", "a", 0.01, 0.04, 0.03),
        ("auc", "b", 0.5),
        ("balanced_accuracy", "a", 0.5),
    ):
        tests += [{"metric": metric, "training": training, "p": p} for p in values]
    corrected = [row["p_holm"] for row in pairs.correct(tests)]
    assert corrected == pytest.approx([0.03, 0.06, 0.06, 0.5, 0.5])
    assert "p_holm" not in tests[0]


def test_the_smallest_p_value_is_significant_among_eighty_tests():
    assert 80 / (1 + pairs.SWAPS) < 0.02
