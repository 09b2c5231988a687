"""Identity: canonical text, digests, and short names that outlive a move of the code.

    value --plain--> containers --canonical--> one JSON text --digest--> 12 hexadecimal digits

Sets, runs, studies and surveys are named after the digest of what they are made from. There a class
stands by its *short name*, the class's own in lower case (`gated`, `rotor`, `svm`), never by the
module in which it is defined. A class of somebody else's package keeps its whole name: nobody but
they know whether it is the only one.
"""

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from echolearn.checks import BadValue

KIND = "kind"
"""Key under which a short name stands."""

LATER = {"later": True}
"""Metadata of a field that came after values of its class had been made: while it has its default,
it is no part of their identity, so that what was made before keeps its name."""

DEEPEST = 2000
"""Characters of a dotted name, beyond which containers are nested in themselves."""

LONGEST_NUMBER = 14_000
"""Bits of a whole number; Python writes none of more than 4300 digits."""

TARGET = "_target_"
"""Key under which a configuration names what it calls."""


def canonical(plain: Any) -> bytes:
    """Return the one JSON text of plain containers: sorted keys, no blanks, floats by `repr`.

    Raises:
        BadValue: NaN, infinity, or anything that JSON cannot hold.
    """
    try:
        return json.dumps(plain, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
    except (TypeError, ValueError, RecursionError):
        allowed = "must be a finite number, a text, a list or a mapping"
        raise BadValue(f"{_misfit(plain)}: {allowed}") from None


def _misfit(plain: Any) -> str:
    """Return what of some containers JSON cannot hold, after its dotted name."""
    waiting: list[tuple[str, Any]] = [("", plain)]
    while waiting:
        name, value = waiting.pop()
        if len(name) > DEEPEST:
            return f"{name:.60}=nested too deep"
        if isinstance(value, Mapping | list | tuple):
            pairs = value.items() if isinstance(value, Mapping) else enumerate(value)
            # From the last, so that the first is looked at first.
            waiting += [(f"{name}.{key!s:.60}".strip("."), each) for key, each in pairs][::-1]
        elif isinstance(value, int) and value.bit_length() > LONGEST_NUMBER:
            return f"{name or 'value'}=a number of thousands of digits"
        elif isinstance(value, float) and not math.isfinite(value):
            return f"{name or 'value'}={value}"
        elif not isinstance(value, str | int | float | None):
            return f"{name or 'value'}={value!r:.100}"
    return "keys=of several kinds"


def digest(plain: Any) -> str:
    """Return the identity of plain containers: the first 12 hexadecimal digits of their SHA-256."""
    return hashlib.sha256(canonical(plain)).hexdigest()[:12]


def short_name(target: str) -> str:
    """Return the stable name of a class or function, given by its dotted one."""
    if not target.startswith("echolearn."):
        return target
    return target.rpartition(".")[2].lower()


def kind_of(value: object) -> str:
    """Return the short name of a value's class."""
    return short_name(f"{type(value).__module__}.{type(value).__qualname__}")


def plain(value: Any) -> Any:
    """Return a value as plain containers for a manifest.

    A dataclass becomes its kind and its fields, an array its shape and its SHA-256.
    """
    if is_dataclass(value) and not isinstance(value, type):
        items = {
            field.name: plain(getattr(value, field.name))
            for field in fields(value)
            if not (field.metadata == LATER and getattr(value, field.name) == field.default)
        }
        return {KIND: kind_of(value), **items}
    if isinstance(value, np.ndarray):
        content = np.ascontiguousarray(value).tobytes()
        return {"shape": list(value.shape), "sha256": hashlib.sha256(content).hexdigest()}
    if isinstance(value, Mapping):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def by_short_names(config: Any) -> Any:
    """Return a configuration, plain containers, in which every `_target_` has become a `kind`."""
    if isinstance(config, Mapping):
        named = {KIND: short_name(str(config[TARGET]))} if TARGET in config else {}
        return named | {key: by_short_names(item) for key, item in config.items() if key != TARGET}
    if isinstance(config, list | tuple):
        return [by_short_names(item) for item in config]
    return config
