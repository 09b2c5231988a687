"""Calibration and cut: Platt's logistic recovered, order kept, thresholds by hand."""

import numpy as np
import pytest

from echolearn.classifiers.calibration import best_threshold, platt


def test_recovers_the_logistic_it_was_drawn_from():
    rng = np.random.default_rng(0)
    decision = rng.normal(3.0, 2.0, 20_000)
    y = rng.random(20_000) < 1 / (1 + np.exp(-(1.5 * decision - 4.0)))
    np.testing.assert_allclose(platt(decision, y), (1.5, -4.0), rtol=0.05)


def test_keeps_the_order_whatever_the_labels_say():
    decision = np.linspace(-50, 50, 201)
    for y in (decision > 0, decision < 0, np.arange(201) % 2 == 0):
        slope, intercept = platt(decision, y)
        assert slope > 0 and np.isfinite(intercept)


def test_survives_perfect_separation_and_constants():
    y = np.arange(40) < 10
    slope, _ = platt(np.where(y, 1.0, -1.0), y)
    assert 0 < slope < 10
    slope, intercept = platt(np.full(40, 1e6 / 3), y)
    assert 1 / (1 + np.exp(-(slope * 1e6 / 3 + intercept))) == pytest.approx(0.25, abs=0.03)


def test_threshold_by_hand():
    confidence = np.array([0.1, 0.2, 0.35, 0.6, 0.8, 0.9])
    assert best_threshold(confidence, np.array([0, 0, 0, 1, 1, 1])) == pytest.approx(0.475)
    assert best_threshold(confidence, np.array([0, 1, 0, 0, 1, 1])) == pytest.approx(0.7)
    assert best_threshold(np.full(4, 0.3), np.array([0, 1, 0, 1])) == 0.5

    # Cuts at 0.2 and 0.75 are equally good; the one nearer to 0.5 is taken.
    alternating = np.array([0, 1, 0, 1])
    assert best_threshold(np.array([0.1, 0.3, 0.6, 0.9]), alternating) == pytest.approx(0.75)
