"""Calibration error: golden numbers, what chance alone makes of it, weights as counts."""

import numpy as np
import pytest

from echolearn.evaluation.reliability import (
    calibration_error,
    curve,
    equal_count,
    evaluate_calibration,
    perfect_error,
)


def test_by_hand():
    """Twenty rows, two in a bin; one bin is off by 0.5 - 0.1, the others by what they are."""
    confidence = np.repeat(np.arange(10) / 10 + 0.05, 2)
    reference = np.tile([False, True], 10)
    errors = np.abs(np.arange(10) / 10 + 0.05 - 0.5)
    assert calibration_error(reference, confidence) == pytest.approx(errors.mean())
    found = curve(reference, confidence)
    np.testing.assert_allclose(found.confidence, np.arange(10) / 10 + 0.05)
    np.testing.assert_allclose(found.share, 0.5)
    np.testing.assert_allclose(found.deviation**2, found.confidence * (1 - found.confidence) / 2)


def test_what_is_as_claimed_has_the_perfect_error_on_average():
    rng = np.random.default_rng(0)
    confidence = rng.beta(0.5, 0.5, 2000)
    errors = [calibration_error(rng.random(2000) < confidence, confidence) for _ in range(400)]
    assert perfect_error(confidence) == pytest.approx(np.mean(errors), rel=0.03)


def test_what_claims_too_much_has_more():
    rng = np.random.default_rng(1)
    chance = rng.random(20_000)
    y = rng.random(20_000) < chance
    bold = np.clip(chance + 0.1, 0, 1)
    assert calibration_error(y, chance) < 0.01
    assert calibration_error(y, bold) == pytest.approx((bold - chance).mean(), abs=0.01)


def test_bins_hold_about_a_tenth_and_do_not_part_equal_confidences():
    rng = np.random.default_rng(2)
    counts = equal_count(rng.random(1003)).sum(axis=0)
    assert counts.min() >= 100 and counts.sum() == 1003
    confidence = rng.integers(0, 4, 200) / 4
    member = equal_count(confidence)
    for value in np.unique(confidence):
        assert len(np.unique(member[confidence == value], axis=0)) == 1
    shuffled = rng.permutation(200)
    y = rng.random(200) < 0.5
    again = calibration_error(y[shuffled], confidence[shuffled])
    assert calibration_error(y, confidence) == pytest.approx(again)


def test_a_weight_counts_as_so_many_equal_rows():
    rng = np.random.default_rng(3)
    confidence, y = rng.random(50), rng.random(50) < 0.5
    weights = np.array([np.ones(50), np.full(50, 3.0), 1.0 * (np.arange(50) < 25)])
    whole, thrice, half = calibration_error(y, confidence, weights=weights)
    assert whole == pytest.approx(thrice) == pytest.approx(calibration_error(y, confidence))
    member = equal_count(confidence)[:25]
    surplus = np.abs(member.T @ (confidence - y)[:25]).sum() / 25
    assert half == pytest.approx(surplus)
    assert {*evaluate_calibration(y, confidence, weights=weights)} == {"calibration_error"}


def test_of_no_rows_there_is_none():
    none = np.empty(0)
    assert np.isnan(calibration_error(none.astype(bool), none)) and perfect_error(none) == 0.0
