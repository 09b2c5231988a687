"""What a comparison says: its rows arranged into the tables of the report.

A cell of a table is a row of `results.csv`, so each figure keeps its interval. `pick` takes rows by
what their columns say, `pivot` spreads them over lines and cells.
"""

from collections.abc import Collection, Iterable
from operator import attrgetter, itemgetter
from statistics import mean, stdev
from typing import Any

import numpy as np

from echolearn.comparison.calibration_tables import calibration_table, own_table
from echolearn.comparison.choice import Comparison, away, chosen, headline, trained
from echolearn.comparison.measured_tables import measured_tables
from echolearn.comparison.pivot import Table, pivot
from echolearn.comparison.rivals import BASELINE
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation.rows import (
    BUNDLE,
    SNR_BANDS_DB,
    UNFIT,
    LocalizedSurvey,
    Row,
    distinct,
    in_band,
    pick,
)

PAPER_PLANS = ("paper", "paper_planar")
"""Plans of the paper's sets: without them a report says nothing of the paper."""

SHOWN_DB = ("-10", "-5", "0")
"""SNRs of the maps' tables."""

SHORT = 12
"""Lines that a terminal and a README show whole; of a longer table they show `IN_SHORT`, the chosen
classifier and bundles, and all of it is in the report and in results.csv."""

IN_SHORT = ("svm_toa", "svm_pair", "threshold_peak", "chance")
"""The paper's classifiers, the yardstick that tests are against, and who knows nothing."""


def placed(rows: Iterable[Row], surveys: Iterable[LocalizedSurvey]) -> list[Row]:
    """Return rows with the `place` under which their survey stands in tables.

    Surveys of one room stand together, told from each other by their SNR; where that is not
    enough, those of one room and noise; else each stands for itself.
    """
    recorded = {survey.labelled.source.tested_on: survey for survey in surveys}
    places: dict[str, str] = {}
    # The shortest title is taken that leaves no two surveys one cell.
    for title in ("{0.room}", "{0.room}, {0.noise}", "{0.tested_on}"):
        cells = set()
        for name, survey in recorded.items():
            places[name] = title.format(survey.labelled.source)
            cells.add((places[name], survey.snr_db))
        if len(cells) == len(recorded):
            break
    return [row | {"place": places.get(row["tested_on"], "")} for row in rows]


def snrs(comparison: Comparison) -> list[str]:
    """Return the SNRs of the surveys, in order."""
    return list(dict.fromkeys(survey.snr_db for survey in comparison.surveys.values()))


def levels(comparison: Comparison) -> list[str]:
    """Return the SNRs whose maps are shown in tables, the lowest first."""
    known = snrs(comparison)
    shown = [level for level in SHOWN_DB if level in known]
    return shown or sorted(known, key=float)


def main_localizer(comparison: Comparison) -> str:
    """Return the localizer of the maps' tables: the first one; nothing without surveys."""
    return next(iter(localizers_of(comparison)), "")


def unseen(comparison: Comparison, trained_on: str) -> bool:
    """Tell whether no survey was made in a room of the training set, if that is among the sets."""
    if trained_on not in comparison.sets:
        return False
    trained = comparison.sets[trained_on]["room"][:, :2]
    for survey in comparison.surveys.values():
        if np.isclose(trained, np.ptp(survey.walls, axis=(0, 1))).all(axis=1).any():
            return False
    return True


def gather(comparison: Comparison) -> dict[str, Any]:
    """Return everything the templates show."""
    source = headline(comparison)
    best = chosen(comparison)
    localizer = main_localizer(comparison)
    surveys = comparison.surveys.values()
    rows = placed(pick(comparison.rows, seed=""), surveys)
    placed_tests = placed(comparison.tests, surveys)
    tests = pick(placed_tests, training=source, test="swaps", against=BASELINE)
    here = pick(rows, training=("-", source))
    left = pick(here, kind="survey", classifier=best.classifier)
    runs = [run for seeds in trained(comparison).values() for run in seeds]
    spread = generalisation(rows, localizer=localizer)
    bundles = [each.classifier for each in comparison.models if each.role == BUNDLE]
    short = in_short(spread, always=(*IN_SHORT, best.classifier, *bundles))
    about = {*comparison.sets, *(model.trained_on for model in comparison.models)}
    return {
        "paper": not about.isdisjoint(PAPER_PLANS),
        "source": source,
        "best": best.classifier,
        "best_line": (best.classifier, best.role),
        "levels": levels(comparison),
        "snrs": snrs(comparison),
        "sets": [describe_set(name, dataset) for name, dataset in comparison.sets.items()],
        "bands": [f"{low} to {high}" for low, high in SNR_BANDS_DB],
        "rooms": map_tables(here + [row | {"metric": "test"} for row in tests], comparison),
        "names": distinct(here, "classifier"),
        "localizer": localizer,
        "unseen": unseen(comparison, best.trained_on),
        "worst": worst_test_set(here),
        "away": away(comparison),
        "own": own_table(rows),
        "sizes": sizes(comparison),
        "repeated": comparison.repeated,
        "calibration": calibration_table(here, tested_on=away(comparison), localizer=localizer),
        "directions": by_room(unfiltered(rows)),
        "precision": by_room(pick(left, metric="precision")),
        "retention": by_room(pick(left, metric="true_retention")),
        "generalisation": spread,
        "short": short,
        "left_out": len({line[2] for line in spread} - {line[2] for line in short}),
        "measured": measured_tables(rows, comparison.measured, localizer=localizer),
        "unfit": UNFIT,
        "bundles": bundles,
        "protocol": protocol(comparison),
        "leak": leak(rows),
        "tests": tests,
        "seeds": sorted({run.seed for run in runs}),
        "runs": len(runs),
    }


