"""What describes a recorded survey, `survey.yaml` and `poses.csv`, as a stranger writes them: all
of it is checked.
"""

import csv
import math
from collections import Counter
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from echolearn.acoustics.types import Array, Pose
from echolearn.checks import BadValue, check, check_number, check_whole
from echolearn.survey import audio

LIMITS = {"survey.yaml": 1 << 17, "poses.csv": 4 << 20}
"""Bytes that they may have."""

REQUIRED = ("sample_rate", "speed_of_sound", "microphones", "loudspeaker", "direct_path")
OPTIONAL = ("walls", "conditions")
SHAPES = {"microphones": (-1, 3), "loudspeaker": (3,)}
"""Keys of `survey.yaml`, and those that are coordinates."""

NEAR, FAR = 100.0, 10_000.0
"""m from the origin that something on a robot, and something in its room may be."""

NUMBERS = {
    **dict.fromkeys(("x_m", "y_m", "z_m"), (FAR, "m", "are they in mm?")),
    "heading_rad": (100.0, "rad", "is it in degrees?"),
}
"""Columns of `poses.csv` that hold numbers: the largest magnitude, its unit, and the likely
mistake."""

POINT = "are decimals set off by a point, cells by commas?"

CORNERS = "null, or 3 to 1000 distinct corners in order around an area"

UNKNOWN = "null, or no such key, where it is not known"

HEADER = ("index", "x_m", "y_m", "z_m", "heading_rad", "file")
"""Columns of `poses.csv`."""

DEPTH = 20
"""Brackets within brackets that `survey.yaml` may have; coordinates need two."""

DIGITS = 19
"""Of a pose's index: nanoseconds since 1970 have so many."""


def read_yaml(path: Path) -> dict[str, Any]:
    """Return the keys of `survey.yaml`, coordinates as arrays.

    Raises:
        BadValue: no YAML, or a key that is missing, unknown or malformed.
    """
    audio.check_size(path, LIMITS["survey.yaml"])
    try:
        content = _load(path.read_text(encoding="utf-8"))
    except BadValue as error:
        raise BadValue(f"{path} {error}") from None
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise BadValue(f"{path}: cannot be read ({' '.join(str(error).split())})") from None
    if isinstance(content, dict):
        _check_known(content, path)
    missing = [key for key in REQUIRED if not isinstance(content, dict) or key not in content]
    check(
        not missing,
        str(path),
        f"without {', '.join(missing)}",
        allowed=f"a mapping with {', '.join(REQUIRED)}",
    )
    present, conditions = content["direct_path"], content.get("conditions") or {}
    check(
        present in ("removed", "present"),
        f"{path} direct_path",
        present,
        allowed="removed or present",
    )
    _check_conditions(conditions, f"{path} conditions")
    check_number(
        f"{path} sample_rate", content["sample_rate"], low=1000.0, high=400_000.0, unit="Hz"
    )
    check_number(
        f"{path} speed_of_sound",
        content["speed_of_sound"],
        low=100.0,
        high=2000.0,
        unit="m/s",
        hint="air is 343 m/s",
    )
    told = {key: _metres(content[key], f"{path} {key}", shape) for key, shape in SHAPES.items()}
    if content.get("walls") is not None:
        told["walls"] = _outline(content["walls"], f"{path} walls")
    return {**content, **told}


def _load(text: str) -> Any:
    """Return what plain YAML holds, without aliases, every key once."""
    _check_plain(text)
    loader = yaml.SafeLoader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        _check_once(node)
        return loader.construct_document(node)
    finally:
        loader.dispose()


def _check_once(node: Any) -> None:
    """Raise `BadValue` for a key that is twice in a mapping, of which YAML would take the last."""
    pairs = node.value if isinstance(node, yaml.MappingNode) else ()
    for key, times in Counter(str(key.value) for key, _ in pairs).items():
        check(times == 1, "key", f"{key!a:.100}, {times} times", allowed="each key once")
    for _, value in pairs:
        _check_once(value)


def _check_conditions(conditions: Any, name: str) -> None:
    """Raise `BadValue` unless conditions are a mapping in which levels and pings, where known, are
    numbers.
    """
    check(isinstance(conditions, dict), name, conditions, allowed="a mapping")
    for key in ("snr_db", "sdnr_db"):
        if conditions.get(key) is not None:
            check_number(
                f"{name}.{key}", conditions[key], low=-200.0, high=200.0, unit="dB", hint=UNKNOWN
            )
    if conditions.get("pings") is not None:
        check_whole(f"{name}.pings", conditions["pings"], low=1)


def _check_plain(text: str) -> None:
    """Raise `ValueError` for YAML of little text that takes endless time or memory: deep nesting,
    and aliases.
    """
    depth = deepest = 0
    for character in text:
        depth += (character in "[{") - (character in "]}")
        deepest = max(deepest, depth)
    if deepest > DEPTH:
        raise ValueError(f"it is nested more than {DEPTH} deep")
    if any(isinstance(token, yaml.AliasToken) for token in yaml.scan(text)):
        raise ValueError("it holds an alias, *name, by which little text can become endless lists")


def _check_known(content: Mapping[Any, Any], path: Path) -> None:
    """Raise `BadValue` for the first key that means nothing, which may be one that is misspelt."""
    known = [*REQUIRED, *OPTIONAL]
    odd = next((str(key) for key in content if key not in known), None)
    near = get_close_matches(odd or "", known, n=1)
    hint = (
        f"did you mean {near[0]}?"
        if near
        else "what else is known of a recording goes into conditions"
    )
    shown = odd if odd is None or odd.isprintable() else ascii(odd)
    check(
        odd is None,
        f"{path} key",
        f"{shown:.100}" if shown else shown,
        allowed=", ".join(known),
        hint=hint,
    )


