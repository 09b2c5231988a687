"""What a comparison says: its rows arranged into the tables of the report.

A cell of a table is a row of `results.csv`, so each figure keeps its interval. `pick` takes rows by
what their columns say, `pivot` spreads them over lines and cells.
"""

from collections.abc import Iterable, Sequence
from statistics import mean, stdev
from typing import Any

import numpy as np

from echolearn.comparison.choice import Comparison, chosen, headline
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation.rows import (
    SNR_BANDS_DB,
    LocalizedSurvey,
    Row,
    in_band,
)

SHOWN_DB = ("0", "-5", "-10")
"""SNRs of the maps' tables."""

Table = dict[tuple[Any, ...], dict[Any, Row]]
"""Lines by what tells them from each other; in each its cells, likewise."""


def pick(rows: Iterable[Row], **wanted: Any) -> list[Row]:
    """Return the rows whose columns equal `wanted`; a tuple allows several values."""
    found = list(rows)
    for key, value in wanted.items():
        allowed = value if isinstance(value, tuple) else (value,)
        found = [row for row in found if row[key] in allowed]
    return found


def pivot(rows: Iterable[Row], *, lines: Sequence[str], cells: str) -> Table:
    """Spread rows over a table, in their order.

    Args:
        rows: the rows.
        lines: columns that tell the table's lines from each other.
        cells: column that tells the cells of a line from each other.
    """
    table: Table = {}
    for row in rows:
        line = tuple(row[name] for name in lines)
        table.setdefault(line, {})[row[cells]] = row
    return table


def placed(rows: Iterable[Row], surveys: Iterable[LocalizedSurvey]) -> list[Row]:
    """Return rows with the `place` under which their survey stands in tables.

    Surveys of one room stand together, told from each other by their SNR; where that is not
    enough, those of one room and noise; else each stands for itself.
    """
    recorded = {survey.labelled.source: survey.snr_db for survey in surveys}
    places = {"": ""}
    # The shortest title is taken that leaves no two surveys one cell.
    for title in ("{0.room}", "{0.room}, {0.noise}", "{0.tested_on}"):
        places = {source.tested_on: title.format(source) for source in recorded}
        cells = {(places[source.tested_on], snr_db) for source, snr_db in recorded.items()}
        if len(cells) == len(places):
            break
    return [row | {"place": places.get(row["tested_on"], "")} for row in rows]


def snrs(comparison: Comparison) -> list[str]:
    """Return the SNRs of the surveys, in order."""
    return list(dict.fromkeys(survey.snr_db for survey in comparison.surveys.values()))


def levels(comparison: Comparison) -> list[str]:
    """Return the SNRs whose maps are shown in tables, the lowest last."""
    known = snrs(comparison)
    shown = [level for level in SHOWN_DB if level in known]
    return shown or sorted(known, key=float, reverse=True)


def main_localizer(comparison: Comparison) -> str:
    """Return the localizer of the maps' tables: the first one; nothing without surveys."""
    return next((localizer for _, localizer in comparison.surveys), "")


def away(comparison: Comparison) -> str:
    """Return the set whose curves are drawn: the first made for testing, or the last one."""
    names = list(comparison.sets)
    made_for_it = [
        name for name in names if comparison.sets[name].manifest["plan"]["role"] == "test"
    ]
    return (made_for_it or names[-1:])[0]


def unseen(comparison: Comparison, training: str) -> bool:
    """Tell whether no survey was made in a room of the training set, if that is among the sets."""
    if training not in comparison.sets:
        return False
    sizes = comparison.sets[training]["room"][:, :2].round(6)
    trained = {tuple(size) for size in sizes.tolist()}
    corners = (survey.corners for survey in comparison.surveys.values())
    mapped = {tuple(np.ptp(each, axis=0).round(6).tolist()) for each in corners}
    return not trained & mapped


def gather(comparison: Comparison) -> dict[str, Any]:
    """Return everything the templates show."""
    source = headline(comparison)
    best = chosen(comparison)
    surveys = comparison.surveys.values()
    rows = placed(pick(comparison.rows, seed=""), surveys)
    tests = pick(placed(comparison.tests, surveys), training=source)
    here = pick(rows, training=("-", source))
    left = pick(here, kind="survey", classifier=best.classifier)
    runs = [run for seeds in comparison.models.values() for run in seeds]
    return {
        "source": source,
        "best": best.classifier,
        "best_line": (best.classifier, best.role),
        "levels": levels(comparison),
        "snrs": snrs(comparison),
        "sets": [describe_set(name, dataset) for name, dataset in comparison.sets.items()],
        "bands": [f"{low} to {high}" for low, high in SNR_BANDS_DB],
        "rooms": map_tables(here + [row | {"metric": "test"} for row in tests], comparison),
        "names": list(dict.fromkeys(row["classifier"] for row in here)),
        "localizer": main_localizer(comparison),
        "unseen": unseen(comparison, source),
        "worst": worst_test_set(here),
        "away": away(comparison),
        "directions": by_room(unfiltered(rows)),
        "precision": by_room(pick(left, metric="precision")),
        "retention": by_room(pick(left, metric="true_retention")),
        "generalisation": generalisation(rows),
        "protocol": protocol(comparison),
        "leak": leak(rows),
        "tests": tests,
        "seeds": sorted({run.seed for run in runs}),
        "runs": len(runs),
    }


