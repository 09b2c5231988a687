"""The report of a comparison: figures, one HTML page that opens offline, the table on the terminal and in the README.

Every number in the page is computed from the comparison; the sentences around them are written so that they hold
whatever the numbers are.
"""

import platform
import re
import sys
from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from importlib import resources
from importlib.metadata import version
from os import cpu_count
from pathlib import Path
from statistics import mean
from typing import TYPE_CHECKING, Any

import numpy as np

from echolearn import store
from echolearn.judge import Answer, Heard, Row

if TYPE_CHECKING:
    from echolearn.compare import Comparison

FORMAT = 1
"""Version of the report; part of a comparison's identity."""

SHOWN_DB = ("0", "-5", "-10")
"""SNRs of the maps' tables."""

LIBRARIES = ("numpy", "scipy", "scikit-learn", "torch", "lightning", "onnxruntime", "pyroomacoustics")
BEGIN, END = "<!-- results: written by `echolearn compare` -->", "<!-- end of results -->"


def pick(rows: Iterable[Row], **wanted: Any) -> list[Row]:
    """Return the rows whose columns equal `wanted`; a tuple allows several values."""
    pairs = {key: value if isinstance(value, tuple) else (value,) for key, value in wanted.items()}
    return [row for row in rows if all(row[key] in values for key, values in pairs.items())]


def is_learned(classifier: str) -> bool:
    """Tell whether a classifier is more than a bare threshold or a yardstick."""
    return not classifier.startswith(("threshold_", "keep_", "oracle", "chance"))


def chosen(contest: "Comparison", trained_on: str) -> str:
    """Return the learned classifier with the best balanced accuracy on its own validation rows: no test set is asked."""
    scores = {
        name: mean(run.metrics["validation"]["balanced_accuracy"] for run in runs)
        for (name, source), runs in contest.runs.items()
        if source == trained_on and is_learned(name)
    }
    return max(sorted(scores), key=scores.__getitem__)


def headline_set(contest: "Comparison") -> str:
    """Return the training set that the maps' tables are about: the scattered one, if there is any."""
    sources = sorted({source for _, source in contest.runs})
    return next((source for source in sources if source.endswith("scattered")), sources[0])


def make(contest: "Comparison", *, name: str) -> dict[str, bytes]:
    """Return the report's files by name: `report.html`, `table.md`, `map.svg` and `figures/*.svg`."""
    source = headline_set(contest)
    best = chosen(contest, source)
    pictures = draw_all(contest, source=source, best=best)
    facts = gather(contest, source=source, best=best) | {"name": name}
    images = {key: "data:image/svg+xml;base64," + b64encode(svg.encode()).decode() for key, svg in pictures.items()}
    page = template("report.html").render(images=images, machine=machine(), **facts)
    table = template("table.md").render(**facts)
    files = {f"figures/{key}.svg": svg.encode() for key, svg in pictures.items()}
    return {"report.html": page.encode(), "table.md": table.encode(), **files}


def template(name: str) -> Any:
    """Return a template of the package, with the filters that format numbers."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(undefined=StrictUndefined, autoescape=name.endswith(".html"), trim_blocks=True, lstrip_blocks=True)
    environment.filters |= {"percent": percent, "figure": figure, "interval": interval, "shade": shade}
    return environment.from_string((resources.files("echolearn") / "templates" / name).read_text())


def percent(value: Any) -> str:
    """Return a share as a whole percentage; nothing for NaN."""
    return "" if value in ("", None) or np.isnan(value) else f"{100 * value:.0f}"


def figure(value: Any) -> str:
    """Return a figure with two decimals; nothing for NaN."""
    return "" if value in ("", None) or np.isnan(value) else f"{value:.2f}"


def interval(row: Row | None, scale: float = 1.0, digits: int = 2) -> str:
    """Return `value [low, high]` of a row, scaled."""
    if row is None or np.isnan(row["value"]):
        return ""
    value, low, high = (f"{scale * row[key]:.{digits}f}" for key in ("value", "ci_low", "ci_high"))
    return f"{value} [{low}, {high}]" if low != "nan" else value


def shade(value: float) -> str:
    """Return the background of a table cell for an AUC: red below 0.5, blue above."""
    strength = min(abs(value - 0.5) / 0.5, 1.0)
    colour = "0, 114, 178" if value >= 0.5 else "213, 94, 0"
    return f"rgba({colour}, {0.42 * strength:.2f})"


def gather(contest: "Comparison", *, source: str, best: str) -> dict[str, Any]:
    """Return everything the templates show."""
    whole = pick(contest.rows, seed="")
    return {
        "source": source,
        "best": best,
        "sets": [describe_set(name, dataset) for name, dataset in contest.sets.items()],
        "rooms": [describe_room(contest, whole, walk, source=source, best=best) for walk in walks(contest, "0")],
        "directions": directions(whole, contest),
        "generalisation": generalisation(whole, contest),
        "protocol": protocol(contest),
        "leak": leak(whole),
        "tests": [row for row in contest.tests if row["trained_on"] == source],
        "seeds": sorted({run.seed for runs in contest.runs.values() for run in runs}),
        "runs": sum(map(len, contest.runs.values())),
    }


def describe_set(name: str, dataset: Any) -> dict[str, Any]:
    """Return what the table of sets shows."""
    return {
        "name": name,
        "rows": len(dataset),
        "positions": len(np.unique(dataset["group"])),
        "reflector": float(dataset["reflector"].mean()),
        "on_map": float(dataset["on_map"].mean()),
        "digest": dataset.digest,
    }


def walks(contest: "Comparison", snr_db: str) -> list[str]:
    """Return the surveys recorded at an SNR, in order."""
    names = dict.fromkeys(walk for walk, _ in contest.heard)
    return [walk for walk in names if f"{next(h for (w, _), h in contest.heard.items() if w == walk).sheet.snr_db[0]:g}" == snr_db]


def room_of(walk: str) -> str:
    """Return a survey's name without its SNR."""
    return walk.rsplit("_", 1)[0]


