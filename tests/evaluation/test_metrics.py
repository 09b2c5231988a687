"""Golden numbers by hand for every metric, scikit-learn as the oracle, what empty input gives."""

from functools import partial

import numpy as np
import pytest
from sklearn import metrics as oracle
from sklearn.calibration import calibration_curve

from echolearn.acoustics.sides import closed
from echolearn.checks import BadValue
from echolearn.evaluation import map_metrics, metrics

REFERENCE = np.array([True, True, True, False, False, True, False, False])
CONFIDENCE = np.array([0.9, 0.8, 0.3, 0.7, 0.2, 0.6, 0.6, 0.1])
KEPT = CONFIDENCE >= 0.5  # 3 true and 2 false kept, 1 true and 2 false dropped
LABELS = partial(metrics.evaluate_labels, threshold=0.5)
ERRORS = [map_metrics.error_mean, partial(map_metrics.error_quantile, share=0.5)]


@pytest.fixture
def rows():
    rng = np.random.default_rng(7)
    reference = rng.random(300) < 0.4
    confidence = 1 / (1 + np.exp(-(2.0 * reference - 1 + rng.normal(size=300))))
    return reference, confidence, rng.integers(0, 4, size=(5, 300))


def test_labels_by_hand():
    """AUC: spurious rows beaten are 4, 4, 2 and a tie, 2. Average precision: kept at 0.9, 0.8, 0.6
    (two rows, one true) and 0.3, each adds a quarter of recall. Calibration: rows stand alone in
    their bin, but for the two at 0.6."""
    expected = {
        "accuracy": 5 / 8,
        "balanced_accuracy": (3 / 4 + 2 / 4) / 2,
        "precision": 3 / 5,
        "recall": 3 / 4,
        "specificity": 2 / 4,
        "f1": 2 * 3 / (2 * 3 + 2 + 1),
        "auc": (4 + 4 + 2.5 + 2) / 16,
        "average_precision": (1 + 1 + 3 / 5 + 4 / 6) / 4,
        "expected_calibration_error": (0.1 + 0.2 + 0.7 + 0.7 + 0.2 + 2 * 0.1 + 0.1) / 8,
    }
    found = LABELS(REFERENCE, CONFIDENCE)
    assert {name: float(value) for name, value in found.items()} == pytest.approx(expected)
    assert metrics.auc(REFERENCE, CONFIDENCE) == found["auc"]
    assert metrics.balanced_accuracy(REFERENCE, KEPT) == found["balanced_accuracy"]


def test_the_filter_keeps_from_the_threshold_on():
    assert metrics.kept(np.array([0.49, 0.5, 0.51]), 0.5).tolist() == [False, True, True]


def test_reliability_by_hand():
    """A bin holds its lower edge, the last one its upper, too; empty bins are NaN."""
    reference = np.array([False, True, True, True])
    mean, observed = metrics.reliability_curve(reference, np.array([0.1, 0.15, 0.95, 1.0]))
    np.testing.assert_allclose(mean, [np.nan, 0.125, *[np.nan] * 7, 0.975])
    np.testing.assert_allclose(observed, [np.nan, 0.5, *[np.nan] * 7, 1.0])


def test_errors_by_hand():
    error = np.array([0.4, 0.1, 9.0, 0.2, 0.3])
    kept = np.array([True, True, False, True, True])
    assert map_metrics.error_mean(error, kept) == pytest.approx(0.25)
    assert map_metrics.error_quantile(error, kept, share=0.5) == 0.2
    assert map_metrics.error_quantile(error, kept, share=0.95) == 0.4


def test_quantile_share_is_exact_at_whole_counts():
    error = np.arange(1.0, 101.0)
    for percent in range(1, 101):
        assert map_metrics.error_quantile(error, np.full(100, True), share=percent / 100) == percent


def test_labels_agree_with_scikit_learn(rows):
    reference, confidence, _ = rows
    kept = confidence >= 0.5
    found = LABELS(reference, confidence)
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


def test_curves_agree_with_scikit_learn(rows):
    reference, confidence, _ = rows
    observed, mean = calibration_curve(reference, confidence, n_bins=10)
    found_mean, found_observed = metrics.reliability_curve(reference, confidence)
    filled = np.isfinite(found_mean)
    np.testing.assert_allclose(found_mean[filled], mean)
    np.testing.assert_allclose(found_observed[filled], observed)
    count, _ = np.histogram(confidence, bins=10, range=(0, 1))
    error = metrics.expected_calibration_error(reference, confidence)
    assert error == pytest.approx(count[filled] @ np.abs(mean - observed) / 300)
    expected = oracle.precision_recall_curve(reference, confidence)
    for found, other in zip(metrics.pr_curve(reference, confidence), expected, strict=False):
        np.testing.assert_allclose(found, other[-2::-1])


