"""What `bundle.json` holds: a table of its keys, each with what may stand there.

Bundles on robots outlive versions of echolearn. This reads schema 3; 4, which is 3 with a reference
(`reference`); and 5, which is 3 of a classifier of walls, who judges the lines that a whole walk
speaks for (`walls.verdicts`). `upgraded` turns 2 into 3, in which a localizer was named by module
and class, `gated.Gated` instead of `gated`. In the first, `parity` was a number. Texts are
printable, so that none plays tricks with a terminal.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

from echolearn.acoustics.types import PARITY
from echolearn.checks import (
    check,
    check_metres,
    check_number,
    check_text,
    check_whole,
)
from echolearn.localization.columns import COVARIANCE_BANDS, STRIPS, TENSOR_VIEWS
from echolearn.storage.advice import is_command
from echolearn.storage.tables import check_plain, nullable

SCHEMA = 3
"""Version of the format of bundles without a reference."""

WITH_REFERENCE = 4
"""That of bundles with one."""

OF_WALLS = 5
"""That of bundles of classifiers of walls."""

GOLDEN = 32
"""Inputs whose confidences travel with the model."""

LIMITS = {"model.onnx": 64 << 20, "golden.npz": 16 << 20, "probe.wav": 16 << 20}
"""The files besides `bundle.json`, each with the bytes it may have."""

REFERENCE = "reference.npz"
LARGEST_REFERENCE = 16 << 20
"""Bytes that the file of a reference may have."""

REFLECTOR = "a wall's echo arrives within 10 samples of toa"
LABELS = {
    "reflector": REFLECTOR,
    "on_map": "the map point lies within 0.10 m of a wall",
    "time_and_direction": "within 10 samples and 10 degrees of a true echo",
}
"""What a confidence of 1 says of an echo."""

WALL_LABELS = {"is_wall": "the line is a wall's, within 2 degrees and 5 cm"}
"""What it says of a line."""


def check_argument(name: str, value: Any) -> None:
    """Raise `BadValue` unless a value can be an argument of a localizer."""
    short = not isinstance(value, str) or len(value) < 200
    plain = short and isinstance(value, bool | int | float | str | None)
    check(plain, name, value, allowed="must be a number, a text, true, false or null")


def check_command(name: str, value: Any) -> None:
    """Raise `BadValue` unless a text is one command line of echolearn."""
    allowed = "must be one command line of echolearn, quoted"
    check(is_command(value), name, f"{value!a:.100}", allowed=allowed)


def check_calibration(name: str, value: Any) -> None:
    """Raise `BadValue` unless a value is a line of logits, or the knots of an isotonic one."""
    sigmoid = {"slope": check_number, "intercept": check_number}
    stepped = isinstance(value, dict) and "knots" in value
    check_plain(name, value, table={"knots": [[check_number]]} if stepped else sigmoid)


def check_microphones(name: str, value: Any) -> None:
    """Raise `BadValue` unless places are those of microphones on a robot."""
    count = len(check_metres(name, value, shape=(-1, 3), most=10.0))
    check(count <= 256, name, f"{count} microphones", allowed="must be 1 to 256")


COUNT = partial(check_whole, low=1, high=10**12)
ADAPTED: dict[str, Any] = {
    "kind": ("bundle", "run"),
    "name": check_text,
    "sha256": check_text,
    "data": [check_text],
    "places": COUNT,
}
"""What a filter that was adapted says of the one that it began from."""

ENTRY = {"bytes": COUNT, "sha256": check_text}
SHARE = partial(check_number, low=0.0, high=1.0)
FIGURE = dict.fromkeys(("value", "ci_low", "ci_high"), nullable(check_number))

TABLE: dict[str, Any] = {
    "kind": "bundle",
    "schema": SCHEMA,
    "name": check_text,
    "command": nullable(check_command),
    "classifier": check_text,
    "run": check_text,
    "seed": partial(check_whole, low=0, high=2**63),
    "trained_on": check_text,
    "data": {"plan": check_text, "digest": check_text, "rows": COUNT},
    "view": ("features", *dict.fromkeys(TENSOR_VIEWS.values())),
    "columns": [{"name": check_text, "unit": check_text}],
    "bands": COVARIANCE_BANDS,
    "input_shape": [partial(check_whole, low=1, high=10**5)],
    "label": tuple({"name": name, "true": meaning} for name, meaning in LABELS.items()),
    "threshold": {"value": SHARE, "chosen": check_text},
    "calibration": check_calibration,
    "parity": {"difference": partial(check_number, low=0.0, high=PARITY), "trials": COUNT},
    "sample_rate": partial(check_number, low=1000.0, high=400_000.0, unit="Hz"),
    "speed_of_sound": partial(check_number, low=100.0, high=2000.0, unit="m/s"),
    "array": check_microphones,
    "probe": {
        "file": "probe.wav",
        "burst": COUNT,
        "length": partial(check_whole, low=16, high=4 << 20, unit="samples"),
    },
    "window": {"nearest": check_number, "farthest": check_number, "rule": check_text},
    "localizer": {"name": check_text, "arguments": {...: check_argument}},
    "golden": GOLDEN,
    "metrics": {
        "held_out": {"set": check_text, "rows": COUNT, "figures": {...: FIGURE}},
        "maps": [{"tested_on": check_text, "metric": check_text, **FIGURE}],
    },
    "versions": {...: check_text},
    "files": dict.fromkeys(LIMITS, ENTRY),
    "sha256": check_text,
}
"""Keys of `bundle.json`."""

REFERRING: dict[str, Any] = TABLE | {
    "schema": WITH_REFERENCE,
    "files": dict.fromkeys((*LIMITS, REFERENCE), ENTRY),
    "reference": {
        "columns": [check_text],
        "walks": partial(check_whole, low=1, high=100_000),
        "poses": partial(check_whole, low=1, high=1000),
    },
}
"""Keys of that of a bundle with a reference."""

JUDGING: dict[str, Any] = TABLE | {
    "schema": OF_WALLS,
    "view": ("features", STRIPS),
    "label": tuple({"name": name, "true": meaning} for name, meaning in WALL_LABELS.items()),
    "hypotheses": {"count": partial(check_whole, low=1, high=1000)},
}
"""Keys of that of a bundle of a classifier of walls; `localizer` is that of single poses."""

TABLES = {SCHEMA: TABLE, WITH_REFERENCE: REFERRING, OF_WALLS: JUDGING}
"""Keys by schema."""


def limits_of(about: Mapping[str, Any]) -> dict[str, int]:
    """Return the files of a bundle besides `bundle.json`, each with the bytes it may have."""
    referring = about["schema"] == WITH_REFERENCE
    return LIMITS | ({REFERENCE: LARGEST_REFERENCE} if referring else {})


def upgraded(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of a `bundle.json` as one of today's schema has it, all of it checked.

    Raises:
        BadValue: another schema, or a key that is missing, unknown or not as `TABLE` says.
    """
    schema = content.get("schema")
    known = type(schema) is int and schema in (2, *TABLES)
    hint = f"this echolearn reads schemas 2 to {OF_WALLS}; update it or export again"
    allowed = f"must be 2, {', '.join(map(str, [*TABLES][:-1]))} or {OF_WALLS}"
    check(known, "schema", schema, allowed=allowed, hint=hint)
    about = {"command": None, **content, "schema": max(int(schema or 0), SCHEMA)}
    adapted = {"adapted_from": ADAPTED} if "adapted_from" in about else {}
    check_plain("", about, table=TABLES[about["schema"]] | adapted)
    # It is the one thing that has changed since then.
    if schema == 2:
        about["localizer"] = about["localizer"] | {"name": _short(about["localizer"]["name"])}
    return about


def _short(name: str) -> str:
    """Return the short name of a localizer that is given as `module.Class`."""
    module, _, kind = name.partition(".")
    allowed = "must be module.Class of a localizer, as schema 2 has it"
    check(kind.lower() == module, "localizer.name", name, allowed=allowed)
    return module
