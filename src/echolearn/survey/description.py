"""What describes a recorded survey, `survey.yaml`: read as a stranger writes it, and written.

A table names every key and its check, so a misspelt key cannot go unnoticed. YAML of little text
can stand for endless lists (aliases) or exhaust a parser's stack (nesting): both are refused before
anything is built from it. So is a key that is there twice, of which YAML would take the last.
"""

import re
from collections import Counter
from collections.abc import Collection, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from echolearn.acoustics.types import Array, MicArray, Probe
from echolearn.checks import (
    BadValue,
    check,
    check_metres,
    check_number,
    check_whole,
)
from echolearn.storage.files import one_line
from echolearn.storage.tables import check_plain, nullable
from echolearn.survey import floor_plan
from echolearn.survey.audio import check_size
from echolearn.survey.sound_speed import check_sound_speed

LARGEST_YAML = 1 << 17
"""Bytes that `survey.yaml` may have."""

DEEPEST = 20
"""Brackets within brackets that `survey.yaml` may have; coordinates need two."""

MOST_TOKENS = 40_000
"""Words and marks that `survey.yaml` may have; 256 microphones have 2 000."""

UNKNOWN = "leave it out where it is not known"


class Loader(yaml.SafeLoader):  # type: ignore[misc]
    """Reads 1e3 and 022050 as numbers of base ten, as YAML 1.2 does; PyYAML's own do not."""


Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)[eE][-+]?[0-9]+\Z"),
    list("-+.0123456789"),
)
# Before PyYAML's own, which reads a leading zero as base eight.
Loader.yaml_implicit_resolvers["0"].insert(
    0, ("tag:yaml.org,2002:float", re.compile(r"0[0-9_]+\Z"))
)


NEEDED = {
    "sample_rate": "the rate of the recordings in Hz, 48000",
    "speed_of_sound": "in m/s, 343 in air of 20 degrees",
    "microphones": "their positions in the robot's frame in m, [[x, y, z], ...], one a channel",
    "loudspeaker": "its position in the robot's frame in m, [x, y, z]",
    "direct_path": "removed, or present where what comes straight from the loudspeaker is recorded",
}
"""What keys hold that have to be there."""


LEVEL = partial(check_number, low=-200.0, high=200.0, unit="dB", hint=UNKNOWN)

TABLE = {
    "sample_rate": partial(
        check_number, low=1000.0, high=400_000.0, unit="Hz", hint="is it in kHz?"
    ),
    "speed_of_sound": check_sound_speed,
    "microphones": partial(check_metres, shape=(-1, 3)),
    "loudspeaker": partial(check_metres, shape=(3,)),
    "direct_path": ("removed", "present"),
    "map": (True, False),
    "walls": nullable(floor_plan.check_walls),
    "heading_bias_sd_rad": partial(
        check_number, low=0.0, high=np.pi, unit="rad", hint="is it in degrees?"
    ),
    "conditions": {
        "snr_db": nullable(LEVEL),
        "sdnr_db": nullable(LEVEL),
        "pings": nullable(partial(check_whole, low=1)),
        ...: ...,
    },
}
"""Keys of `survey.yaml`, each with its check."""

OPTIONAL: dict[str, Any] = {
    "map": True,
    "walls": None,
    "heading_bias_sd_rad": 0.0,
    "conditions": {},
}
"""Keys that may be missing or null, and what is then read."""


def read_description(path: Path) -> dict[str, Any]:
    """Return the keys of `survey.yaml`, coordinates as arrays, walls as sides.

    Raises:
        BadValue: no YAML, or a key that is missing, unknown or malformed.
    """
    hint = "what else is known of a recording goes into conditions"
    content = read_keys(path, TABLE, optional=OPTIONAL, hint=hint)
    if content["walls"] is not None:
        content["walls"] = floor_plan.sides(content["walls"])
    return content


