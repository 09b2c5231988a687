"""The folder of a live map: `map.csv`, to which every pose adds its rows, and what it is made from.

    live.json    what the rows were made from: bundle, description of the survey, what was asked
    map.csv      the columns of a map's `map.csv`, a row an echo, in the order of their arrival

The rows of a pose are written by one call, so that a killed command leaves all of them, or a part
that is cut off when it goes on. Of a power cut the last poses may be lost: they are mapped again.
"""

import hashlib
import os
from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from echolearn.checks import BadValue
from echolearn.mapping.files.table import COLUMNS
from echolearn.storage.files import load_json, save_json, unwritable
from echolearn.survey.survey import CALIBRATION, NOISE, Survey

DESCRIBED_BY = ("survey.yaml", "probe.wav", NOISE, CALIBRATION)
"""Files of a survey besides its rows and recordings."""

INPUTS = "live.json"
TABLE = "map.csv"


class MappedEcho(NamedTuple):
    """An echo of `map.csv`, as far as a live map needs it.

    Attributes:
        point: x and y, in m; NaN where echoes are not placed.
        confidence: 0 to 1.
        kept: whether it is believed.
        upright: whether it comes from floor or ceiling.
    """

    point: tuple[float, float]
    confidence: float
    kept: bool
    upright: bool


Done = dict[int, list[MappedEcho]]
"""Echoes of the poses that were mapped, by the poses' numbers."""


def live_inputs(walk: Survey, bundle: Mapping[str, Any], *, asked: Mapping[str, Any]) -> Any:
    """Return what the rows of a live map are made from.

    Args:
        walk: the survey.
        bundle: what its `bundle.json` says.
        asked: keys that make other rows.
    """
    sums = hashlib.sha256()
    for name in DESCRIBED_BY:
        with suppress(FileNotFoundError):
            sums.update(f"{name} ".encode() + (walk.folder / name).read_bytes())
    given = {key: value for key, value in asked.items() if value is not None}
    return {"asked": given, "bundle": bundle["sha256"], "survey": sums.hexdigest()}


class LiveFolder:
    """The table of a live map, open for new rows.

    Attributes:
        folder: where it lies.
        done: echoes of the poses that another command had mapped; emptied as they are taken over.
        replaced: whether rows that were made from something else were thrown away.
    """

    def __init__(self, folder: Path, inputs: Any) -> None:
        self.folder = folder
        self.done: Done = {}
        self.replaced = False
        path = folder / TABLE
        try:
            folder.mkdir(parents=True, exist_ok=True)
            same = False
            with suppress(BadValue):
                same = load_json(folder / INPUTS) == inputs
            whole = 0
            if path.exists() and same:
                self.done, whole = read_rows(path)
            self.replaced = path.exists() and not same
            save_json(folder / INPUTS, inputs)
            self._file = path.open("ab", buffering=0)
            self._file.truncate(whole)
            if not whole:
                self._file.write(",".join(COLUMNS).encode() + b"\n")
        except OSError as error:
            raise unwritable(path, error) from error

    def append(self, rows: bytes) -> None:
        """Append the rows of a pose.

        Raises:
            BadValue: the disk is full, or the folder is not there any more.
        """
        try:
            # One call: what a killed command leaves of it is cut off when it goes on.
            os.write(self._file.fileno(), rows)
        except OSError as error:
            raise unwritable(self.folder / TABLE, error) from error

    def close(self) -> None:
        """Let everything reach the disk."""
        os.fsync(self._file.fileno())
        self._file.close()


def read_rows(path: Path) -> tuple[Done, int]:
    """Return the echoes of a live map's table by pose, and how many of its bytes are whole rows."""
    found: Done = defaultdict(list)
    whole = 0
    with path.open("rb") as file:
        for number, line in enumerate(file):
            cells = line.decode("ascii", "replace").rstrip("\n").split(",")
            if not line.endswith(b"\n") or len(cells) != len(COLUMNS):
                break
            if number:
                try:
                    found[int(cells[0])].append(_echo(cells))
                except ValueError:
                    break
            whole += len(line)
    return found, whole


def _echo(cells: Sequence[str]) -> MappedEcho:
    """Return the echo of a row."""
    row = dict(zip(COLUMNS, cells, strict=True))
    x, y = (float(row[name] or "nan") for name in ("x_m", "y_m"))
    kept, upright = (row[name] == "1" for name in ("kept", "floor_or_ceiling"))
    return MappedEcho((x, y), float(row["confidence"]), kept, upright)