def describe_room(contest: "Comparison", whole: Sequence[Row], walk: str, *, source: str, best: str) -> dict[str, Any]:
    """Return the map tables of one room: a list of lines per SNR, best direction only."""
    room, localizer = room_of(walk), main_localizer(contest)
    tables = {}
    for snr_db in SHOWN_DB:
        names = [name for name in walks(contest, snr_db) if room_of(name) == room]
        if names:
            tables[snr_db] = map_lines(contest, whole, f"{names[0]}/{localizer}", source=source)
    heard = contest.heard[walk, localizer]
    return {
        "room": room,
        "poses": len(heard.points),
        "attainable": heard.attainable,
        "tables": tables,
        "best": {snr_db: next(line for line in lines if line["classifier"] == best) for snr_db, lines in tables.items()},
    }


def main_localizer(contest: "Comparison") -> str:
    """Return the localizer of the maps' tables: the first one."""
    return next(localizer for _, localizer in contest.heard)


def map_lines(contest: "Comparison", whole: Sequence[Row], tested_on: str, *, source: str) -> list[dict[str, Any]]:
    """Return a line per contestant: its map metrics, and how it compares with the bare threshold."""
    here = pick(whole, tested_on=tested_on, trained_on=("-", source))
    lines = []
    for classifier in dict.fromkeys(row["classifier"] for row in here):
        cells = {row["metric"]: row for row in pick(here, classifier=classifier)}
        test = pick(contest.tests, tested_on=tested_on, trained_on=source, classifier=classifier)
        lines.append({"classifier": classifier, "learned": is_learned(classifier), "test": test[0] if test else None, **cells})
    return lines


def directions(whole: Sequence[Row], contest: "Comparison") -> list[dict[str, Any]]:
    """Return, for each room and localizer, the share of points on a wall at each SNR, nothing filtered."""
    lines: dict[tuple[str, str], dict[str, Any]] = {}
    for (walk, localizer), heard in contest.heard.items():
        line = lines.setdefault((room_of(walk), localizer), {"attainable": heard.attainable, "share": {}})
        [row] = pick(whole, tested_on=f"{walk}/{localizer}", classifier="keep_everything", metric="precision")
        line["share"][row["snr_db"]] = row
    return [{"room": room, "localizer": localizer, **line} for (room, localizer), line in lines.items()]


def generalisation(whole: Sequence[Row], contest: "Comparison") -> dict[str, Any]:
    """Return the table trained on x tested on: AUC of every contestant on every labelled set."""
    here = pick(whole, metric="auc", snr_db="", tested_on=tuple(contest.sets))
    lines: dict[tuple[str, str], dict[str, Row]] = {}
    for row in here:
        lines.setdefault((row["trained_on"], row["classifier"]), {})[row["tested_on"]] = row
    order = sorted(lines, key=lambda key: (key[0] != "-", key[0]))
    return {
        "columns": list(contest.sets),
        "lines": [{"trained_on": source, "classifier": name, "cells": lines[source, name]} for source, name in order],
    }


def protocol(contest: "Comparison") -> list[dict[str, Any]]:
    """Return each contestant's own validation, test and cross-validation figures: the paper's protocol."""
    lines = []
    for (name, source), runs in sorted(contest.runs.items(), key=lambda item: item[0][::-1]):
        line: dict[str, Any] = {"classifier": name, "trained_on": source, "rows": runs[0].metrics["rows"]}
        for part in ("validation", "test"):
            line[part] = {key: mean(run.metrics[part][key] for run in runs) for key in ("auc", "balanced_accuracy", "accuracy")}
        crossed = [run.metrics["cross_validation"] for run in runs if run.metrics["cross_validation"]]
        line["folds"] = mean(result["balanced_accuracy"]["mean"] for result in crossed) if crossed else None
        line["spread"] = float(np.std([run.metrics["test"]["auc"] for run in runs]))
        lines.append(line)
    return lines


