"""What a comparison says: its rows arranged into the tables of the report.

A *line* is a dictionary that a template shows; its cells are rows of `results.csv`, so each figure
keeps its interval.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import mean, stdev
from typing import Any

import numpy as np

from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation.scoring import BANDS, Heard, Row, in_band
from echolearn.training.runs import Run

SHOWN_DB = ("0", "-5", "-10")
"""SNRs of the maps' tables."""

Contestant = tuple[str, str]


@dataclass(frozen=True)
class Comparison:
    """Everything a report is made of.

    Attributes:
        runs: trained runs, grouped by (classifier, trained_on).
        sets: labelled test sets by name.
        heard: surveys, by (survey, localizer).
        rows: of results.csv.
        tests: of tests.csv.
    """

    runs: Mapping[Contestant, Sequence[Run]]
    sets: Mapping[str, Dataset]
    heard: Mapping[tuple[str, str], Heard]
    rows: Sequence[Row]
    tests: Sequence[Row]


def pick(rows: Iterable[Row], **wanted: Any) -> list[Row]:
    """Return the rows whose columns equal `wanted`; a tuple allows several values."""
    pairs = {key: value if isinstance(value, tuple) else (value,) for key, value in wanted.items()}
    return [row for row in rows if all(row[key] in values for key, values in pairs.items())]


def is_learned(classifier: str) -> bool:
    """Tell whether a classifier is more than a bare threshold or a yardstick."""
    return not classifier.startswith(("threshold_", "keep_", "oracle", "chance"))


def validated(contest: Comparison, trained_on: str) -> dict[str, float]:
    """Return each classifier's balanced accuracy on its own validation rows, mean over seeds, the
    best first.
    """
    scores = {
        name: mean(run.metrics["validation"]["balanced_accuracy"] for run in runs)
        for (name, source), runs in contest.runs.items()
        if source == trained_on
    }
    return dict(sorted(scores.items(), key=lambda item: (-item[1], item[0])))


def chosen(contest: Comparison, trained_on: str) -> str:
    """Return the learned classifier that did best on its own validation rows: no test set is asked."""
    ranked = list(validated(contest, trained_on))
    return next((name for name in ranked if is_learned(name)), ranked[0])


def chosen_run(contest: Comparison) -> Run:
    """Return the run that is worth exporting: that of the chosen classifier's best seed on its own
    validation rows.
    """
    source = headline_set(contest)
    known = contest.runs[chosen(contest, source), source]
    return max(
        known, key=lambda found: (found.metrics["validation"]["balanced_accuracy"], -found.seed)
    )


def drawn(contest: Comparison, trained_on: str) -> list[str]:
    """Return the classifiers that are drawn: the best of each family, the paper's pair, the
    literature's net.
    """
    ranked = list(validated(contest, trained_on))
    families = {name.partition("_")[0]: name for name in reversed(ranked)}
    return [name for name in ranked if name in {*families.values(), "svm_pair", "covnet"}]


def headline_set(contest: Comparison) -> str:
    """Return the training set that the maps' tables are about: a scattered one, of those tested,
    too, if there are.
    """
    every = sorted({source for _, source in contest.runs})
    sources = [source for source in every if source in contest.sets] or every
    return next((source for source in sources if source.endswith("scattered")), sources[0])


def unseen(contest: Comparison, source: str) -> bool:
    """Tell whether no survey was made in a room of the training set, as far as that is among the
    sets.
    """
    if source not in contest.sets:
        return False
    trained = {tuple(size) for size in contest.sets[source]["room"][:, :2].round(6).tolist()}
    mapped = {
        tuple(np.ptp(heard.corners, axis=0).round(6).tolist()) for heard in contest.heard.values()
    }
    return not trained & mapped


def gather(contest: Comparison, *, source: str, best: str) -> dict[str, Any]:
    """Return everything the templates show."""
    whole = pick(contest.rows, seed="")
    return {
        "source": source,
        "best": best,
        "levels": levels(contest),
        "snrs": snrs(contest),
        "sets": [describe_set(name, dataset) for name, dataset in contest.sets.items()],
        "bands": [f"{low} to {high}" for low, high in BANDS],
        "rooms": [
            describe_room(contest, whole, room, source=source, best=best) for room in rooms(contest)
        ],
        "names": list(
            dict.fromkeys(row["classifier"] for row in whole if row["trained_on"] in ("-", source))
        ),
        "localizer": main_localizer(contest) if contest.heard else "",
        "unseen": unseen(contest, source),
        "worst": worst_off_grid(whole, source),
        "away": away(contest),
        "directions": directions(whole, contest),
        "saved": saved(whole, contest, source=source, best=best),
        "generalisation": generalisation(whole, contest),
        "protocol": protocol(contest),
        "leak": leak(whole),
        "tests": [row for row in contest.tests if row["trained_on"] == source],
        "seeds": sorted({run.seed for runs in contest.runs.values() for run in runs}),
        "runs": sum(map(len, contest.runs.values())),
    }


