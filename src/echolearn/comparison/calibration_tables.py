"""What the report's table of calibration errors shows: by band of SNR, and on measured sound."""

from collections.abc import Iterable
from typing import Any

from echolearn.comparison.pivot import pivot
from echolearn.evaluation.reliability import BANDS_DB
from echolearn.evaluation.rows import Row, pick

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
