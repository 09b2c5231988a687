"""An array of any shape, from a list or a file: checked before anything is simulated with it."""

import csv
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from echolearn.acoustics.types import Array, MicArray
from echolearn.checks import BadValue, check, check_metres, check_whole
from echolearn.survey.description import Loader

WIDEST = 2.0
"""m between two microphones of an array."""

SAME = 1e-3
"""m within which two microphones are at one place."""

CLOSEST = 5e-3
"""m from the loudspeaker to the nearest microphone."""


def placed_array(
    *,
    positions: Sequence[Sequence[float]] | None = None,
    file: str | None = None,
    loudspeaker: Sequence[float] = (0.0, 0.0, 0.0),
) -> MicArray:
    """Place 2 to 32 microphones, given by a list or a file, about a loudspeaker.

    Args:
        positions: microphones in any frame (x ahead, y left, z up), M x 3, in m; the first is the
            reference of times of arrival.
        file: the same as CSV, or as YAML, a list or the key `microphones` (and `loudspeaker`), as
            in `survey.yaml`.
        loudspeaker: in the same frame, in m; it becomes the frame's origin.

    Raises:
        BadValue: both or neither, a file that cannot be read, or places that no array has.
    """
    given = [name for name, each in (("positions", positions), ("file", file)) if each is not None]
    allowed = "must be array.positions, M x 3 in m, or array.file, and not both"
    check(len(given) == 1, "array", " and ".join(given) or "no places", allowed=allowed)
    name = "array.positions" if file is None else str(file)
    if file is not None:
        positions, beside = _read(Path(str(file)))
        loudspeaker = loudspeaker if beside is None else beside
    places = check_metres(name, positions, shape=(-1, 3))
    check_whole(name, len(places), low=2, high=32, unit="microphones")
    places = places - check_metres("array.loudspeaker", loudspeaker, shape=(3,))
    check_places(name, places)

    away = np.linalg.norm(places, axis=1)
    nearest = int(away.argmin())
    check(
        away[nearest] >= CLOSEST,
        name,
        f"microphone {nearest + 1} {1000 * away[nearest]:.1f} mm from the loudspeaker",
        allowed=f"must be {1000 * CLOSEST:g} mm or more from it",
        hint="where is it? array.loudspeaker=[x,y,z]",
    )
    return MicArray(places)


def check_places(name: str, places: Array) -> None:
    """Raise `BadValue` if microphones (M, 3) are at one place, or too far apart for one array."""
    for first, second in combinations(range(len(places)), 2):
        apart = float(np.linalg.norm(places[first] - places[second]))
        pair = f"microphones {first + 1} and {second + 1}"
        allowed = "must be different places"
        check(apart >= SAME, name, f"{pair} at one place", allowed=allowed, hint="a row twice?")
        shown = f"{pair} {apart:g} m apart"
        allowed = f"must be within {WIDEST:g} m of each other"
        check(apart <= WIDEST, name, shown, allowed=allowed, hint="are they in mm?")


def _read(path: Path) -> tuple[Any, Any]:
    """Return the places of a file and, if it names it, that of the loudspeaker."""
    try:
        text = path.read_text(encoding="utf-8")
        if path.suffix.lower() not in (".yaml", ".yml"):
            return _rows(text), None
        content = yaml.load(text, Loader=Loader)
    except (OSError, ValueError, yaml.YAMLError) as error:
        reason = " ".join(str(error).split())
        allowed = "must be CSV or YAML with three coordinates in m a microphone"
        raise BadValue(f"array.file={path}: {allowed}; {reason}") from None
    if isinstance(content, dict):
        return content.get("microphones"), content.get("loudspeaker")
    return content, None


def _rows(text: str) -> list[list[float]]:
    """Return the numbers of CSV, which may begin with a line of names."""
    rows = [row for row in csv.reader(text.splitlines()) if any(cell.strip() for cell in row)]
    try:
        return [[float(cell) for cell in row] for row in rows]
    except ValueError:
        return [[float(cell) for cell in row] for row in rows[1:]]