def describe_set(name: str, dataset: Dataset) -> dict[str, Any]:
    """Return what the table of sets shows: sizes, labels, and how often the TOA is right in each
    SNR band.
    """
    snr_db, reflector = dataset.ratio_db, dataset["reflector"]
    inside = [in_band(snr_db, low=low, high=high) for low, high in BANDS]
    return {
        "name": name,
        "rows": len(dataset),
        "positions": len(np.unique(dataset["group"])),
        "reflector": float(reflector.mean()),
        "on_map": float(dataset["on_map"].mean()),
        "right": [float(reflector[rows].mean()) if rows.any() else float("nan") for rows in inside],
        "digest": dataset.digest,
    }


def rooms(contest: Comparison) -> list[str]:
    """Return the rooms of the surveys, in order."""
    return list(dict.fromkeys(room_of(walk) for walk, _ in contest.heard))


def room_of(walk: str) -> str:
    """Return a survey's name without its SNR."""
    return walk.rsplit("_", 1)[0]


def snr_of(heard: Heard) -> str:
    """Return the SNR of a survey as `results.csv` spells it."""
    return f"{heard.sheet.snr_db[0]:g}"


def snrs(contest: Comparison) -> list[str]:
    """Return the SNRs of the surveys, in order."""
    return list(dict.fromkeys(snr_of(heard) for heard in contest.heard.values()))


def levels(contest: Comparison) -> list[str]:
    """Return the SNRs whose maps are shown in tables."""
    known = snrs(contest)
    return [level for level in SHOWN_DB if level in known] or known


def walks(contest: Comparison, snr_db: str) -> list[str]:
    """Return the surveys recorded at an SNR, in order."""
    return list(
        dict.fromkeys(walk for (walk, _), heard in contest.heard.items() if snr_of(heard) == snr_db)
    )


def describe_room(
    contest: Comparison, whole: Sequence[Row], room: str, *, source: str, best: str
) -> dict[str, Any]:
    """Return the map tables of one room, a list of lines per SNR, with the main direction."""
    localizer = main_localizer(contest)
    names = {
        level: walk
        for level in levels(contest)
        for walk in walks(contest, level)
        if room_of(walk) == room
    }
    tables = {
        level: map_lines(contest, whole, f"{walk}/{localizer}", source=source)
        for level, walk in names.items()
    }
    heard = next(heard for (walk, _), heard in contest.heard.items() if room_of(walk) == room)
    return {
        "room": room,
        "poses": len(np.unique(heard.sheet.groups)),
        "attainable": heard.attainable,
        "tables": tables,
        "best": {level: pick(lines, classifier=best)[0] for level, lines in tables.items()},
    }


def main_localizer(contest: Comparison) -> str:
    """Return the localizer of the maps' tables: the first one."""
    return next(localizer for _, localizer in contest.heard)


def map_lines(
    contest: Comparison, whole: Sequence[Row], tested_on: str, *, source: str
) -> list[dict[str, Any]]:
    """Return a line per contestant: its map metrics, and how it compares with the bare threshold."""
    here = pick(whole, tested_on=tested_on, trained_on=("-", source))
    lines = []
    for classifier in dict.fromkeys(row["classifier"] for row in here):
        cells = {row["metric"]: row for row in pick(here, classifier=classifier)}
        test = pick(contest.tests, tested_on=tested_on, trained_on=source, classifier=classifier)
        lines.append(
            {
                "classifier": classifier,
                "learned": is_learned(classifier),
                "test": test[0] if test else None,
                **cells,
            }
        )
    return lines


