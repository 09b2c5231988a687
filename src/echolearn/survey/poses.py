"""The table of a recorded survey, `poses.csv`: read as a stranger writes it, and written.

    index,x_m,y_m,z_m,heading_rad,file[,pose_sd_m][,heading_sd_rad]
        [,loudspeaker_x_m,loudspeaker_y_m,loudspeaker_z_m]

A row is a pose. `CELLS`, `ERRORS` and `APART` name the columns, each with the function that reads a
cell of it; further columns are kept as they are. Rows without a single cell, as spreadsheets leave
them, are none. Errors count rows as spreadsheets do.
"""

import csv
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple, TextIO

import numpy as np

from echolearn.acoustics.types import Array, Pose
from echolearn.checks import BadValue, check
from echolearn.storage.files import one_line
from echolearn.survey.audio import check_size
from echolearn.survey.floor_plan import IN_ROOM
from echolearn.survey.walked import check_walk

LARGEST_CSV = 4 << 20
"""Bytes that `poses.csv` may have."""

FAR = 100_000.0
"""m; eastings of UTM begin at 166 000, a room of so many millimetres is a hall of 100 m."""

ABSENT = ("", "nan", "na", "n/a", "null", "none", "value!", "ref!", "div/0!", "inf", "infinity")
"""Cells, without # and signs, of a pose that is not known."""

DIGITS = 19
"""Digits of a pose's index: nanoseconds since 1970 have so many."""

BY_POINT = "are decimals set off by a point, cells by commas?"
ALONE = "write the number alone, decimals set off by a point"
DASHES = ("\u2212", "\u2013", "\u2014")
DASH = "is its sign a dash? A minus is written -"
UNKNOWN = "remove the row of a pose that is not known"
DEGREES = "is it in degrees?"
MAP_FRAME = "are they UTM, or in mm? Count metres from a corner of the room"
NAMES = "they name the poses in map.csv"


def read_number(
    name: str, cell: Any, *, most: float, unit: str, hint: str, least: float | None = None
) -> float:
    """Return a cell as a number of at most that magnitude.

    Args:
        name: what the cell is called in errors.
        cell: its text, or None where a row is too short.
        most: largest magnitude.
        unit: unit of the number.
        hint: the likely mistake if it is larger.
        least: smallest number, `-most` unless given.
    """
    low = -most if least is None else least
    text = str(cell or "").strip()
    try:
        # Python itself would take 1_0 for ten.
        number = float(text.replace("_", " "))
    except ValueError:
        number = math.nan
        hint = DASH if text[:1] in DASHES else BY_POINT if "," in text else ALONE
    if not math.isfinite(number) and text.strip("#+-").lower() in ABSENT:
        hint = UNKNOWN
    elif text.endswith(("\u00b0", "deg")):
        hint = DEGREES
    elif unit == "m" and abs(number) >= FAR:
        hint = MAP_FRAME
    allowed = f"must be a number from {low:g} to {most:g} {unit}"
    check(low <= number <= most, name, f"{cell!a:.60}", allowed=allowed, hint=hint)
    return number


def read_index(name: str, cell: Any) -> int:
    """Return a cell as the number that names a pose."""
    text = str(cell or "")
    plain = text.isascii() and text.isdigit() and len(text) <= DIGITS
    allowed = f"must be whole numbers of at most {DIGITS} digits"
    check(plain, name, f"{text!a:.100}", allowed=allowed, hint=NAMES)
    return int(text)


def read_name(name: str, cell: Any) -> str:
    """Return a cell as the name of a recording."""
    allowed = "must be the name of a recording, which can be printed"
    check(bool(cell) and cell.isprintable(), name, f"{cell!a:.100}", allowed=allowed)
    return str(cell)


METRES = partial(read_number, most=IN_ROOM, unit="m", hint="are they in mm?")

CELLS: dict[str, Callable[[str, Any], Any]] = {
    "index": read_index,
    "x_m": METRES,
    "y_m": METRES,
    "z_m": METRES,
    "heading_rad": partial(read_number, most=100.0, unit="rad", hint=DEGREES),
    "file": read_name,
}
"""Columns of `poses.csv`."""

ERRORS: dict[str, Callable[[str, Any], Any]] = {
    "pose_sd_m": partial(read_number, least=0.0, most=10.0, unit="m", hint="is it in mm?"),
    "heading_sd_rad": partial(
        read_number, least=0.0, most=np.pi, unit="rad", hint="is it in degrees?"
    ),
}
"""Columns that `poses.csv` may have: how far a pose may be off, one standard deviation."""


APART: dict[str, Callable[[str, Any], Any]] = {
    "loudspeaker_x_m": METRES,
    "loudspeaker_y_m": METRES,
    "loudspeaker_z_m": METRES,
}
"""Columns that `poses.csv` has, all three, where the loudspeaker moves on its own: its place in the
room's frame; `x_m`, `y_m`, `z_m` are then of the origin of the robot's frame."""


class Poses(NamedTuple):
    """What `poses.csv` holds, a row for each of P poses.

    Attributes:
        numbers: `index`.
        poses: where the robot stood.
        files: recordings, relative to the survey's folder.
        loudspeakers: places of a loudspeaker that moves on its own, shape (P, 3), in m, or None.
        further: cells of all other columns, by name, as texts.
    """

    numbers: tuple[int, ...]
    poses: tuple[Pose, ...]
    files: tuple[str, ...]
    loudspeakers: Array | None
    further: Mapping[str, tuple[str, ...]]


