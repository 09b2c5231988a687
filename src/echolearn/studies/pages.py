"""A page of studies: what each found, between markers that bear its name, and what had been
expected of all.

Beside the page lies a folder of its name: tables and figures are copied there, and `expected.csv`
    there says what was
expected.
"""

import shlex
from pathlib import Path

from echolearn.storage import files, manifests
from echolearn.storage.marked_page import Markers, around, between, write_between
from echolearn.studies import expected

EXPECTED = Markers(
    "<!-- expected: written by `echolearn study` -->", "<!-- end of expected -->", "page"
)


def markers(name: str) -> Markers:
    """Return the lines between which a page has the study of that name."""
    return Markers(
        f"<!-- study {name}: written by `echolearn study` -->",
        f"<!-- end of study {name} -->",
        "page",
    )


def check_page(page: Path, name: str) -> None:
    """Raise `BadValue` unless the page has the markers of that study."""
    around(page, markers(name))


def publish(folder: Path, page: Path) -> None:
    """Put a finished study into a page, its figures beside it, and what was expected if the page
    has its markers.

    Args:
        folder: the study's.
        page: Markdown with the markers of the study's name.

    Raises:
        BadValue: a damaged study, a page without the markers, or expectations that cannot be read.
    """
    write_between(page, section(folder, page), markers(folder.name))
    if EXPECTED.begin in page.read_text():
        expectations = expected.read(page.parent / page.stem / "expected.csv")
        before = between(page, EXPECTED)
        write_between(page, expected.table(expectations, folder.parent, before=before), EXPECTED)


def section(folder: Path, page: Path) -> str:
    """Return a study's text for a page, and copy its table and figures; a study of one value has
    none to show.
    """
    manifest = manifests.verify(folder)
    title, _, tables = (folder / "study.md").read_text().partition("\n")
    words = [
        word for word in shlex.split(manifest.get("command", "")) if not word.startswith("runs=")
    ]
    command = f" `{shlex.join(words)}`." if words else ""
    csv = copy(folder / "study.csv", page, f"{folder.name}.csv")
    lead = f"{title.partition(': ')[2].capitalize()}, over {manifest['study']['positions']} positions.{command}"
    lead += f" With all intervals: [{Path(csv).name}]({csv})."
    several = len(manifest["study"]["values"]) > 1
    pictures = [
        f"![{folder.name}: {path.stem.replace('_', ' ')}]({copy(path, page, f'{folder.name}_{path.name}')})"
        for path in sorted((folder / "figures").glob("*.svg"))
        if several
    ]
    return "\n\n".join([lead, *pictures, tables.strip()])


def copy(file: Path, page: Path, name: str) -> str:
    """Copy a file into the page's folder; return its place as seen from the page."""
    place = page.parent / page.stem / name
    files.write_atomic(place, file.read_bytes())
    return f"{page.stem}/{name}"
