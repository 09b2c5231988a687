"""Golden numbers by hand for every metric, scikit-learn as the oracle, and what empty input gives."""

import numpy as np
import pytest
from sklearn import metrics as oracle
from sklearn.calibration import calibration_curve

from echolearn.checks import BadValue
from echolearn.evaluation import metrics

REFERENCE = np.array([True, True, True, False, False, True, False, False])
CONFIDENCE = np.array([0.9, 0.8, 0.3, 0.7, 0.2, 0.6, 0.6, 0.1])
KEPT = CONFIDENCE >= 0.5  # 3 true and 2 false kept, 1 true and 2 false dropped
JUDGED = {
    metrics.precision: 3 / 5,
    metrics.recall: 3 / 4,
    metrics.specificity: 2 / 4,
    metrics.accuracy: 5 / 8,
    metrics.balanced_accuracy: (3 / 4 + 2 / 4) / 2,
    metrics.f1: 2 * 3 / (2 * 3 + 2 + 1),
}
RATES = list(JUDGED)
RANKED = [metrics.auc, metrics.average_precision, metrics.expected_calibration_error]


@pytest.fixture
def rows():
    rng = np.random.default_rng(7)
    reference = rng.random(300) < 0.4
    confidence = 1 / (1 + np.exp(-(2.0 * reference - 1 + rng.normal(size=300))))
    return reference, confidence, rng.integers(0, 4, size=(5, 300))


def test_confusion_by_hand():
    assert [float(n) for n in metrics.confusion(REFERENCE, KEPT)] == [3, 2, 1, 2]


def test_a_row_at_the_threshold_is_kept():
    assert metrics.kept(np.array([0.49, 0.5, 0.51]), 0.5).tolist() == [False, True, True]


@pytest.mark.parametrize(("metric", "expected"), list(JUDGED.items()))
def test_rates_by_hand(metric, expected):
    assert metric(REFERENCE, KEPT) == pytest.approx(expected)


def test_auc_by_hand():
    # Spurious rows beaten: 0.9 -> 4, 0.8 -> 4, 0.6 -> 2 and a tie, 0.3 -> 2.
    assert metrics.auc(REFERENCE, CONFIDENCE) == pytest.approx((4 + 4 + 2.5 + 2) / 16)


def test_average_precision_by_hand():
    # Kept at 0.9: 1/1, at 0.8: 2/2, at 0.6 (two rows, one true): 3/5, at 0.3: 4/6; each adds a quarter of recall.
    assert metrics.average_precision(REFERENCE, CONFIDENCE) == pytest.approx(
        (1 + 1 + 3 / 5 + 4 / 6) / 4
    )


def test_pr_curve_by_hand():
    precision, recall, threshold = metrics.pr_curve(REFERENCE, CONFIDENCE)
    np.testing.assert_allclose(threshold, [0.9, 0.8, 0.7, 0.6, 0.3, 0.2, 0.1])
    np.testing.assert_allclose(precision, [1, 1, 2 / 3, 3 / 5, 4 / 6, 4 / 7, 4 / 8])
    np.testing.assert_allclose(recall, [1 / 4, 2 / 4, 2 / 4, 3 / 4, 1, 1, 1])


def test_calibration_by_hand():
    reference = np.array([False, True, True, True])
    confidence = np.array([0.1, 0.3, 0.5, 1.0])
    centre, mean, observed, count = metrics.reliability_curve(reference, confidence, bins=2)
    np.testing.assert_allclose(centre, [0.25, 0.75])
    np.testing.assert_allclose(mean, [0.2, 0.75])
    np.testing.assert_allclose(observed, [0.5, 1.0])
    np.testing.assert_allclose(count, [2, 2])
    error = metrics.expected_calibration_error(reference, confidence, bins=2)
    assert error == pytest.approx((2 * 0.3 + 2 * 0.25) / 4)


def test_empty_bins_are_nan_and_count_zero():
    _, mean, observed, count = metrics.reliability_curve(
        np.array([True]), np.array([0.95]), bins=10
    )
    assert np.isnan(mean[:9]).all() and np.isnan(observed[:9]).all()
    assert count.tolist() == [0] * 9 + [1]


def test_errors_by_hand():
    error = np.array([0.4, 0.1, 9.0, 0.2, 0.3])
    kept = np.array([True, True, False, True, True])
    assert metrics.error_mean(error, kept) == pytest.approx(0.25)
    assert metrics.error_quantile(error, kept, share=0.5) == 0.2
    assert metrics.error_quantile(error, kept, share=0.95) == 0.4


