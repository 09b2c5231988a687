"""What adapting a filter to labelled recordings adds, on places that were not labelled.

    python docs/adapting.py runs/adapted runs/measured [page]    # prints tables; a page gets them

`make adapted` makes what is read: adapted runs (`train init=`) and the surveys `tested_*` of the
other places; the runs that were adapted are those of `make measured`. Every echo of the surveys is
judged by time and direction, at each run's own cut and, as r90, by the largest share of true echoes
that any cut with a precision of 90 % keeps. Intervals are over the places of the loudspeaker, 2000
resamples; that of a difference draws the same places for both filters.
"""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.cli.compose import compose
from echolearn.cli.config import build
from echolearn.comparison.measured import measured_rows
from echolearn.evaluation import stats
from echolearn.evaluation.rows import MeasuredRows
from echolearn.evaluation.scoring import evaluate_echoes
from echolearn.storage.marked_page import Markers, write_between
from echolearn.training.predictions import predict_measured
from echolearn.training.runs import Run, finished_runs

MARKERS = Markers("<!-- adapted: written by `make adapted` -->", "<!-- end of adapted -->", "page")
SHOWN = {
    "auc": "AUC",
    "r90": "r90 %",
    "precision": "precision %",
    "true_retention": "retention %",
    "spurious_removal": "false removed %",
}
LEVELS = (None, 40.0, 10.0, 0.0, -10.0)
RESAMPLES = 2000


def heard(runs: Path) -> MeasuredRows:
    """Return every echo of the surveys of places that were not labelled."""
    [(_, config)] = compose("compare", [f"runs={runs}"])
    localizer = build(config["localizers"]["gated"], "localizers.gated")
    folders = sorted((runs / "survey").glob("tested_*"))
    about = {"localizer": localizer, "name": "gated", "resamples": RESAMPLES}
    return measured_rows("tested", folders, **about)


def pairs(runs: Path, measured: Path) -> Iterator[tuple[Run, Run]]:
    """Yield each adapted run behind the one that it was adapted from, if both learned one label."""
    earlier = {run.identity: run for run in finished_runs(measured)}
    for run in finished_runs(runs):
        before = earlier.get(run.metrics.get("adapted_from", {}).get("name", ""))
        if before and before.model.target == run.model.target:
            yield before, run


def figures(
    rows: MeasuredRows, run: Run, which: Array
) -> Callable[[Array | None], dict[str, Array]]:
    """Return a function from weights (resamples, B) to the metrics of a run on some rows."""
    said = predict_measured(run, rows).within(which)
    return lambda weights: evaluate_echoes(rows.labelled.reference, said, weights=weights)


def table(rows: MeasuredRows, before: Run, after: Run) -> Iterator[str]:
    """Yield the lines of the table of a filter and the same one adapted."""
    name = f"`{before.model.classifier}`, trained on `{before.model.trained_on}`"
    name += f" by the label `{before.model.target}`"
    yield f"| {name} | {' | '.join(SHOWN.values())} |"
    yield "|---" * (len(SHOWN) + 1) + "|"
    for level in LEVELS:
        near = np.abs(rows.labelled.joint_snr_db - (level or 0.0)) < 0.5
        which = np.full(len(near), True) if level is None else near
        weights = rows.labelled.weights[:, which]
        old, new = (figures(rows, run, which) for run in (before, after))

        def gained(drawn, old=old, new=new):
            """Return what the adapted filter is better by."""
            first, second = old(drawn), new(drawn)
            return {key: second[key] - first[key] for key in SHOWN}

        true = int(rows.labelled.reference[which].sum())
        # Of one or two true echoes an interval over places says nothing: how many is told.
        place = f"{'all' if level is None else f'{level:g} dB'} ({true} true of {which.sum()})"
        lines = {"as it was": old, "adapted": new, "difference": gained}
        for said, evaluate in lines.items():
            found = stats.intervals(evaluate, weights)
            cells = " | ".join(cell(key, found[key], said == "difference") for key in SHOWN)
            yield f"| {place}, {said} | {cells} |"


def cell(key: str, found: stats.Interval, signed: bool) -> str:
    """Return `value [low, high]`, shares in %; nothing where there is no value."""
    if np.isnan(found.value):
        return "-"
    factor, digits = (1.0, 2) if key == "auc" else (100.0, 0)
    sign = "+" if signed else ""
    value, low, high = (f"{factor * each:{sign}.{digits}f}" for each in found)
    return f"{value} [{low}, {high}]"


def main(runs: str, measured: str, page: str | None = None) -> None:
    """Print the tables, and write them to a page."""
    rows = heard(Path(runs))
    true = rows.labelled.reference.mean()
    lines = [f"{len(rows.labelled.reference)} echoes at {rows.places} places, {true:.0%} true."]
    for before, after in pairs(Path(runs), Path(measured)):
        told = after.metrics["rows"]
        places = after.metrics["adapted_from"]["places"]
        count = sum(told.values())
        lines += ["", *table(rows, before, after), ""]
        lines.append(
            f"Adapted to {count} recordings at {places} places: {told['train']} fitted,"
            f" {told['validation']} chose penalty, calibration and cut, {told['test']} held out;"
            f" penalty {after.metrics['grid_search']['penalty']:g}."
        )
    text = "\n".join(lines)
    print(text)
    if page:
        write_between(Path(page), f"\n{text}\n", markers=MARKERS)


if __name__ == "__main__":
    main(*sys.argv[1:])
