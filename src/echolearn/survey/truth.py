"""The true echoes of a recorded survey, `truth.csv`: read as a stranger writes it, and written.

    index,toa_s,azimuth_rad,elevation_rad

A row is an echo; `index` is that of its pose in `poses.csv`, which may have several, or none.
Times count from the beginning of the recording, directions are in the robot's frame. A direction
that is not known has empty cells.
"""

import csv
import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.types import Truth
from echolearn.checks import BadValue, check
from echolearn.storage.files import one_line
from echolearn.survey.audio import check_size
from echolearn.survey.poses import DEGREES, read_index, read_number

TRUTH = "truth.csv"

LARGEST_TRUTH = 32 << 20
"""Bytes that `truth.csv` may have."""

TIME = partial(read_number, least=0.0, most=10.0, unit="s", hint="is it in samples or ms?")
AZIMUTH = partial(read_number, most=2 * math.pi, unit="rad", hint=DEGREES)
ELEVATION = partial(read_number, least=0.0, most=math.pi, unit="rad", hint=DEGREES)

COLUMNS = {"toa_s": TIME, "azimuth_rad": AZIMUTH, "elevation_rad": ELEVATION}
"""Columns besides `index`, each with what reads a cell."""

MAY_BE_EMPTY = ("azimuth_rad", "elevation_rad")


def read_truth(path: Path, numbers: Sequence[int]) -> tuple[Truth, ...]:
    """Return the true echoes of each pose.

    Args:
        path: the table.
        numbers: `index` of each pose.

    Raises:
        BadValue: no table, or a cell that is missing or malformed, with its row.
    """
    check_size(path, LARGEST_TRUTH)
    known = set(numbers)
    found: dict[int, list[list[float]]] = defaultdict(list)
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            table = csv.DictReader(file, skipinitialspace=True)
            wanted = ["index", *COLUMNS]
            allowed = f"must be {','.join(wanted)}"
            hint = "is it separated by commas?"
            names = [name.strip() for name in table.fieldnames or ()]
            check(names == wanted, f"{path} columns", ",".join(names), allowed=allowed, hint=hint)
            table.fieldnames = names
            for row in table:
                place = f"{path} row {table.line_num}"
                count = len(wanted) + len(row.pop(None, []))
                check(count == len(wanted), place, f"{count} cells", allowed="must be 4 cells")
                number = read_index(f"{place} index", row["index"])
                allowed = "must be that of a pose in poses.csv"
                check(number in known, f"{place} index", number, allowed=allowed)
                found[number].append(_echo(place, row))
    except BadValue:
        raise
    except (OSError, ValueError, csv.Error) as error:
        raise BadValue(f"{path}: cannot be read ({one_line(error):.200})") from None
    return tuple(Truth(*np.reshape(found[number], (-1, 3)).T) for number in numbers)


def _echo(place: str, row: Mapping[str, Any]) -> list[float]:
    """Return time, azimuth and elevation of a row; NaN for a direction that is not known."""
    cells = []
    for name, read in COLUMNS.items():
        empty = name in MAY_BE_EMPTY and not str(row[name] or "").strip()
        cells.append(math.nan if empty else read(f"{place} {name}", row[name]))
    return cells


def truth_csv(truths: Sequence[Truth]) -> bytes:
    """Return the text of `truth.csv` for the echoes of poses 0, 1, 2 ..."""
    text = StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["index", *COLUMNS])
    for index, truth in enumerate(truths):
        for echo in zip(truth.toa, truth.azimuth, truth.elevation, strict=True):
            rows.writerow([index, *("" if math.isnan(cell) else float(cell) for cell in echo)])
    return text.getvalue().encode()
