"""Tables of calibration errors and of figures by a model's own label, by hand."""

import pytest

from echolearn.comparison.calibration_tables import calibration_table, own_table
from small_comparisons import row

ERROR = "calibration_error"
PERFECT = "calibration_error_perfect"


def error(value, snr_db="", classifier="svm", metric=ERROR, **where):
    """Return a row about the calibration of a classifier on the set `away`, in a band of SNR."""
    cells = {"tested_on": "away"} | where
    name = cells.pop("tested_on")
    return row(classifier, "made", name, value, metric=metric, snr_db=snr_db, **cells)


def measured(value, localizer, **more):
    """Return one on the echoes of a recorded survey."""
    return error(value, kind="measured", tested_on="hall", localizer=localizer, **more)


def test_a_line_is_a_classifier_on_a_set_and_a_cell_a_metric_in_a_band():
    rows = [error(0.1), error(0.02, metric=PERFECT), error(0.3, "0:10"), error(0.2, "-20:-10")]
    rows += [error(0.4, "0:10", classifier="trees")]
    table = calibration_table(rows, tested_on="away", localizer="gated")
    # In the order of the SNR, whatever that of the rows, and without bands that have no row.
    assert table["bands"] == ["-20:-10", "0:10"]
    assert list(table["lines"]) == [("made", "svm", "away"), ("made", "trees", "away")]
    values = {cell: found["value"] for cell, found in table["lines"]["made", "svm", "away"].items()}
    assert values == {
        (ERROR, ""): 0.1,
        (PERFECT, ""): 0.02,
        (ERROR, "0:10"): 0.3,
        (ERROR, "-20:-10"): 0.2,
    }


def test_of_recorded_surveys_all_rows_of_one_localizer_are_shown():
    rows = [error(0.1), measured(0.5, "gated"), measured(0.6, "snls")]
    rows += [measured(0.7, "gated", snr_db="10"), error(0.8, tested_on="elsewhere")]
    table = calibration_table(rows, tested_on="away", localizer="gated")
    assert table["bands"] == []
    values = {
        line: [found["value"] for found in cells.values()] for line, cells in table["lines"].items()
    }
    assert values == {("made", "svm", "away"): [0.1], ("made", "svm", "hall"): [0.5]}


@pytest.mark.parametrize("rows", [[], [row("svm", "made", "away", 0.9)]])
def test_without_a_row_about_calibration_there_is_no_table(rows):
    assert calibration_table(rows, tested_on="away", localizer="gated") == {}


def test_figures_by_the_own_label_stand_beside_the_papers():
    other = {"target": "time_and_direction", "training": "made (time_and_direction)"}
    rows = [
        row("svm", "made", "away", 0.6, metric="own_auc", **other),
        row("svm", "made", "away", 0.5, metric="own_recall", **other),
        # By the paper's label a model of another one is shown elsewhere.
        row("svm", "made", "away", 0.1, **other),
        row("trees", "made", "away", 0.9),
        row("trees", "made", "away", 0.8, snr_db="0:10"),
        row("trees", "made", "away", 3.0, metric="rows"),
        row("chance", "-", "away", 0.5, target="reflector"),
    ]
    values = {
        line: {name: {cell: found["value"] for cell, found in cells.items()}}
        for line, sets in own_table(rows).items()
        for name, cells in sets.items()
    }
    assert values == {
        ("made (time_and_direction)", "svm"): {"away": {"auc": 0.6, "recall": 0.5}},
        ("made", "trees"): {"away": {"auc": 0.9}},
    }
    assert own_table(rows[2:]) == {}
