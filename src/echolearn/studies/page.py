"""A study in a page, between two lines that bear its name: what was varied, what is seen, figures.

Its table and figures are copied into a folder of the page's name beside it. Where the paper says in
words what such a study finds (V-B), a table has both.
"""

import csv
import shlex
from pathlib import Path

from echolearn.comparison.figures import INTERVAL
from echolearn.evaluation.rows import Row, distinct, pick
from echolearn.storage import files, manifests
from echolearn.storage.marked_page import Markers, around, write_between
from echolearn.studies.curves import FIGURES

STATEMENTS = {
    "paper_snr": (
        ("the TOA of S-NLS is right in around 80 % at -10 dB", "snls", "toa", ("-10",)),
        ("that of EM-MC similarly", "em", "toa", ("-10",)),
        ("the DOA of S-NLS is good only at higher SNRs", "snls", "doa", ("-10", "0", "10")),
    ),
    "paper_t60": (
        ("the TOA of S-NLS does not depend on T60 from 0.2 to 1 s", "snls", "toa", ("0.2", "1.0")),
        ("nor does its DOA", "snls", "doa", ("0.2", "1.0")),
    ),
}
"""What the paper says about its figures: text, localizer, metric, values; by study."""


def markers(name: str) -> Markers:
    """Return the lines between which a page has the study of that name."""
    begin = f"<!-- study {name}: written by `echolearn study` -->"
    return Markers(begin, f"<!-- end of study {name} -->", "page")


def check_page(page: Path, name: str) -> None:
    """Raise `BadValue` unless the page has the markers of that study."""
    around(page, markers(name))


def publish(folder: Path, page: Path) -> None:
    """Put a finished study into a page, its table and figures beside it.

    Raises:
        BadValue: a damaged study, or a page without the markers of its name.
    """
    name = folder.name
    manifest = manifests.verify(folder)
    check_page(page, name)
    beside = page.parent / page.stem
    files.write_atomic(beside / f"{name}.csv", (folder / "study.csv").read_bytes())
    # What has one value only is a table of a few numbers, no figure.
    if len(manifest["study"]["values"]) > 1:
        for figure in (folder / "figures").glob("*.svg"):
            files.write_atomic(beside / f"{name}_{figure.name}", figure.read_bytes())
    words = shlex.split(manifest.get("command", ""))
    command = shlex.join(word for word in words if not word.startswith("runs="))
    text = section(beside / f"{name}.csv", vary=manifest["study"]["vary"], command=command)
    write_between(page, text, markers(name))


def section(table: Path, *, vary: str, command: str) -> str:
    """Return what a page in the folder above shows of a study.

    Args:
        table: `study.csv` as copied, its figures beside it.
        vary: what was varied.
        command: that made it; empty if that is not known.
    """
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    name = table.stem
    said = f"{rows[0]['n']} recordings at each value; all shares with their intervals: "
    said += f"[{table.name}]({table.parent.name}/{table.name})."
    text = [f"{said} `{command}`" if command else said]
    figures = [table.parent / f"{name}_{figure}.svg" for figure in FIGURES]
    text += [
        f"![{path.stem}]({table.parent.name}/{path.name})" for path in figures if path.exists()
    ]
    if len(distinct(rows, vary)) == 1:
        # A single value makes no figure: its shares are few enough to be read.
        own = pick(rows, metric="on_map")
        shares = ", ".join(f"`{row['localizer']}` {in_percent(row)}" for row in own)
        text.append(f"Map points on a wall, in %: {shares}.")
    lines = ["| the paper (V-B) | found, in % |", "|---|---|"]
    for statement, localizer, metric, values in STATEMENTS.get(name, ()):
        own = pick(rows, localizer=localizer, metric=metric)
        found = "; ".join(
            f"at {row[vary]}: {in_percent(row)}" for row in own if row[vary] in values
        )
        lines.append(f"| {statement} | {found} |")
    return "\n\n".join(text + (["\n".join(lines)] if lines[2:] else []))


def in_percent(row: Row) -> str:
    """Return a share with its interval in per cent."""
    value, low, high = (100 * float(row[key]) for key in INTERVAL)
    return f"{value:.3g} [{low:.3g}, {high:.3g}]"