def directions(whole: Sequence[Row], contest: Comparison) -> list[dict[str, Any]]:
    """Return, for each room and localizer, the share of points on a wall at each SNR, nothing
    filtered.
    """
    lines: dict[tuple[str, str], dict[str, Any]] = {}
    for (walk, localizer), heard in contest.heard.items():
        line = lines.setdefault(
            (room_of(walk), localizer), {"attainable": heard.attainable, "share": {}}
        )
        [row] = pick(
            whole, tested_on=f"{walk}/{localizer}", classifier="keep_everything", metric="precision"
        )
        line["share"][row["snr_db"]] = row
    return [
        {"room": room, "localizer": localizer, **line} for (room, localizer), line in lines.items()
    ]


def saved(
    whole: Sequence[Row], contest: Comparison, *, source: str, best: str
) -> list[dict[str, Any]]:
    """Return, for each room and localizer, what a classifier leaves at each SNR: precision and true
    retention.
    """
    lines: dict[tuple[str, str], dict[str, Any]] = {}
    for walk, localizer in contest.heard:
        here = pick(whole, tested_on=f"{walk}/{localizer}", trained_on=source, classifier=best)
        cells = {row["metric"]: row for row in here}
        line = lines.setdefault((room_of(walk), localizer), {})
        line[cells["precision"]["snr_db"]] = (cells["precision"], cells["true_retention"])
    return [
        {"room": room, "localizer": localizer, "cells": line}
        for (room, localizer), line in lines.items()
    ]


def away(contest: Comparison) -> str:
    """Return the set whose curves are drawn: the first one off the grid, or the last one."""
    names = list(contest.sets)
    return next((name for name in names if name.startswith("offgrid")), names[-1])


def worst_off_grid(whole: Sequence[Row], source: str) -> dict[str, Row]:
    """Return each contestant's lowest AUC over the off-grid sets."""
    here = [
        row
        for row in pick(whole, metric="auc", snr_db="", trained_on=("-", source))
        if row["tested_on"].startswith("offgrid")
    ]
    return {
        name: min(pick(here, classifier=name), key=lambda row: row["value"])
        for name in {row["classifier"] for row in here}
    }


def generalisation(whole: Sequence[Row], contest: Comparison) -> dict[str, Any]:
    """Return the table trained on x tested on: AUC of every contestant on every labelled set."""
    here = pick(whole, metric="auc", snr_db="", tested_on=tuple(contest.sets))
    lines: dict[tuple[str, str], dict[str, Row]] = {}
    for row in here:
        lines.setdefault((row["trained_on"], row["classifier"]), {})[row["tested_on"]] = row
    order = sorted(lines, key=lambda key: (key[0] != "-", key[0]))
    return {
        "columns": list(contest.sets),
        "lines": [
            {"trained_on": source, "classifier": name, "cells": lines[source, name]}
            for source, name in order
        ],
    }


def protocol(contest: Comparison) -> list[dict[str, Any]]:
    """Return each contestant's own validation, test and cross-validation figures: the paper's
    protocol.
    """
    lines = []
    for (name, source), runs in sorted(contest.runs.items(), key=lambda item: item[0][::-1]):
        line: dict[str, Any] = {
            "classifier": name,
            "trained_on": source,
            "rows": runs[0].metrics["rows"],
        }
        for part in ("validation", "test"):
            line[part] = {
                key: mean(run.metrics[part][key] for run in runs)
                for key in ("auc", "balanced_accuracy", "accuracy")
            }
        crossed = [
            run.metrics["cross_validation"] for run in runs if run.metrics["cross_validation"]
        ]
        line["folds"] = (
            mean(result["balanced_accuracy"]["mean"] for result in crossed) if crossed else None
        )
        line["spread"] = (
            stdev(run.metrics["test"]["auc"] for run in runs) if len(runs) > 1 else None
        )
        lines.append(line)
    return lines


def leak(whole: Sequence[Row]) -> list[dict[str, Any]]:
    """Return pairs of AUCs of the same classifier with rows of one position on both sides of the
    split, and not.
    """
    lines = []
    for row in pick(whole, metric="auc", snr_db=""):
        planned = row["trained_on"].removesuffix(" (row split)")
        if planned != row["trained_on"] and row["tested_on"] == planned:
            clean = pick(
                whole,
                metric="auc",
                snr_db="",
                classifier=row["classifier"],
                trained_on=planned,
                tested_on=planned,
            )
            lines += (
                [{"classifier": row["classifier"], "set": planned, "leaky": row, "clean": clean[0]}]
                if clean
                else []
            )
    return lines
