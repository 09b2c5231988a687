"""The report of a comparison: one HTML page that opens offline, the table of terminal and README.

Every number in the page is computed from the comparison; the sentences around them are written so
that they hold whatever the numbers are.
"""

import platform
import re
import sys
from base64 import b64encode
from contextlib import suppress
from importlib import resources
from importlib.metadata import version
from os import cpu_count
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.comparison.choice import Comparison
from echolearn.comparison.tables import gather
from echolearn.evaluation.rows import Row
from echolearn.storage.files import write_atomic
from echolearn.storage.marked_page import Markers, write_between

FORMAT = 8
"""Version of the report and the tables; part of a comparison's identity."""

LIBRARIES = "numpy scipy scikit-learn torch lightning onnxruntime pyroomacoustics".split()
"""Libraries whose versions the report tells."""

RESULTS = Markers(
    "<!-- results: written by `echolearn compare` -->", "<!-- end of results -->", "readme"
)
"""Lines of a README between which the results table stands."""


def make(comparison: Comparison, *, name: str) -> dict[str, bytes]:
    """Return the report's files by name: `report.html`, `table.md` and `figures/*.svg`."""
    from echolearn.comparison.drawings import draw_all

    files = {}
    images = {}
    for figure, svg in draw_all(comparison).items():
        files[f"figures/{figure}.svg"] = svg.encode()
        # Within the page, so that it needs no other file.
        images[figure] = "data:image/svg+xml;base64," + b64encode(svg.encode()).decode()
    facts = gather(comparison) | {"name": name}
    page = template("report.html").render(images=images, machine=machine(), **facts)
    table = template("table.md").render(**facts)
    return {"report.html": page.encode(), "table.md": table.encode()} | files


def template(name: str, *, room: str = "comparison") -> Any:
    """Return a template of a room, with the filters that format numbers."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(
        undefined=StrictUndefined,
        autoescape=name.endswith(".html"),
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {each.__name__: each for each in (number, interval, signed, shade)}
    text = (resources.files(f"echolearn.{room}") / "templates" / name).read_text()
    return environment.from_string(text)


def number(value: Any, scale: float = 1.0, digits: int = 2) -> str:
    """Return a figure, scaled; nothing where there is none.

    Args:
        value: figure, or nothing.
        scale: factor that it is shown with.
        digits: decimals.
    """
    return "" if value in ("", None) or np.isnan(value) else f"{scale * value:.{digits}f}"


def interval(row: Row | None, scale: float = 1.0, digits: int = 2) -> str:
    """Return `value [low, high]` of a row, scaled; nothing where there is none.

    Args:
        row: figure with its interval, or None.
        scale: factor that all three are shown with.
        digits: decimals.
    """
    if row is None:
        return ""
    value, low, high = (number(row[key], scale, digits) for key in ("value", "ci_low", "ci_high"))
    return f"{value} [{low}, {high}]" if value and low else value


def signed(test: Row, *, scale: float = 100.0, digits: int = 1) -> str:
    """Return a paired difference as `+value [low, high]`, scaled.

    Args:
        test: row of tests.csv.
        scale: factor that all three are shown with.
        digits: decimals.
    """
    value, low, high = (
        f"{scale * test[key]:+.{digits}f}" for key in ("difference", "ci_low", "ci_high")
    )
    return f"{value} [{low}, {high}]"


def shade(value: float) -> str:
    """Return the background of a table cell for an AUC: red below 0.5, blue above."""
    strength = min(abs(value - 0.5) / 0.5, 1.0)
    colour = "0, 114, 178" if value >= 0.5 else "213, 94, 0"
    return f"rgba({colour}, {0.42 * strength:.2f})"


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


def show(folder: Path, *, readme: Path | None) -> None:
    """Print the results table and the report's path; put table and map into a README.

    The map, beside the README, is that of the lowest SNR, where filtering earns most.
    """
    table = (folder / "table.md").read_text()
    sys.stdout.write(table)
    print(f"\n{folder / 'report.html'}")
    if readme is None:
        return
    write_between(readme, table, markers=RESULTS)
    for name in ("maps_last.svg", "maps_first.svg"):
        picture = folder / "figures" / name
        if picture.is_file():
            place = Path(readme).parent / "docs" / "before_after.svg"
            write_atomic(place, picture.read_bytes())
            break
