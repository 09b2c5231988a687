"""Rows about calibration: by the model's own label, in each 10 dB band."""

import numpy as np
import pytest

from echolearn.evaluation import metrics, stats
from echolearn.evaluation.calibration_rows import score_calibration
from echolearn.evaluation.reliability import calibration_error, perfect_error
from echolearn.evaluation.rows import LabelledRows, Model, Predictions, Recordings, pick

SNR = np.repeat([-35.0, -5.0, 40.0], 40)


@pytest.fixture
def labelled():
    rng = np.random.default_rng(0)
    weights = stats.cluster_weights(np.arange(120), resamples=30)
    about = Recordings("some", kind="set")
    return LabelledRows(about, rng.random(120) < 0.5, np.arange(120), SNR, weights)


@pytest.fixture
def given():
    return Predictions(0, np.arange(120), np.random.default_rng(1).random(120), 0.6)


def test_errors_stand_over_all_rows_and_in_every_band_that_has_some(labelled, given):
    rows = list(score_calibration(Model("some", target="reflector"), [given], labelled=labelled))
    assert {row["metric"] for row in rows} == {"calibration_error", "calibration_error_perfect"}
    errors = {row["snr_db"]: row for row in pick(rows, metric="calibration_error")}
    assert [*errors] == ["", "-40:-30", "-10:0", "30:40"]
    for band, part in {"": SNR < 99, "-10:0": SNR == -5, "30:40": SNR == 40}.items():
        expected = calibration_error(labelled.reference[part], given.confidence[part])
        assert errors[band]["value"] == pytest.approx(expected) and errors[band]["n"] == part.sum()
        assert errors[band]["ci_low"] < errors[band]["ci_high"]
    [perfect] = pick(rows, metric="calibration_error_perfect", snr_db="-10:0")
    assert perfect["value"] == pytest.approx(perfect_error(given.confidence[SNR == -5]))
    assert np.isnan(perfect["ci_low"])


def test_another_label_than_the_papers_has_figures_of_its_own(labelled, given):
    rows = list(score_calibration(Model("some", target="on_map"), [given], labelled=labelled))
    found = {row["metric"]: row["value"] for row in pick(rows, snr_db="")}
    assert found["own_auc"] == pytest.approx(metrics.auc(labelled.reference, given.confidence))
    kept = labelled.reference[given.kept]
    assert found["own_precision"] == pytest.approx(kept.mean())
    assert len(found) == 7
