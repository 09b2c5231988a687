"""What the report's table of calibration errors shows: by band of SNR, and on measured sound."""

from collections.abc import Iterable
from typing import Any

from echolearn.comparison.pivot import pivot
from echolearn.evaluation.reliability import BANDS_DB
from echolearn.evaluation.rows import PAPER, Row, pick

OWN = {
    "own_auc": "auc",
    "own_balanced_accuracy": "balanced_accuracy",
    "own_precision": "precision",
    "own_recall": "recall",
    "calibration_error": "error",
    "calibration_error_perfect": "perfect",
}
"""Metrics by a model's own label, with the names of their cells."""

METRICS = ("calibration_error", "calibration_error_perfect")


def calibration_table(rows: Iterable[Row], *, tested_on: str, localizer: str) -> dict[str, Any]:
    """Return bands and lines of the table; nothing if no row is about calibration.

    The cells of a line are rows by metric and band, "" for all.

    Args:
        rows: means over seeds, of one training.
        tested_on: the set that is shown; recorded surveys follow.
        localizer: whose echoes of these are shown.
    """
    found = pick(rows, metric=METRICS)
    shown = pick(found, kind="set", tested_on=tested_on)
    # Levels of recorded surveys are no bands: of them all rows together are shown.
    shown += pick(found, kind="measured", localizer=localizer, snr_db="")
    cells = [row | {"cell": (row["metric"], row["snr_db"])} for row in shown]
    bands = [f"{low}:{high}" for low, high in BANDS_DB]
    there = {row["snr_db"] for row in shown}
    lines = pivot(cells, lines=("training", "classifier", "tested_on"), cells="cell")
    return {"bands": [band for band in bands if band in there], "lines": lines} if lines else {}


def own_table(rows: Iterable[Row]) -> dict[tuple[str, str], dict[str, dict[str, Row]]]:
    """Return what the table of figures by each model's own label shows.

    Its lines are trainings and classifiers, of each a mapping from set to cells. There is none
    where all have learned the paper's label, whose figures other tables have.

    Args:
        rows: means over seeds.
    """
    whole = pick(rows, kind="set", snr_db="")
    if not pick(whole, metric="own_auc"):
        return {}
    found: dict[tuple[str, str], dict[str, dict[str, Row]]] = {}
    for row in whole:
        # By the paper's label a model's own figures are the usual ones.
        name = OWN.get(row["metric"]) or (row["metric"] if row["target"] == PAPER else None)
        if name in OWN.values() and row["role"] != "reference":
            line = found.setdefault((row["training"], row["classifier"]), {})
            line.setdefault(row["tested_on"], {})[str(name)] = row
    return found
