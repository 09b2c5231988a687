"""The report of a comparison: one HTML page that opens offline, the table of terminal and README.

Every number in the page is computed from the comparison; the sentences around them are written so
that they hold whatever the numbers are.
"""

import platform
import re
import sys
from base64 import b64encode
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from hashlib import sha256
from importlib.metadata import version
from os import cpu_count
from pathlib import Path
from typing import Any

from echolearn.comparison.choice import Comparison
from echolearn.comparison.examined import Examined, examined_facts
from echolearn.comparison.glossary import GLOSSARY, MAP_WORDS
from echolearn.comparison.looks import looks_of
from echolearn.comparison.shown import ANSWER_COLUMNS, DotPanel, Shown, answer_rows, conditions
from echolearn.comparison.tables import gather
from echolearn.comparison.template import number, template, template_text
from echolearn.evaluation.rows import to_csv
from echolearn.robot.pages import inline_svg, page_head
from echolearn.storage.manifests import Contents
from echolearn.storage.marked_page import Markers, write_beside, write_between

FORMAT = 12
"""Version of the report and the tables; part of a comparison's identity."""

LIBRARIES = "numpy scipy scikit-learn torch lightning onnxruntime pyroomacoustics".split()
"""Libraries whose versions the report tells."""

RESULTS = Markers(
    "<!-- results: written by `echolearn compare` -->", "<!-- end of results -->", "readme"
)
"""Lines of a README between which the results table stands."""

SHOWN = ("table.md", "figures/maps_first.svg")
"""Files of a comparison that are printed or put beside a README, the better picture first."""


def make(
    comparison: Comparison,
    *,
    shown: Shown,
    drawings: Mapping[str, str],
    name: str,
    examined: Examined,
) -> dict[str, bytes]:
    """Return the report's files by name: `report.html`, `table.md` and `figures/*.svg`.

    Args:
        comparison: what was found.
        shown: answers and maps.
        drawings: SVG of each figure by name (`drawings.draw_all`).
        name: of the comparison.
        examined: what is known of it besides.
    """
    facts = gather(comparison) | examined_facts(examined, comparison) | {"name": name}
    page = report_page(comparison, facts, shown=shown, drawings=drawings)
    table = template("table.md").render(**facts)
    files = {"report.html": page.encode(), "table.md": table.encode()}
    files["answer.csv"] = to_csv(answer_rows(shown.answers), ANSWER_COLUMNS)
    return files | {f"figures/{figure}.svg": svg.encode() for figure, svg in drawings.items()}


def report_page(
    comparison: Comparison,
    facts: Mapping[str, Any],
    *,
    shown: Shown,
    drawings: Mapping[str, str],
) -> str:
    """Return the page.

    Args:
        comparison: what was found.
        facts: what the tables show.
        shown: answers and maps.
        drawings: SVG of each figure by name.
    """
    script = template_text("report.js")
    # Nothing but this very script may run, whatever a name on the page may hold.
    proof = b64encode(sha256(script.encode()).digest()).decode()
    panels = [{**each._asdict(), "told": _told(each)} for each in conditions(comparison)]
    images: dict[str, Callable[[str], str]] = {
        name: partial(_image, svg, name) for name, svg in drawings.items()
    }
    return template("report.html").render(
        facts,
        head=page_head(),
        style=template_text("report.css"),
        script=script,
        script_hash=f"sha256-{proof}",
        answers=shown.answers,
        conditions=panels,
        pairs=shown.pairs if facts["rooms"] else [],
        images=images,
        looks=looks_of(comparison.models),
        glossary=GLOSSARY,
        map_words=MAP_WORDS,
        machine=machine(),
    )


def _image(svg: str, name: str, text: str) -> str:
    return inline_svg(svg, name=name, text=text)


def _told(condition: DotPanel) -> str:
    """Return a panel of the dot plot in words, the largest figure first."""
    order = sorted(condition.rows, key=lambda row: -float(row["value"]))
    return ", ".join(f"{row['classifier']} {number(row['value'])}" for row in order)


def machine() -> dict[str, str]:
    """Describe the machine and the libraries."""
    models = []
    with suppress(OSError):
        models = re.findall(r"model name\s*:\s*(.+)", Path("/proc/cpuinfo").read_text())
    processor = next(iter(models), platform.processor() or platform.machine())
    return {
        "processor": f"{processor}, {cpu_count()} cores",
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "libraries": ", ".join(f"{name} {version(name)}" for name in LIBRARIES),
    }


def show(found: Contents, *, folder: Path, readme: Path | None) -> None:
    """Print the results table and the report's path; put table and map into a README.

    The map, beside the README, is that of the lowest SNR, where filtering earns most.

    Args:
        found: those files of `SHOWN` that there are.
        folder: of the comparison.
        readme: the file; None leaves it.
    """
    table = found[SHOWN[0]].decode()
    sys.stdout.write(table)
    print(f"\n{folder / 'report.html'}")
    if readme is None:
        return
    write_between(readme, table, markers=RESULTS)
    pictures = [found[name] for name in SHOWN[1:] if name in found]
    if pictures:
        write_beside(Path(readme).parent / "docs" / "before_after.svg", pictures[0])
