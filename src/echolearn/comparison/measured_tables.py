"""What tables show of recorded surveys that are judged echo by echo."""

from collections.abc import Iterable, Mapping
from typing import Any

from echolearn.comparison.pivot import pivot
from echolearn.evaluation.rows import MeasuredRows, Row, pick


def measured_tables(
    rows: Iterable[Row], groups: Mapping[tuple[str, str], MeasuredRows], *, localizer: str
) -> dict[str, dict[str, Any]]:
    """Return what is shown of each group of recorded surveys: its size, and a line for each model.

    The cells of a line are rows by metric and SNR, as in `line["auc", ""]`.

    Args:
        rows: means over seeds.
        groups: echoes by the names of their group and localizer.
        localizer: whose echoes are shown.
    """
    found = {}
    every = pick(rows, kind="measured", localizer=localizer)
    for (group, name), measured in groups.items():
        if name != localizer:
            continue
        here = pick(every, tested_on=group)
        joined = [row | {"cell": (row["metric"], row["snr_db"])} for row in here]
        levels = sorted({row["snr_db"] for row in here} - {""}, key=float)
        labelled = measured.labelled
        found[group] = {
            "label": measured.label,
            "timed": measured.by_time is not None,
            "echoes": len(labelled.reference),
            "true": labelled.reference.mean(),
            "places": measured.places,
            "levels": levels,
            # Around 0 dB filtering begins to matter.
            "level": "0" if "0" in levels else next(iter(levels), ""),
            "lines": pivot(joined, lines=("training", "classifier"), cells="cell"),
        }
    return found
