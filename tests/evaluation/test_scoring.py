"""Rows of results by hand, intervals from hand-made resamples."""

import numpy as np
import pytest

from echolearn.acoustics.sides import closed
from echolearn.evaluation import scoring, stats
from echolearn.evaluation.rows import (
    LabelledRows,
    LocalizedSurvey,
    Model,
    Predictions,
    Recordings,
    to_csv,
)

REFERENCE = np.array([True, True, True, False, False, False])
MODEL = Model("some", "set", "learned", "svm", "position", "reflector")


def labelled(reference, *, snr_db=0.0, weights=None, kind="set"):
    """Return rows of a position each."""
    rows = len(reference)
    if weights is None:
        weights = stats.cluster_weights(np.arange(rows), resamples=60)
    snr_db = np.broadcast_to(snr_db, rows)
    return LabelledRows(Recordings("exam", kind), reference, np.arange(rows), snr_db, weights)


def says(confidence, *, seed=0, rows=None, threshold=0.5):
    confidence = np.array(confidence, dtype=float)
    rows = np.arange(len(confidence)) if rows is None else np.array(rows)
    return Predictions(seed, rows, confidence, threshold)


def values(rows, seed=""):
    """Return the value of each metric."""
    return {row["metric"]: row["value"] for row in rows if row["seed"] == seed}


def scored(*given, reference=REFERENCE, **about):
    """Return the rows of labels by what their column `snr_db` says."""
    found = {}
    for row in scoring.score_labels(MODEL, given, labelled=labelled(reference, **about)):
        found.setdefault(row["snr_db"], []).append(row)
    return found


FIRST = says(
    [0.9, 0.8, 0.4, 0.6, 0.2, 0.1], seed=3
)  # 2 of 3 reflectors kept, 2 of 3 others dropped
SECOND = says([0.9, 0.8, 0.7, 0.3, 0.2, 0.1], seed=8)  # always right


@pytest.mark.parametrize(
    ("split", "target", "title"),
    [
        ("position", "reflector", "grid"),
        ("position", "on_map", "grid (on_map)"),
        ("row", "reflector", "grid (row split)"),
        ("row", "on_map", "grid (on_map, row split)"),
    ],
)
def test_what_is_unusual_about_a_training_is_said(split, target, title):
    assert Model("svm", "grid", split=split, target=target).training == title
    assert Model("chance").training == "-"


def test_csv_by_hand():
    rows = [
        {"a": 1 / 3, "b": "x,y", "c": 2, "d": 0},
        {"a": float("nan"), "b": "", "c": np.float64(1e-9), "d": 0},
    ]
    assert to_csv(rows, ["b", "a", "c"]) == b'b,a,c\n"x,y",0.333333,2\n,,0.0\n'
    assert to_csv([], ["a", "b"]) == b"a,b\n"


def test_a_row_per_seed_and_their_mean():
    rows = scored(FIRST, SECOND)[""]
    one, other, mean = (values(rows, seed) for seed in (3, 8, ""))
    assert (one["accuracy"], other["accuracy"]) == pytest.approx((4 / 6, 1.0))
    assert one["auc"] == pytest.approx(8 / 9), "0.4 ranks below 0.6"
    for metric in mean:
        assert mean[metric] == pytest.approx((one[metric] + other[metric]) / 2)
    for row in rows:
        assert row.items() >= (MODEL.columns() | Recordings("exam", "set")._asdict()).items()
        assert (row["ci_low"] == "") == (row["seed"] != "")
    assert {row["seed"] for row in scored(FIRST)[""]} == {""}, "a lone seed is the mean"


def test_what_one_seed_leaves_undefined_has_no_mean():
    rows = scored(FIRST, says(np.zeros(6), seed=8))[""]
    assert np.isnan(values(rows, 8)["precision"]) and np.isnan(values(rows)["precision"])
    assert values(rows)["specificity"] == pytest.approx((2 / 3 + 1) / 2)


def test_rows_are_counted_as_the_mean_over_seeds():
    rows = scored(says([0.9, 0.1], rows=[0, 3]), says([0.9] * 4, seed=1, rows=[0, 1, 3, 4]))
    assert {row["n"] for row in rows[""]} == {3}


@pytest.mark.parametrize("held_out", [range(6), ([1, 4], [2, 5])], ids=["all rows", "held out"])
def test_an_interval_holds_the_middle_of_the_resampled_means(held_out):
    """Every draw is the mean over seeds for the same drawn positions, each of its own rows."""
    weights = np.random.default_rng(0).integers(1, 4, (9, 6)).astype(float)
    parts = held_out if isinstance(held_out, tuple) else (held_out, held_out)
    rng = np.random.default_rng(1)
    given = [says(rng.random(len(part)), seed=s, rows=part) for s, part in enumerate(parts)]

    def weighted(prediction, each):
        each = np.ones(len(prediction.rows)) if each is None else each
        return {"mean": each @ prediction.confidence / each.sum(axis=-1)}

    *_, row = scoring.tabulate(
        weighted, model=MODEL, predictions=given, labelled=labelled(REFERENCE, weights=weights)
    )
    draws = np.mean([weighted(one, weights[:, one.rows])["mean"] for one in given], axis=0)
    assert row["value"] == pytest.approx(np.mean([one.confidence.mean() for one in given]))
    expected = np.quantile(draws, [0.025, 0.975]).tolist()
    assert [row["ci_low"], row["ci_high"]] == pytest.approx(expected)


