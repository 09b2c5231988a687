"""A study in a page, between two lines that bear its name: what was varied, what is seen, figures.

Its table and figures are copied into a folder of the page's name beside it. Where the paper says in
words what such a study finds (V-B), a table has both.
"""

import csv
import shlex
from pathlib import Path

from echolearn.comparison.template import template
from echolearn.evaluation.rows import distinct
from echolearn.storage import manifests
from echolearn.storage.marked_page import Markers, around, write_beside, write_between
from echolearn.studies.curves import FIGURES


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
    # All of one study: another command may write other intervals into the folder meanwhile.
    found = manifests.listed_bytes(folder, manifest, names=manifest["files"])
    beside = page.parent / page.stem
    write_beside(beside / f"{name}.csv", found["study.csv"])
    # One value, or arrays, which are no scale, make a table, no figure.
    vary = manifest["study"]["vary"]
    if len(manifest["study"]["values"]) > 1 and vary != "array":
        for figure in (Path(each) for each in found if each.endswith(".svg")):
            write_beside(beside / f"{name}_{figure.name}", found[str(figure)])
    words = shlex.split(manifest.get("command", ""))
    command = shlex.join(word for word in words if not word.startswith("runs="))
    text = section(beside / f"{name}.csv", vary=vary, command=command)
    write_between(page, text, markers=markers(name))


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
    figures = [each for each in FIGURES if (table.parent / f"{name}_{each}.svg").exists()]
    shown = template("section.md", room="studies").render(
        name=name,
        folder=table.parent.name,
        vary=vary,
        command=command,
        figures=figures,
        rows=rows,
        values=distinct(rows, vary),
        localizers=distinct(rows, "localizer"),
    )
    return str(shown).strip()