def describe_set(name: str, dataset: Dataset) -> dict[str, Any]:
    """Return what the table of sets shows: sizes, labels, how often the TOA is right by SNR."""
    reflector = dataset["reflector"]
    snr_db = dataset.ratio_db
    right = []
    for low, high in SNR_BANDS_DB:
        inside = in_band(snr_db, low=low, high=high)
        right.append(float(reflector[inside].mean()) if inside.any() else float("nan"))
    return {
        "name": name,
        "rows": len(dataset),
        "positions": len(np.unique(dataset["group"])),
        "reflector": float(reflector.mean()),
        "on_map": float(dataset["on_map"].mean()),
        "right": right,
        "digest": dataset.digest,
    }


def unfiltered(rows: Iterable[Row]) -> list[Row]:
    """Return the rows that tell the share of points on a wall where nothing is filtered."""
    return pick(rows, kind="survey", classifier="keep_everything", metric="precision")


def by_room(rows: Iterable[Row]) -> Table:
    """Return a line for each room and localizer, a cell for each SNR."""
    return pivot(rows, lines=("place", "localizer"), cells="snr_db")


def map_tables(rows: Iterable[Row], comparison: Comparison) -> dict[str, dict[str, Any]]:
    """Return what is shown of each room: poses, and a table per SNR with the main localizer.

    The lines of a table are the models, its cells metrics, and the paired test as "test".
    """
    localizer = main_localizer(comparison)
    maps = pick(rows, kind="survey", localizer=localizer)
    rooms: dict[str, dict[str, Any]] = {}
    for row in unfiltered(maps):
        if row["place"] in rooms:
            continue
        survey = comparison.surveys[row["tested_on"], localizer]
        tables = {}
        for level in levels(comparison):
            here = pick(maps, place=row["place"], snr_db=level)
            if here:
                tables[level] = pivot(here, lines=("classifier", "role"), cells="metric")
        poses = len(np.unique(survey.labelled.groups))
        known = {"poses": poses, "attainable": survey.attainable, "tables": tables}
        rooms[row["place"]] = known
    return rooms


def worst_test_set(rows: Iterable[Row]) -> dict[str, Row]:
    """Return each model's lowest AUC over the sets made for testing."""
    aucs = pick(rows, kind="set", set_role="test", metric="auc", snr_db="")
    worst = {}
    for (classifier,), cells in pivot(aucs, lines=("classifier",), cells="tested_on").items():
        worst[classifier] = min(cells.values(), key=lambda row: row["value"])
    return worst


def generalisation(rows: Iterable[Row]) -> Table:
    """Return AUC by what was trained on (and how) and on which set it was tested."""
    aucs = pick(rows, kind="set", metric="auc", snr_db="")
    table = pivot(aucs, lines=("training", "split", "classifier"), cells="tested_on")
    return dict(sorted(table.items(), key=lambda line: line[0][0]))


def leak(rows: Iterable[Row]) -> Table:
    """Return AUC on the own set where a classifier was trained with both splits."""
    own = [row for row in rows if row["tested_on"] == row["trained_on"]]
    aucs = pick(own, metric="auc", snr_db="")
    table = pivot(aucs, lines=("classifier", "trained_on", "target"), cells="split")
    return {line: cells for line, cells in table.items() if len(cells) == 2}


def protocol(comparison: Comparison) -> list[dict[str, Any]]:
    """Return each model's own test and cross-validation figures: the paper's protocol."""
    lines = []
    for model in sorted(comparison.models, key=lambda model: (model.training, model.classifier)):
        figures = [run.metrics for run in comparison.models[model]]
        line: dict[str, Any] = model._asdict() | {"training": model.training}
        line |= {"rows": figures[0]["rows"], "spread": None, "folds": None}
        for key in ("auc", "balanced_accuracy", "accuracy"):
            line[key] = mean(each["test"][key] for each in figures)
        if len(figures) > 1:
            line["spread"] = stdev(each["test"]["auc"] for each in figures)
        crossed = [each["cross_validation"] for each in figures if each["cross_validation"]]
        if crossed:
            line["folds"] = mean(each["balanced_accuracy"]["mean"] for each in crossed)
        lines.append(line)
    return lines