class TestBands:
    SNR_DB = np.array([-40.0, -20.1, -20.0, -15.0, -10.0, -5.0, 0.0, 40.0, 40.5, -41.0])
    REFERENCE = np.array([True, False, True, False, True, True, False, False, True, True])

    def bands(self, *given):
        found = scored(*given, reference=self.REFERENCE, snr_db=self.SNR_DB)
        del found[""]
        return found

    def test_a_band_holds_its_lower_end_and_the_last_one_both(self):
        found = self.bands(says(np.linspace(0, 1, 10)))
        sizes = {band: rows[0]["n"] for band, rows in found.items()}
        assert sizes == {"-40:-20": 2, "-20:-15": 1, "-15:-10": 1, "-10:-5": 1, "-5:40": 3}

    def test_a_band_is_evaluated_on_its_own_rows(self):
        right_below = np.where(self.SNR_DB < -20, self.REFERENCE, ~self.REFERENCE)
        found = self.bands(says(right_below))
        assert values(found["-40:-20"]) == {"auc": 1.0, "balanced_accuracy": 1.0}
        assert values(found["-5:40"]) == {"auc": 0.0, "balanced_accuracy": 0.0}

    def test_seeds_with_other_rows_find_theirs(self):
        """Bands that one of them has no row in are left out."""
        one, other = (
            says([0.9, 0.1, 0.2], rows=[5, 6, 7]),
            says([0.1, 0.9, 1], seed=1, rows=[5, 7, 0]),
        )
        found = self.bands(one, other)
        assert list(found) == ["-5:40"]
        assert values(found["-5:40"])["auc"] == pytest.approx((1.0 + 0.0) / 2)
        assert {row["seed"] for row in found["-5:40"]} == {""}


def survey(points, poses):
    """Return a walk through a room of 6 x 4 m."""
    corners = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 4.0], [0.0, 4.0]])
    inside = np.minimum(points, corners[2] - points).min(axis=1)
    rows = labelled(np.abs(inside) <= 0.1, snr_db=-5.0, kind="survey")
    return LocalizedSurvey(rows, points, poses, closed(corners), {})


# Three points on walls, one 0.5 m off, one 2 m off; the last pose is 2 m from a wall, others 1.5 m.
ROOM = survey(
    np.array([[0.0, 2.0], [3.0, 0.05], [5.95, 2.0], [3.0, 3.5], [2.0, 2.0]]),
    np.array([[1.5, 2.0], [3.0, 1.5], [4.5, 2.0], [3.0, 2.5], [3.0, 2.0]]),
)


def of_map(given, walk=ROOM):
    return {row["metric"]: row for row in scoring.score_map(MODEL, [given], survey=walk)}


def test_a_map_by_hand():
    rows = of_map(says([0.9, 0.8, 0.3, 0.7, 0.1]))
    expected = {
        "precision": 2 / 3,
        "true_retention": 2 / 3,
        "spurious_removal": 1 / 2,
        "error_mean": (0.0 + 0.05 + 0.5) / 3,
    }
    assert {name: rows[name]["value"] for name in expected} == pytest.approx(expected)
    assert {row["snr_db"] for row in rows.values()} == {"-5"}
    assert 0 < rows["wall_coverage"]["value"] < 1 and np.isnan(rows["wall_coverage"]["ci_low"])
    strict = says([0.9, 0.8, 0.3, 0.7, 0.1], threshold=0.85)
    assert of_map(strict)["true_retention"]["value"] == pytest.approx(1 / 3)


def test_what_takes_no_training_is_what_it_says():
    """A coin's shares may miss by four standard deviations of half of 600 points, 8 %."""
    rng = np.random.default_rng(0)
    points = rng.uniform([0, 0], [6, 4], (2000, 2))
    points[rng.random(2000) < 0.3, 0] = 0.0
    walk = survey(points, np.tile([[1.5, 2.0]], (2000, 1)))
    share = walk.labelled.reference.mean()
    kept_removed_precision = {
        "oracle": (1.0, 1.0, 1.0),
        "keep_everything": (1.0, 0.0, share),
        "keep_nothing": (0.0, 1.0, np.nan),
        "chance": (0.5, 0.5, share),
    }
    given = scoring.trivial_predictions(walk.labelled.reference)
    again = scoring.trivial_predictions(walk.labelled.reference)
    assert np.array_equal(given["chance"].confidence, again["chance"].confidence)
    for name, expected in kept_removed_precision.items():
        rows = of_map(given[name], walk)
        found = [rows[m]["value"] for m in ("true_retention", "spurious_removal", "precision")]
        near = 0.08 if name == "chance" else 1e-9
        assert found == pytest.approx(expected, abs=near, nan_ok=True), name
    # Where all are kept, or none, Wilson's interval has a width that the bootstrap lacks.
    assert 0.99 < of_map(given["oracle"], walk)["true_retention"]["ci_low"] < 1.0