def read_keys(
    path: Path, table: Mapping[str, Any], *, optional: Mapping[str, Any], hint: str
) -> dict[str, Any]:
    """Return the keys of a description, its coordinates as arrays.

    Args:
        path: the file.
        table: keys that it may have, each with its check.
        optional: keys that may be missing or null, and what is then read.
        hint: what to do about a key that is not in the table.

    Raises:
        BadValue: no YAML, or a key that is missing, unknown or malformed.
    """
    check_size(path, LARGEST_YAML)
    try:
        content = _load(path.read_text(encoding="utf-8"))
        if isinstance(content, dict):
            missing = {key for key in optional if content.get(key) is None}
            content |= {key: optional[key] for key in missing}
            _check_needed(content, table)
        check_plain("", content, table=table, hint=hint)
    except BadValue as error:
        raise BadValue(f"{path} {error}") from None
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        hint = _about_yaml(path, error)
        reason = isinstance(error, OSError) and error.strerror
        raise BadValue(f"{path}: cannot be read ({reason or one_line(error)}){hint}") from None

    for key in ("microphones", "loudspeaker"):
        content[key] = np.array(content[key], dtype=float)
    return dict(content)


def _check_needed(content: Mapping[str, Any], table: Collection[str]) -> None:
    """Raise `BadValue` if a key of `NEEDED` is missing, unless another may be it, misspelt."""
    misspelt = any(key not in table for key in content)
    for key, held in NEEDED.items() if not misspelt else ():
        there = key in content or key not in table
        check(there, key, "missing", allowed=f"must be there: {held}")


def _about_yaml(path: Path, error: Exception) -> str:
    """Return the likely mistake in a file that is no YAML; "" if none is known."""
    if isinstance(error, UnicodeDecodeError):
        return "; save it as UTF-8"
    if isinstance(error, FileNotFoundError):
        # Hidden ones are other programs' settings.
        found = [each for each in path.parent.glob("[!.]*.y*ml") if each.is_file()]
        folder = "; is this the folder of a survey?"
        return f"; is it {found[0]}?" if len(found) == 1 else folder
    said = str(error)
    if "'\\t'" in said:
        return "; indent by blanks, not by tabs"
    wrong = "mapping values are not allowed" in said or "could not find expected ':'" in said
    return "; is a blank missing behind a colon, or a line indented otherwise?" if wrong else ""


def _load(text: str) -> Any:
    """Return what plain YAML holds, without aliases, every key once."""
    # Counted by hand: the parser itself would run out of stack.
    depth = 0
    for character in text:
        depth += (character in "[{") - (character in "]}")
        if depth > DEEPEST:
            raise ValueError(f"it is nested more than {DEEPEST} deep")
    for count, token in enumerate(yaml.scan(text)):
        if isinstance(token, yaml.AliasToken):
            endless = "by which little text can become endless lists"
            raise ValueError(f"it holds an alias, *name, {endless}")
        # Two characters can be an entry, each of which takes a parser a tenth of a millisecond.
        if count == MOST_TOKENS:
            raise ValueError(f"it has more than {MOST_TOKENS} words and marks")

    # The tree of nodes still has both of two equal keys; the mapping made of it would not.
    node = yaml.compose(text, Loader=Loader)
    _check_once(node)
    return None if node is None else Loader("").construct_document(node)


def _check_once(node: Any) -> None:
    """Raise `BadValue` for a key that is twice in a mapping."""
    pairs = node.value if isinstance(node, yaml.MappingNode) else ()
    for key, times in Counter(str(key.value) for key, _ in pairs).items():
        check(times == 1, "key", f"{key!a:.100}, {times} times", allowed="must have each key once")
    for _, value in pairs:
        _check_once(value)


def description_bytes(
    array: MicArray,
    probe: Probe,
    *,
    speed_of_sound: float,
    walls: Array | None,
    conditions: Mapping[str, Any],
    direct_path: str = "removed",
    mapped: bool = True,
) -> bytes:
    """Return the text of `survey.yaml`.

    Args:
        array: the microphones, the loudspeaker at the origin.
        probe: what was emitted.
        speed_of_sound: in m/s.
        walls: of the floor plan, shape (S, 2, 2), in m; None where they are not known.
        conditions: what is known of the recordings.
        direct_path: "removed" or "present".
        mapped: whether echoes can be placed on a map; if not, they are times and directions only.
    """
    content = {
        "sample_rate": float(probe.sample_rate),
        "speed_of_sound": float(speed_of_sound),
        "microphones": array.positions.tolist(),
        "loudspeaker": [0.0, 0.0, 0.0],
        "direct_path": direct_path,
        **({} if mapped else {"map": False}),
        **({} if walls is None else {"walls": floor_plan.plain_walls(walls)}),
        "conditions": dict(conditions),
    }
    return yaml.safe_dump(content, sort_keys=False).encode()