def leak(whole: Sequence[Row]) -> list[dict[str, Any]]:
    """Return pairs of AUCs of the same classifier with rows of one position on both sides of the split, and not."""
    lines = []
    for row in pick(whole, metric="auc", snr_db=""):
        planned = row["trained_on"].removesuffix(" (row split)")
        if planned != row["trained_on"] and row["tested_on"] == planned:
            clean = pick(whole, metric="auc", snr_db="", classifier=row["classifier"], trained_on=planned, tested_on=planned)
            lines += [{"classifier": row["classifier"], "set": planned, "leaky": row, "clean": clean[0]}] if clean else []
    return lines


def draw_all(contest: "Comparison", *, source: str, best: str) -> dict[str, str]:
    """Return every figure as SVG, by name."""
    from echolearn import figures

    drawn = {f"maps_{snr_db}_db": figures.maps(panels(contest, snr_db, source, best)) for snr_db in ("0", "-10") if walks(contest, snr_db)}
    if walks(contest, "0"):
        drawn["before_after"] = figures.maps(panels(contest, "0", source, best)[:2])
    whole = pick(contest.rows, seed="")
    drawn["quality"] = figures.over_snr(quality(contest, whole, source), ylabel="balanced accuracy of the map", low=0.3)
    drawn["directions"] = figures.over_snr(unfiltered(contest, whole), ylabel="share of points on a wall, unfiltered")
    away = [name for name in contest.sets if name.startswith("offgrid")] or list(contest.sets)[-1:]
    lines = pick(whole, tested_on=away[-1], metric="auc", trained_on=(source,))
    labels = dict.fromkeys(row["classifier"] for row in lines)
    drawn["bands"] = figures.bands({name: [r for r in pick(lines, classifier=name) if ":" in r["snr_db"]] for name in labels})
    drawn["belief"] = draw_belief(contest, source, away[-1])
    drawn["arrival_times"] = figures.arrival_times(
        {name: (1e3 * contest.sets[name]["toa"], contest.sets[name]["reflector"]) for name in [next(iter(contest.sets)), away[0]]}
    )
    return drawn


def panels(contest: "Comparison", snr_db: str, source: str, best: str) -> list[tuple[str, Heard, Any]]:
    """Return before and after for every room at an SNR, filtered by the first seed of the best classifier."""
    from echolearn.compare import answer_map

    localizer, found = main_localizer(contest), []
    for walk in walks(contest, snr_db):
        heard = contest.heard[walk, localizer]
        answer = answer_map(contest.runs[best, source][0], heard)
        title = f"{room_of(walk)} m, SNR {snr_db} dB"
        found.append((f"{title}: every estimate", heard, np.ones(len(heard.points), dtype=bool)))
        found.append((f"{title}: filtered by {best}", heard, answer.confidence >= answer.threshold))
    return found


def quality(contest: "Comparison", whole: Sequence[Row], source: str) -> dict[str, dict[str, list[Row]]]:
    """Return balanced accuracy over SNR by room and classifier, at the best direction."""
    localizer = main_localizer(contest)
    rooms: dict[str, dict[str, list[Row]]] = {}
    for row in pick(whole, metric="balanced_accuracy", trained_on=source):
        walk, _, heard_by = row["tested_on"].partition("/")
        if heard_by == localizer:
            rooms.setdefault(room_of(walk), {}).setdefault(row["classifier"], []).append(row)
    return rooms


def unfiltered(contest: "Comparison", whole: Sequence[Row]) -> dict[str, dict[str, list[Row]]]:
    """Return the share of points on a wall over SNR by room and localizer, nothing filtered."""
    return {
        room: {line["localizer"]: list(line["share"].values()) for line in directions(whole, contest) if line["room"] == room}
        for room in dict.fromkeys(room_of(walk) for walk, _ in contest.heard)
    }


def draw_belief(contest: "Comparison", source: str, tested_on: str) -> str:
    """Draw the curves of all classifiers trained on `source`, first seed, on one labelled set."""
    from echolearn import figures
    from echolearn.compare import answer_set, sheet_of

    dataset = contest.sets[tested_on]
    sheet = sheet_of(dataset, tested_on, resamples=1)
    answers: Mapping[str, Answer] = {
        name: answer_set(runs[0], dataset) for (name, trained_on), runs in contest.runs.items() if trained_on == source
    }
    return figures.belief(answers, sheet)


def machine() -> dict[str, str]:
    """Describe the machine and the libraries."""
    try:
        models = re.findall(r"model name\s*:\s*(.+)", Path("/proc/cpuinfo").read_text())
    except OSError:
        models = []
    libraries = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    return {
        "processor": f"{(models or [platform.processor() or platform.machine()])[0]}, {cpu_count()} cores",
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "libraries": libraries,
    }


def show(folder: Path, *, readme: Path | None) -> None:
    """Print the results table and the report's path; put the table and the map into a README between its markers."""
    table = (folder / "table.md").read_text()
    sys.stdout.write(table)
    print(f"\n{folder / 'report.html'}")
    if readme is not None:
        text = Path(readme).read_text()
        start, stop = text.index(BEGIN) + len(BEGIN), text.index(END)
        store.write_atomic(Path(readme), f"{text[:start]}\n{table}\n{text[stop:]}".encode())
        picture = (folder / "figures" / "before_after.svg").read_bytes()
        store.write_atomic(Path(readme).parent / "docs" / "before_after.svg", picture)