@pytest.mark.parametrize("digits", [1, 9], ids=["ties", "no ties"])
def test_weights_are_repeated_rows(digits, rows):
    reference, confidence, weights = rows
    confidence = confidence.round(digits)
    found = LABELS(reference, confidence, weights=weights)
    for number, row in enumerate(weights):
        again = LABELS(np.repeat(reference, row), np.repeat(confidence, row))
        for name, value in again.items():
            assert found[name][number] == pytest.approx(float(value), rel=1e-12), name
    ones = LABELS(reference, confidence, weights=np.ones((2, 300)))
    for name, value in LABELS(reference, confidence).items():
        np.testing.assert_allclose(ones[name], value)


@pytest.mark.parametrize("metric", ERRORS)
def test_weights_of_errors_are_repeated_points(metric, rows):
    kept, error, weights = rows
    repeated = [metric(np.repeat(error, row), np.repeat(kept, row)) for row in weights]
    np.testing.assert_allclose(metric(error, kept, weights=weights), repeated, rtol=1e-12)


def test_no_rows_give_nan():
    empty = np.empty(0)
    for name, value in LABELS(empty.astype(bool), empty).items():
        assert np.isnan(value), name
    for name, value in LABELS(empty.astype(bool), empty, weights=np.ones((3, 0))).items():
        assert np.isnan(value).tolist() == [True] * 3, name


def undefined(reference, confidence):
    found = LABELS(np.array(reference), np.array(confidence))
    return {name for name, value in found.items() if np.isnan(value)}


def test_one_class_only():
    assert undefined([True] * 2, [0.2, 0.9]) == {"auc", "specificity", "balanced_accuracy"}
    false = {"auc", "average_precision", "recall", "balanced_accuracy"}
    assert undefined([False] * 2, [0.2, 0.9]) == false
    assert undefined([False] * 2, [0.2, 0.3]) == false | {"precision", "f1"}
    assert undefined([True, False], [0.2, 0.3]) == {"precision"}
    assert LABELS(np.array([True, False]), np.array([0.2, 0.3]))["f1"] == 0.0


def test_draws_without_a_class_are_nan_and_do_not_spoil_the_others():
    weights = np.array([[1, 1, 1, 1, 1, 1, 1, 1], [1, 1, 1, 0, 0, 1, 0, 0]])
    assert np.isnan(metrics.auc(REFERENCE, CONFIDENCE, weights=weights)).tolist() == [False, True]


@pytest.mark.parametrize(
    ("reference", "estimated", "weights", "message"),
    [
        (REFERENCE.astype(int), KEPT, None, "class 0"),
        (REFERENCE, KEPT[:5], None, "rows of different sets"),
        (REFERENCE, CONFIDENCE, None, "threshold first"),
        (REFERENCE, np.full(8, np.nan), None, "NaN"),
        (REFERENCE, KEPT, np.ones((3, 5)), "weights"),
    ],
)
def test_bad_columns_are_named(reference, estimated, weights, message):
    with pytest.raises(BadValue, match=message):
        metrics.rates(reference, estimated, weights=weights)


def test_a_logit_is_no_confidence():
    with pytest.raises(BadValue, match="logit"):
        LABELS(REFERENCE, 4 * CONFIDENCE)
    assert metrics.auc(REFERENCE, 4 * CONFIDENCE - 9) == metrics.auc(REFERENCE, CONFIDENCE)


WALLS = closed(np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]]))
POSES = np.array([[4.0, 1.5], [6.5, 3.0], [4.0, 3.0], [4.0, 4.9]])
POINTS = np.array([[4.0, 0.05], [7.9, 3.0], [4.0, 2.0], [4.0, 6.3]])  # off by 0.05, 0.1, 2.0, 0.3 m
MAP = {
    "kept": np.array([True, True, False, True]),
    "confidence": np.array([0.9, 0.7, 0.2, 0.8]),
    "poses": POSES,
}


def evaluated(**changes):
    found = map_metrics.evaluate_map(WALLS, POINTS, **MAP | changes)
    return {name: value.tolist() for name, value in found.items()}


def test_map_by_hand():
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
    found = evaluated()
    assert {name: found[name] for name in expected} == pytest.approx(expected)
    assert set(found) - set(expected) == {"wall_coverage", "nearest_neighbour_error"}


def test_a_point_at_the_tolerance_is_true():
    case = {"kept": np.array([True]), "confidence": np.array([0.5]), "poses": POSES}
    for height, share in ((0.1, 1.0), (0.1001, 0.0)):
        found = map_metrics.evaluate_map(WALLS, np.array([[4.0, height]]), **case)
        assert found["precision"] == share


def test_a_map_that_keeps_nothing():
    found = evaluated(kept=np.full(4, False))
    nan = {"precision", "error_mean", "error_median", "error_p95", "nearest_neighbour_error"}
    assert {name for name, value in found.items() if np.isnan(value)} == nan
    assert [found[n] for n in ("true_retention", "spurious_removal", "wall_coverage")] == [0, 1, 0]


def test_weighted_map_has_a_value_for_each_set_of_weights():
    found = evaluated(weights=np.array([[1, 1, 1, 1], [2, 0, 1, 0]]))
    assert set(evaluated()) - set(found) == {"wall_coverage", "nearest_neighbour_error"}
    assert found["precision"] == pytest.approx([2 / 3, 1.0])
    assert found["error_mean"] == pytest.approx([0.15, 0.05])