def test_quantile_share_is_exact_at_whole_counts():
    error = np.arange(1.0, 101.0)
    for percent in range(1, 101):
        assert metrics.error_quantile(error, np.full(100, True), share=percent / 100) == percent


def test_labels_agree_with_scikit_learn(rows):
    reference, confidence, _ = rows
    kept = confidence >= 0.5
    found = metrics.evaluate_labels(reference, confidence)
    expected = {
        "auc": oracle.roc_auc_score(reference, confidence),
        "average_precision": oracle.average_precision_score(reference, confidence),
        "accuracy": oracle.accuracy_score(reference, kept),
        "balanced_accuracy": oracle.balanced_accuracy_score(reference, kept),
        "precision": oracle.precision_score(reference, kept),
        "recall": oracle.recall_score(reference, kept),
        "specificity": oracle.recall_score(~reference, ~kept),
        "f1": oracle.f1_score(reference, kept),
    }
    assert {name: float(found[name]) for name in expected} == pytest.approx(expected)
    assert set(found) == {*expected, "expected_calibration_error"}


def test_curves_agree_with_scikit_learn(rows):
    reference, confidence, _ = rows
    observed, mean = calibration_curve(reference, confidence, n_bins=10)
    _, found_mean, found_observed, count = metrics.reliability_curve(reference, confidence)
    np.testing.assert_allclose(found_mean[count > 0], mean)
    np.testing.assert_allclose(found_observed[count > 0], observed)
    error = metrics.expected_calibration_error(reference, confidence)
    assert error == pytest.approx(count[count > 0] @ np.abs(mean - observed) / 300)
    precision, recall, threshold = metrics.pr_curve(reference, confidence)
    expected = oracle.precision_recall_curve(reference, confidence)
    np.testing.assert_allclose(precision, expected[0][-2::-1])
    np.testing.assert_allclose(recall, expected[1][-2::-1])
    np.testing.assert_allclose(threshold, expected[2][::-1])


@pytest.mark.parametrize("metric", RATES + RANKED)
@pytest.mark.parametrize("digits", [1, 9], ids=["ties", "no ties"])
def test_weights_are_repeated_rows(metric, digits, rows):
    reference, confidence, weights = rows
    estimated = confidence.round(digits) if metric in RANKED else confidence >= 0.5
    found = metric(reference, estimated, weights=weights)
    repeated = [metric(np.repeat(reference, row), np.repeat(estimated, row)) for row in weights]
    np.testing.assert_allclose(found, repeated, rtol=1e-12)
    np.testing.assert_allclose(
        metric(reference, estimated, weights=np.ones((2, 300))), metric(reference, estimated)
    )


@pytest.mark.parametrize("metric", [metrics.error_mean, metrics.error_quantile])
def test_weights_of_errors_are_repeated_points(metric, rows):
    kept, error, weights = rows
    repeated = [metric(np.repeat(error, row), np.repeat(kept, row)) for row in weights]
    np.testing.assert_allclose(metric(error, kept, weights=weights), repeated, rtol=1e-12)


@pytest.mark.parametrize("metric", RATES + RANKED)
def test_no_rows_give_nan(metric):
    estimated = np.empty(0, dtype=float if metric in RANKED else bool)
    assert np.isnan(metric(np.empty(0, dtype=bool), estimated))
    assert (
        np.isnan(metric(np.empty(0, dtype=bool), estimated, weights=np.ones((3, 0)))).tolist()
        == [True] * 3
    )


def test_one_class_only():
    true, kept, nothing = np.array([True, True]), np.array([True, False]), np.array([False, False])
    assert np.isnan(metrics.auc(true, np.array([0.2, 0.9])))
    assert np.isnan(metrics.specificity(true, kept)) and np.isnan(
        metrics.balanced_accuracy(true, kept)
    )
    assert np.isnan(metrics.average_precision(~true, np.array([0.2, 0.9])))
    assert np.isnan(metrics.recall(~true, kept)) and np.isnan(metrics.f1(~true, nothing))
    assert np.isnan(metrics.precision(true, nothing))
    assert metrics.f1(true, nothing) == 0.0


