"""The report of a comparison: one HTML page that opens offline, the table of terminal and README.

Every number in the page is computed from the comparison; the sentences around them are written so
that they hold whatever the numbers are.
"""

import platform
import re
import sys
from base64 import b64encode
from collections.abc import Mapping
from contextlib import suppress
from importlib.metadata import version
from os import cpu_count
from pathlib import Path

from echolearn.comparison.choice import Comparison
from echolearn.comparison.examined import Examined, examined_facts
from echolearn.comparison.tables import gather
from echolearn.comparison.template import template
from echolearn.storage.manifests import Contents
from echolearn.storage.marked_page import Markers, write_beside, write_between

FORMAT = 10
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
    drawings: Mapping[str, str],
    name: str,
    examined: Examined = Examined(),  # noqa: B008, a frozen value
) -> dict[str, bytes]:
    """Return the report's files by name: `report.html`, `table.md` and `figures/*.svg`.

    Args:
        comparison: what was found.
        drawings: SVG of each figure by name (`drawings.draw_all`).
        name: of the comparison.
        examined: what is known of it besides.
    """
    files = {}
    images = {}
    for figure, svg in drawings.items():
        files[f"figures/{figure}.svg"] = svg.encode()
        # Within the page, so that it needs no other file.
        images[figure] = "data:image/svg+xml;base64," + b64encode(svg.encode()).decode()
    facts = gather(comparison) | examined_facts(examined, comparison) | {"name": name}
    page = template("report.html").render(images=images, machine=machine(), **facts)
    table = template("table.md").render(**facts)
    return {"report.html": page.encode(), "table.md": table.encode()} | files


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