def describe_set(name: str, dataset: Dataset) -> dict[str, Any]:
    """Return what the table of sets shows: sizes, labels, how often the TOA is right by SNR."""
    reflector = dataset["reflector"]
    right = []
    for low, high in SNR_BANDS_DB:
        inside = in_band(dataset.ratio_db, low=low, high=high)
        right.append(reflector[inside].mean() if inside.any() else None)
    return {
        "name": name,
        "rows": len(dataset),
        "positions": len(np.unique(dataset["group"])),
        "reflector": reflector.mean(),
        # Of a survey without a map nobody knows it.
        "on_map": dataset["on_map"].mean() if dataset.holds(["on_map"]) else np.nan,
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
    rooms = {}
    for place in distinct(maps, "place"):
        here = pick(maps, place=place)
        tables = {}
        for level in levels(comparison):
            table = pivot(pick(here, snr_db=level), lines=("classifier", "role"), cells="metric")
            if table:
                tables[level] = table
        survey = comparison.surveys[here[0]["tested_on"], localizer]
        poses = len(np.unique(survey.labelled.groups))
        rooms[place] = {"poses": poses, "attainable": survey.attainable, "tables": tables}
    return rooms


def worst_test_set(rows: Iterable[Row]) -> dict[str, Row]:
    """Return each model's lowest AUC over the sets made for testing."""
    worst: dict[str, Row] = {}
    for row in pick(rows, kind="set", set_role="test", metric="auc", snr_db=""):
        known = worst.setdefault(row["classifier"], row)
        if row["value"] < known["value"]:
            worst[row["classifier"]] = row
    return worst


def generalisation(rows: Iterable[Row], *, localizer: str) -> Table:
    """Return AUC by what was trained on (and how) and on which set it was tested.

    Recorded surveys are further columns: their AUC by time and direction, or by what is known. A
    cell of a model that was made for another robot says so by its metric.

    Args:
        rows: means over seeds.
        localizer: whose echoes of recorded surveys are shown.
    """
    whole = pick(rows, kind=("set", "measured"), snr_db="", localizer=("", localizer))
    aucs = pick(whole, metric="time_auc") + pick(whole, metric=("auc", *UNFIT))
    # Where both are known, time and direction together take the place of time alone.
    in_turn = sorted(aucs, key=itemgetter("training"))
    return pivot(in_turn, lines=("training", "split", "classifier"), cells="tested_on")


def in_short(table: Table, *, always: Collection[str]) -> Table:
    """Return the lines of `generalisation` that a terminal shows, all of them if they are few.

    A split by rows lets memory pass for skill, so it stands only where that is told.

    Args:
        table: lines by training, split and classifier.
        always: classifiers that a long table keeps.
    """
    told = {line: cells for line, cells in table.items() if line[1] != "row"}
    if len(told) <= SHORT:
        return told
    return {line: cells for line, cells in told.items() if line[2] in always}


def localizers_of(comparison: Comparison) -> list[str]:
    """Return the localizers of all surveys, in their order."""
    names = [localizer for _, localizer in (*comparison.surveys, *comparison.measured)]
    return list(dict.fromkeys(names))


def leak(rows: Iterable[Row]) -> Table:
    """Return AUC on the own set where a classifier was trained with both splits."""
    own = [row for row in rows if row["tested_on"] == row["trained_on"]]
    aucs = pick(own, metric="auc", snr_db="")
    table = pivot(aucs, lines=("classifier", "trained_on", "target"), cells="split")
    return {line: cells for line, cells in table.items() if len(cells) == 2}


def protocol(comparison: Comparison) -> list[dict[str, Any]]:
    """Return each model's own test and cross-validation figures: the paper's protocol."""
    lines = []
    for model in sorted(trained(comparison), key=attrgetter("training", "classifier")):
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


def sizes(comparison: Comparison) -> dict[tuple[str, str], int | str]:
    """Return how many rows each model was trained on, by training and classifier.

    A bundle does not tell how many of its set's rows these were.
    """
    return {
        (model.training, model.classifier): runs[0].metrics.get("rows", {}).get("train", "")
        for model, runs in comparison.models.items()
    }
