"""Calibration: the curve recovered that labels were drawn from, order kept, the file the same."""

from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit
from sklearn.isotonic import IsotonicRegression

from echolearn.checks import BadValue
from echolearn.classifiers import inference, onnx_export
from echolearn.classifiers.calibration import METHODS, calibrate, isotonic, mapping_of, platt
from echolearn.classifiers.classifier import Examples
from echolearn.classifiers.methods.threshold import Threshold
from echolearn.classifiers.operating_point import Aim


def bent(rows: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Draw decisions, labels, and the chances by which these were drawn: no logistic."""
    rng = np.random.default_rng(0)
    decision = rng.normal(size=rows)
    chance = 0.2 + 0.6 * (decision > 0.3) + 0.1 * expit(decision)
    return decision, rng.random(rows) < chance, chance


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


def test_temperature_is_a_slope_alone():
    rng = np.random.default_rng(0)
    decision = rng.normal(1.0, 2.0, 20_000)
    y = rng.random(20_000) < expit(0.4 * decision)
    slope, intercept = platt(decision, y, centred=True)
    assert slope == pytest.approx(0.4, rel=0.05) and intercept == 0.0


def test_isotonic_follows_a_curve_that_no_logistic_has():
    decision, y, chance = bent(20_000)
    error = {
        method: np.abs(mapping_of(decision, y, method=method)(decision) - chance).mean()
        for method in METHODS
    }
    assert error["isotonic"] < 0.02 < 0.06 < error["platt"]


def test_isotonic_goes_through_the_middle_of_the_pools_of_another_package():
    decision, y, _ = bent(500)
    found = isotonic(decision, y)
    positives = y.sum()
    target = np.where(y, (positives + 1) / (positives + 2), 1 / (len(y) - positives + 2))
    other = IsotonicRegression().fit_transform(decision, target)
    levels = np.unique(other.round(9))
    np.testing.assert_allclose(found.confidence, levels, atol=2e-9)
    centres = [decision[np.isclose(other, level, atol=1e-9)].mean() for level in levels]
    np.testing.assert_allclose(found.decision, centres)


@pytest.mark.parametrize("method", METHODS)
def test_no_calibration_turns_an_order_round(method):
    decision = np.linspace(-50, 50, 201)
    for y in (decision > 0, decision < 0, np.arange(201) % 2 == 0, np.arange(201) < 1):
        confidence = mapping_of(decision, y, method=method)(decision)
        assert (np.diff(confidence) >= 0).all() and 0 < confidence[0] <= confidence[-1] < 1


@pytest.mark.parametrize("method", METHODS)
def test_the_exported_file_has_the_calibration(method, tmp_path: Path):
    rng = np.random.default_rng(1)
    x = rng.normal(size=(400, 1)).astype(np.float32)
    y = rng.random(400) < expit(3 * x[:, 0])
    x[:50] = x[0]
    examples = Examples(x, y, np.arange(400), validation=(x, y), folder=tmp_path, seed=0)
    fitted = calibrate(Threshold(("score",)).fit(examples), x, y, method=method)
    proved = onnx_export.export_proved(fitted, x)
    assert proved.parity <= 1e-5
    confidence = inference.open_onnx(proved.data)(x)
    assert np.ptp(confidence) > 0.5
    np.testing.assert_allclose(confidence, fitted.confidence(x), atol=1e-6)


def test_an_aim_out_of_reach_is_told_and_the_cut_is_balanced(tmp_path: Path):
    rng = np.random.default_rng(2)
    x = rng.normal(size=(200, 1)).astype(np.float32)
    y = rng.random(200) < 0.5
    examples = Examples(x, y, np.arange(200), validation=(x, y), folder=tmp_path, seed=0)
    model = Threshold(("score",)).fit(examples)
    y[np.argsort(model.decision(x))[-3:]] = False
    fitted = calibrate(model, x, y, aim=Aim("precision", 0.99))
    assert fitted.point == calibrate(model, x, y).point
    assert "aim=precision 0.99: cannot be reached on validation rows; best is 0." in fitted.missed
    assert not calibrate(model, x, y, aim=Aim("retention", 0.99)).missed
    with pytest.raises(BadValue, match="calibration=none: must be platt, temperature or isotonic"):
        calibrate(model, x, y, method="none")