def test_draws_without_a_class_are_nan_and_do_not_spoil_the_others():
    weights = np.array([[1, 1, 1, 1, 1, 1, 1, 1], [1, 1, 1, 0, 0, 1, 0, 0]])
    assert np.isnan(metrics.auc(REFERENCE, CONFIDENCE, weights=weights)).tolist() == [False, True]


@pytest.mark.parametrize(
    ("reference", "estimated", "weights", "words"),
    [
        (REFERENCE.astype(int), KEPT, None, "class 0"),
        (REFERENCE, KEPT[:5], None, "rows of different sets"),
        (REFERENCE, CONFIDENCE, None, "threshold first"),
        (REFERENCE, np.full(8, np.nan), None, "NaN"),
        (REFERENCE, KEPT, np.ones((3, 5)), "weights"),
    ],
)
def test_bad_columns_are_named(reference, estimated, weights, words):
    with pytest.raises(BadValue, match=words):
        metrics.accuracy(reference, estimated, weights=weights)


def test_a_logit_is_no_confidence():
    with pytest.raises(BadValue, match="logit"):
        metrics.evaluate_labels(REFERENCE, 4 * CONFIDENCE)
    assert metrics.auc(REFERENCE, 4 * CONFIDENCE - 9) == metrics.auc(REFERENCE, CONFIDENCE)


CORNERS = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]])
POSES = np.array([[4.0, 1.5], [6.5, 3.0], [4.0, 3.0], [4.0, 4.9]])
POINTS = np.array([[4.0, 0.05], [7.9, 3.0], [4.0, 2.0], [4.0, 6.3]])  # off by 0.05, 0.1, 2.0, 0.3 m


def judge(**changes):
    case = {
        "kept": np.array([True, True, False, True]),
        "confidence": np.array([0.9, 0.7, 0.2, 0.8]),
        "poses": POSES,
    } | changes
    return metrics.evaluate_map(CORNERS, POINTS, **case)


def test_map_by_hand():
    found = judge()
    expected = {
        "precision": 2 / 3,
        "true_retention": 1.0,
        "spurious_removal": 1 / 2,
        "balanced_accuracy": 3 / 4,
        "f1": 4 / 5,
        "average_precision": (1 + 2 / 3) / 2,
        "expected_calibration_error": (0.1 + 0.3 + 0.2 + 0.8) / 4,
        "error_mean": 0.15,
        "error_median": 0.1,
        "error_p95": 0.3,
    }
    assert {name: float(found[name]) for name in expected} == pytest.approx(expected)
    assert set(found) - set(expected) == {"wall_coverage", "nearest_neighbour_error"}


def test_a_point_at_the_tolerance_is_true():
    on, off = np.array([[4.0, 0.1]]), np.array([[4.0, 0.1001]])
    case = {"kept": np.array([True]), "confidence": np.array([0.5]), "poses": POSES}
    assert metrics.evaluate_map(CORNERS, on, **case)["precision"] == 1.0
    assert metrics.evaluate_map(CORNERS, off, **case)["precision"] == 0.0


def test_a_map_that_keeps_nothing():
    found = judge(kept=np.full(4, False))
    undefined = {"precision", "error_mean", "error_median", "error_p95", "nearest_neighbour_error"}
    assert {name for name, value in found.items() if np.isnan(value)} == undefined
    assert (found["true_retention"], found["spurious_removal"], found["wall_coverage"]) == (
        0.0,
        1.0,
        0.0,
    )


def test_weighted_map_has_a_value_for_each_set_of_weights():
    weights = np.array([[1, 1, 1, 1], [2, 0, 1, 0]])
    found = judge(weights=weights)
    assert "wall_coverage" not in found
    assert found["precision"].tolist() == pytest.approx([2 / 3, 1.0])
    assert found["error_mean"].tolist() == pytest.approx([0.15, 0.05])


def test_a_map_turned_with_its_room_is_judged_the_same():
    angle, shift = 0.7, np.array([3.0, -2.0])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    case = {
        "kept": np.array([True, True, False, True]),
        "confidence": np.array([0.9, 0.7, 0.2, 0.8]),
    }
    points = POINTS + np.array([[0, 0], [0.02, 0], [0, 0], [0, 0]])
    here = metrics.evaluate_map(CORNERS, points, poses=POSES, **case)
    there = metrics.evaluate_map(
        CORNERS @ turn.T + shift, points @ turn.T + shift, poses=POSES @ turn.T + shift, **case
    )
    assert {k: float(v) for k, v in there.items()} == pytest.approx(
        {k: float(v) for k, v in here.items()}
    )
