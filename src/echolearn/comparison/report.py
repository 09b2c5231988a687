"""The report of a comparison: figures, one HTML page that opens offline, the table on the terminal
and in the README.

Every number in the page is computed from the comparison; the sentences around them are written so
that they hold whatever the numbers are.
"""

import platform
import re
import sys
from base64 import b64encode
from collections.abc import Sequence
from importlib import resources
from importlib.metadata import version
from os import cpu_count
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.comparison.tables import (
    Comparison,
    away,
    chosen,
    directions,
    drawn,
    gather,
    headline_set,
    levels,
    main_localizer,
    pick,
    room_of,
    rooms,
    snr_of,
)
from echolearn.evaluation import metrics
from echolearn.evaluation.scoring import Heard, Row
from echolearn.storage.files import write_atomic
from echolearn.storage.marked_page import Markers, write_between
from echolearn.training.runs import answer_map, answer_set, sheet_of

FORMAT = 6
"""Version of the report; part of a comparison's identity."""

LIBRARIES = (
    "numpy",
    "scipy",
    "scikit-learn",
    "torch",
    "lightning",
    "onnxruntime",
    "pyroomacoustics",
)
RESULTS = Markers(
    "<!-- results: written by `echolearn compare` -->", "<!-- end of results -->", "readme"
)


def make(contest: Comparison, *, name: str) -> dict[str, bytes]:
    """Return the report's files by name: `report.html`, `table.md` and `figures/*.svg`."""
    source = headline_set(contest)
    best = chosen(contest, source)
    pictures = draw_all(contest, source=source, best=best)
    facts = gather(contest, source=source, best=best) | {"name": name}
    images = {
        key: "data:image/svg+xml;base64," + b64encode(svg.encode()).decode()
        for key, svg in pictures.items()
    }
    page = template("report.html").render(images=images, machine=machine(), **facts)
    table = template("table.md").render(**facts)
    files = {f"figures/{key}.svg": svg.encode() for key, svg in pictures.items()}
    return {"report.html": page.encode(), "table.md": table.encode()} | files


def template(name: str) -> Any:
    """Return a template of the package, with the filters that format numbers."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        undefined=StrictUndefined,
        autoescape=name.endswith(".html"),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {
        "percent": percent,
        "figure": figure,
        "interval": interval,
        "signed": signed,
        "shade": shade,
    }
    return environment.from_string(
        (resources.files("echolearn.comparison") / "templates" / name).read_text()
    )


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


def signed(test: Row, scale: float = 100.0, digits: int = 1) -> str:
    """Return a paired difference as `+value [low, high]`, scaled."""
    value, low, high = (
        f"{scale * test[key]:+.{digits}f}" for key in ("difference", "ci_low", "ci_high")
    )
    return f"{value} [{low}, {high}]"


def shade(value: float) -> str:
    """Return the background of a table cell for an AUC: red below 0.5, blue above."""
    strength = min(abs(value - 0.5) / 0.5, 1.0)
    colour = "0, 114, 178" if value >= 0.5 else "213, 94, 0"
    return f"rgba({colour}, {0.42 * strength:.2f})"


def draw_all(contest: Comparison, *, source: str, best: str) -> dict[str, str]:
    """Return every figure as SVG, by name."""
    about_sets = draw_sets(contest, source=source)
    return (
        about_sets | draw_maps(contest, source=source, best=best) if contest.heard else about_sets
    )


def draw_sets(contest: Comparison, *, source: str) -> dict[str, str]:
    """Return the figures about labelled sets: AUC by band, belief, arrival times on and off the
    grid.
    """
    from echolearn.comparison import figures

    names, shown = list(contest.sets), away(contest)
    lines = pick(contest.rows, seed="", tested_on=shown, metric="auc", trained_on=source)
    labels = drawn(contest, source)
    banded = {
        name: [row for row in pick(lines, classifier=name) if ":" in row["snr_db"]]
        for name in labels
    }
    dataset = contest.sets[shown]
    answers = {name: answer_set(contest.runs[name, source][0], dataset) for name in labels}
    times = {
        name: (1e3 * contest.sets[name]["toa"], contest.sets[name]["reflector"])
        for name in (names[0], shown)
    }
    return {
        "bands": figures.bands(banded),
        "belief": figures.belief(answers, sheet_of(dataset, shown, resamples=1)),
        "arrival_times": figures.arrival_times(times),
    }


def draw_maps(contest: Comparison, *, source: str, best: str) -> dict[str, str]:
    """Return the figures about surveys: maps before and after, quality over SNR, directions."""
    from echolearn.comparison import figures

    shown = levels(contest)
    whole = pick(contest.rows, seed="")
    ends = (
        {"maps_last": shown[-1], "maps_first": shown[0]}
        if len(shown) > 1
        else {"maps_first": shown[0]}
    )
    maps = {
        name: figures.maps(panels(contest, level, source=source, best=best))
        for name, level in ends.items()
    }
    return maps | {
        "quality": figures.over_snr(
            quality(contest, whole, source), ylabel="balanced accuracy of the map", low=0.3
        ),
        "directions": figures.over_snr(
            unfiltered(contest, whole), ylabel="share of points on a wall, unfiltered"
        ),
    }


def panels(
    contest: Comparison, snr_db: str, *, source: str, best: str
) -> list[tuple[str, Heard, Array]]:
    """Return before and after for every room at an SNR, filtered by the first seed of the best
    classifier.
    """
    found = []
    for (walk, localizer), heard in contest.heard.items():
        if localizer == main_localizer(contest) and snr_of(heard) == snr_db:
            answer = answer_map(contest.runs[best, source][0], heard)
            title = f"{room_of(walk)} m, SNR {snr_db} dB"
            found.append(
                (f"{title}: every estimate", heard, np.ones(len(heard.points), dtype=bool))
            )
            found.append(
                (
                    f"{title}: filtered by {best}",
                    heard,
                    metrics.kept(answer.confidence, answer.threshold),
                )
            )
    return found


def quality(
    contest: Comparison, whole: Sequence[Row], source: str
) -> dict[str, dict[str, list[Row]]]:
    """Return balanced accuracy over SNR by room and classifier, with the main direction."""
    found: dict[str, dict[str, list[Row]]] = {}
    names = tuple(drawn(contest, source))
    for row in pick(whole, metric="balanced_accuracy", trained_on=source, classifier=names):
        walk, _, heard_by = row["tested_on"].partition("/")
        if heard_by == main_localizer(contest):
            found.setdefault(room_of(walk), {}).setdefault(row["classifier"], []).append(row)
    return found


def unfiltered(contest: Comparison, whole: Sequence[Row]) -> dict[str, dict[str, list[Row]]]:
    """Return the share of points on a wall over SNR by room and localizer, nothing filtered."""
    lines = directions(whole, contest)
    return {
        room: {line["localizer"]: list(line["share"].values()) for line in pick(lines, room=room)}
        for room in rooms(contest)
    }


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
    """Print the results table and the report's path; put the table into a README and a map beside it.

    The map is that of the lowest SNR, where filtering earns most.
    """
    table = (folder / "table.md").read_text()
    sys.stdout.write(table)
    print(f"\n{folder / 'report.html'}")
    if readme is not None:
        write_between(readme, table, RESULTS)
        pictures = [folder / "figures" / f"maps_{which}.svg" for which in ("last", "first")]
        for picture in [path for path in pictures if path.is_file()][:1]:
            write_atomic(Path(readme).parent / "docs" / "before_after.svg", picture.read_bytes())