def read_poses(path: Path) -> Poses:
    """Return what every row of `poses.csv` says.

    Raises:
        BadValue: no table, no rows, or a cell that is missing or malformed, with its row as
            spreadsheets count.
    """
    check_size(path, LARGEST_CSV)
    try:
        rows = list(_rows(path))
    except BadValue:
        raise
    except (OSError, ValueError, csv.Error) as error:
        reason = f"{one_line(error):.200}"
        if isinstance(error, UnicodeDecodeError):
            reason = "it is not UTF-8; save it as CSV UTF-8"
        columns = ",".join(CELLS)
        raise BadValue(f"{path}: cannot be read ({reason}); its columns are {columns}") from None
    check(len(rows) > 0, str(path), "no rows", allowed="must hold at least one pose")

    # Compared as numbers: 3 and 03 name the same pose.
    numbers = tuple(row["index"] for row in rows)
    [(most, times)] = Counter(numbers).most_common(1)
    allowed = "must have each number once"
    check(times == 1, f"{path} index", f"{most}, {times} times", allowed=allowed, hint=NAMES)
    check_walk(str(path), sorted(rows, key=lambda row: row["index"]))
    return poses_of(rows)


def poses_of(rows: Sequence[Mapping[str, Any]]) -> Poses:
    """Return what rows of `poses.csv` say, one at least, as `row_cells` reads them."""
    known = {*CELLS, *ERRORS, *APART}
    apart = None
    if "loudspeaker_x_m" in rows[0]:
        apart = np.array([[row[name] for name in APART] for row in rows])
    return Poses(
        tuple(row["index"] for row in rows),
        tuple(map(_pose, rows)),
        tuple(row["file"] for row in rows),
        apart,
        {name: tuple(row[name] for row in rows) for name in rows[0] if name not in known},
    )


def _pose(row: Mapping[str, Any]) -> Pose:
    place = np.array([row["x_m"], row["y_m"], row["z_m"]])
    return Pose(place, row["heading_rad"], *(row.get(name, 0.0) for name in ERRORS))


def _rows(path: Path) -> Iterator[Mapping[str, Any]]:
    """Yield the cells of each row of a file."""
    # Spreadsheets may begin a file with a byte order mark, which is no part of the first name.
    with path.open(newline="", encoding="utf-8-sig") as file:
        yield from row_cells(path, file)


def row_cells(path: Path, file: TextIO, *, before: int = 0) -> Iterator[Mapping[str, Any]]:
    """Yield the cells of each row of a table that has the columns of `CELLS`, and any others.

    Args:
        path: what the table is called in errors.
        file: its text, from the names of the columns on.
        before: rows between these and the first that was read.

    Raises:
        BadValue: as `read_poses`.
    """
    # Excel's first line, which names the mark between cells, is no row.
    above = int(file.readline(99).lower().startswith("sep="))
    if not above:
        file.seek(0)
    table = csv.DictReader(file, skipinitialspace=True)
    columns = [name.strip() for name in table.fieldnames or ()]
    missing = [name for name in CELLS if columns and name not in columns]
    allowed = f"must have the columns {','.join(CELLS)}"
    hint = _about_columns(columns, missing)
    check(not missing, str(path), f"without {', '.join(missing)}", allowed=allowed, hint=hint)
    [(most, times)] = Counter(filter(None, columns)).most_common(1) or [("", 0)]
    allowed = "must have each column once"
    check(times < 2, str(path), f"column {most!a:.60}, {times} times", allowed=allowed)
    table.fieldnames = columns
    lacking = [name for name in APART if name not in columns]
    allowed = f"must have all of {', '.join(APART)}, or none"
    check(len(lacking) in (0, 3), str(path), f"without {', '.join(lacking)}", allowed=allowed)
    optional = ERRORS | APART
    cells = CELLS | {name: read for name, read in optional.items() if name in columns}
    further = [name for name in columns if name and name not in cells]
    for row in table:
        name = f"{path} row {table.line_num + above + before}"
        beyond = row.pop(None, [])
        if not any(map(str.strip, filter(None, [*row.values(), *beyond]))):
            continue
        count = f"{len(columns) + len(beyond)} cells"
        check(not any(beyond), name, count, allowed=f"must be {len(columns)} cells", hint=BY_POINT)
        found = {key: read(f"{name} {key}", row[key]) for key, read in cells.items()}
        yield found | {column: str(row[column] or "").strip() for column in further}


def _about_columns(columns: Sequence[str], missing: Sequence[str]) -> str:
    """Return the likely mistake where columns are missing.

    Args:
        columns: what stands in the first row.
        missing: names that are not among them.
    """
    small = [name.lower() for name in columns]
    if all(name in small for name in missing):
        return "write them in small letters"
    if len(columns) < len(CELLS):
        marks = {";": "semicolons", "\t": "tabs", "#": "comments before it"}
        found = [f" There are {name}" for mark, name in marks.items() if mark in "".join(columns)]
        return f"is it separated by commas?{''.join(found[:1])}"
    if "heading_rad" in missing and any(re.search("deg|yaw|theta", name) for name in small):
        return "headings are in rad, counter-clockwise from x; write it so, and name it heading_rad"
    numbers = sum(name.lstrip("+-").replace(".", "", 1).isdigit() for name in columns)
    return "does the first row name the columns?" if numbers > 2 else "are they named otherwise?"


def poses_csv(
    poses: Sequence[Pose],
    files: Sequence[str],
    *,
    further: Mapping[str, Sequence[object]] | None = None,
) -> bytes:
    """Return the text of `poses.csv`.

    Args:
        poses: P poses.
        files: their recordings.
        further: P cells of other columns, by name.
    """
    text = StringIO()
    rows = csv.writer(text, lineterminator="\n")
    others = further or {}
    rows.writerow([*CELLS, *others])
    for index, (pose, file) in enumerate(zip(poses, files, strict=True)):
        own = [index, *map(float, pose.position), float(pose.heading), file]
        rows.writerow([*own, *(column[index] for column in others.values())])
    return text.getvalue().encode()