def _metres(value: Any, name: str, shape: tuple[int, ...], *, most: float = NEAR) -> Array:
    """Return lists of coordinates up to `most` m as an array of `shape`, in which -1 is any number
    but 0.
    """
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    fits = array.ndim == len(shape) and all(
        n == wanted or n > 0 > wanted for n, wanted in zip(array.shape, shape, strict=True)
    )
    axes = " x ".join("many" if wanted == -1 else str(wanted) for wanted in shape)
    check(
        fits and bool(np.isfinite(array).all()), name, value, allowed=f"{axes} finite numbers in m"
    )
    largest, allowed = float(np.abs(array).max()), f"coordinates from -{most:g} to {most:g} m"
    check(largest <= most, name, f"{largest:g} m", allowed=allowed, hint="are they in mm?")
    return array


def _outline(value: Any, name: str) -> Array:
    """Return the corners of a polygon, shape (C, 2); twice its area is the sum of x_k y_(k+1) -
    x_(k+1) y_k.
    """
    corners = _metres(value, name, (-1, 2), most=FAR)
    count, distinct = len(corners), len(np.unique(corners, axis=0))
    check(3 <= count <= 1000, name, f"{count} corners", allowed=CORNERS)
    check(
        distinct == count,
        name,
        f"{count - distinct} corners twice",
        allowed=CORNERS,
        hint="it closes by itself",
    )
    (x, y), (after_x, after_y) = (
        (corners - corners[0]).T,
        np.roll(corners - corners[0], -1, axis=0).T,
    )
    area = abs(float(np.sum(x * after_y - after_x * y))) / 2
    check(
        area >= 0.01,
        name,
        f"an area of {area:.2g} m^2",
        allowed=CORNERS,
        hint="do its sides cross each other?",
    )
    return corners


def read_poses(path: Path) -> tuple[tuple[int, ...], tuple[Pose, ...], tuple[str, ...]]:
    """Return index, pose and file of every row of `poses.csv`.

    Raises:
        BadValue: no table, no rows, or a cell that is missing or malformed, with its row as
            spreadsheets count.
    """
    audio.check_size(path, LIMITS["poses.csv"])
    try:
        rows = _rows(path)
    except BadValue:
        raise
    except (OSError, ValueError, csv.Error) as error:
        reason = " ".join(str(error).split())
        raise BadValue(
            f"{path}: cannot be read ({reason:.200}); its columns are {','.join(HEADER)}"
        ) from None
    check(len(rows) > 0, str(path), "no rows", allowed="at least one pose")
    poses = tuple(_pose(row, name) for name, row in rows.items())
    files = tuple(_file(row["file"], name) for name, row in rows.items())
    return _whole({name: str(row["index"] or "") for name, row in rows.items()}, path), poses, files


def _rows(path: Path) -> dict[str, dict[str, Any]]:
    """Return the rows of a table that has the columns `HEADER`, by what they are called in errors."""
    with path.open(newline="", encoding="utf-8-sig") as file:
        reader = csv.DictReader(file, skipinitialspace=True)
        columns = [name.strip() for name in reader.fieldnames or ()]
        missing = [name for name in HEADER if columns and name not in columns]
        allowed, hint = f"the columns {','.join(HEADER)}", "is it separated by commas?"
        check(not missing, str(path), f"without {', '.join(missing)}", allowed=allowed, hint=hint)
        reader.fieldnames = columns
        rows = {f"{path} row {reader.line_num}": row for row in reader}
    for name, row in rows.items():
        more = row.get(None)  # cells beyond the columns
        check(
            not any(more or ()),
            name,
            f"{len(columns) + len(more or ())} cells",
            allowed=f"{len(columns)}",
            hint=POINT,
        )
    return rows


def _pose(row: Mapping[str, Any], name: str) -> Pose:
    """Return the pose of a row, every number of which is finite and plausible."""
    numbers = []
    for column, (most, unit, hint) in NUMBERS.items():
        try:
            number = float(row[column] or "")
        except ValueError:
            number, hint = math.nan, POINT
        shown, allowed = f"{row[column]!a:.60}", f"must be a number from -{most:g} to {most:g} {unit}"
        check(abs(number) <= most, f"{name} {column}", shown, allowed=allowed, hint=hint)
        numbers.append(number)
    return Pose(np.array(numbers[:3]), numbers[3])


def _file(cell: str | None, name: str) -> str:
    """Return the cell of the column `file`."""
    allowed = "the name of a recording, which can be printed"
    check(bool(cell) and str(cell).isprintable(), f"{name} file", f"{cell!a:.100}", allowed=allowed)
    return str(cell)


def _whole(numbers: Mapping[str, str], path: Path) -> tuple[int, ...]:
    """Return the cells of the column `index` as numbers."""
    allowed, hint = f"whole numbers of at most {DIGITS} digits", "they name the poses in map.csv"
    for name, cell in numbers.items():
        plain = cell.isascii() and cell.isdigit() and len(cell) <= DIGITS
        check(plain, f"{name} index", f"{cell!a:.100}", allowed=allowed, hint=hint)
    whole = [int(number) for number in numbers.values()]
    [(most, times)] = Counter(whole).most_common(1)
    check(
        times == 1, f"{path} index", f"{most}, {times} times", allowed="each number once", hint=hint
    )
    return tuple(whole)
