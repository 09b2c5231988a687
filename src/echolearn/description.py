"""What describes a recorded survey, `survey.yaml` and `poses.csv`, as a stranger writes them: all of it is checked."""

import csv
from collections import Counter
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from echolearn import audio
from echolearn.types import Array, BadValue, Pose, check, check_number, check_whole

LIMITS = {"survey.yaml": 1 << 17, "poses.csv": 4 << 20}
"""Bytes that they may have."""

REQUIRED = ("sample_rate", "speed_of_sound", "microphones", "loudspeaker", "direct_path")
OPTIONAL = ("walls", "conditions")
"""Keys of `survey.yaml`."""

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
        text = path.read_text()
        _check_plain(text)
        content = yaml.safe_load(text)
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise BadValue(f"{path}: cannot be read ({' '.join(str(error).split())})") from None
    missing = [key for key in REQUIRED if not isinstance(content, dict) or key not in content]
    check(not missing, str(path), f"without {', '.join(missing)}", allowed=f"a mapping with {', '.join(REQUIRED)}")
    _check_known(content, path)
    present, conditions = content["direct_path"], content.get("conditions") or {}
    check(present in ("removed", "present"), f"{path} direct_path", present, allowed="removed or present")
    _check_conditions(conditions, f"{path} conditions")
    check_number(f"{path} sample_rate", content["sample_rate"], low=1000.0, high=400_000.0, unit="Hz")
    check_number(
        f"{path} speed_of_sound", content["speed_of_sound"], low=100.0, high=2000.0, unit="m/s", hint="air is 343 m/s"
    )
    shapes = {"microphones": (-1, 3), "loudspeaker": (3,)} | ({"walls": (-1, 2)} if content.get("walls") else {})
    return {**content, **{key: _metres(content[key], f"{path} {key}", shape) for key, shape in shapes.items()}}


def _check_conditions(conditions: Any, name: str) -> None:
    """Raise `BadValue` unless conditions are a mapping in which levels and pings, where known, are numbers."""
    check(isinstance(conditions, dict), name, conditions, allowed="a mapping")
    for key in ("snr_db", "sdnr_db"):
        if conditions.get(key) is not None:
            check_number(f"{name}.{key}", conditions[key], low=-200.0, high=200.0, unit="dB", hint=UNKNOWN)
    if conditions.get("pings") is not None:
        check_whole(f"{name}.pings", conditions["pings"], low=1)


def _check_plain(text: str) -> None:
    """Raise `ValueError` for YAML of little text that takes endless time or memory: deep nesting, and aliases."""
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
    hint = f"did you mean {near[0]}?" if near else "what else is known of a recording goes into conditions"
    shown = odd if odd is None or odd.isprintable() else ascii(odd)
    check(odd is None, f"{path} key", f"{shown:.100}" if shown else shown, allowed=", ".join(known), hint=hint)


def _metres(value: Any, name: str, shape: tuple[int, ...]) -> Array:
    """Return lists of coordinates as an array of `shape`, in which -1 is any number but 0."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        array = np.empty(0)
    fits = array.ndim == len(shape) and all(
        n == wanted or n > 0 > wanted for n, wanted in zip(array.shape, shape, strict=True)
    )
    axes = " x ".join("many" if wanted == -1 else str(wanted) for wanted in shape)
    check(fits and bool(np.isfinite(array).all()), name, value, allowed=f"{axes} finite numbers in m")
    return array


def read_poses(path: Path) -> tuple[tuple[int, ...], tuple[Pose, ...], tuple[str, ...]]:
    """Return index, pose and file of every row of `poses.csv`.

    Raises:
        BadValue: no table, no rows, or a cell that is missing or malformed.
    """
    audio.check_size(path, LIMITS["poses.csv"])
    try:
        with path.open(newline="") as file:
            rows = list(csv.DictReader(file))
        poses = tuple(
            Pose(np.array([float(r["x_m"]), float(r["y_m"]), float(r["z_m"])]), float(r["heading_rad"])) for r in rows
        )
        files = tuple(str(row["file"] or "") for row in rows)
        numbers = [str(row["index"] or "") for row in rows]
    except (OSError, KeyError, TypeError, ValueError, csv.Error) as error:
        raise BadValue(f"{path}: cannot be read ({error!r:.200}); its columns are {','.join(HEADER)}") from None
    check(len(poses) > 0, str(path), "no rows", allowed="at least one pose")
    finite = all(np.isfinite([*pose.position, pose.heading]).all() for pose in poses)
    check(finite, str(path), "NaN or infinity", allowed="finite positions and headings")
    check(all(files), str(path), "a row without file", allowed=f"the columns {','.join(HEADER)} in every row")
    odd = next((ascii(file)[:100] for file in files if not file.isprintable()), None)
    check(odd is None, f"{path} file", odd, allowed="names that can be printed")
    return _whole(numbers, path), poses, files


def _whole(numbers: Sequence[str], path: Path) -> tuple[int, ...]:
    """Return the cells of the column `index` as numbers."""
    odd = next((n for n in numbers if not (n.isascii() and n.isdigit() and len(n) <= DIGITS)), None)
    allowed, hint = f"whole numbers of at most {DIGITS} digits", "they name the poses in map.csv"
    check(odd is None, f"{path} index", f"{odd!a:.100}", allowed=allowed, hint=hint)
    whole = [int(number) for number in numbers]
    [(most, times)] = Counter(whole).most_common(1)
    check(times == 1, f"{path} index", f"{most}, {times} times", allowed="each number once", hint=hint)
    return tuple(whole)
