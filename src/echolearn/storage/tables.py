"""Plain containers, as of a JSON or YAML file, held against a table of what may stand there.

    content + table --check_plain--> nothing, or one line about the first thing that is wrong

The files of strangers, bundles and recorded surveys, are read by such tables, so that what is
allowed can be seen at a glance and no key slips through unseen.
"""

from collections.abc import Callable, Mapping
from difflib import get_close_matches
from typing import Any

from echolearn.checks import check, check_list

Check = Callable[[str, Any], None]
"""Function that raises `BadValue` unless a named value is right."""


def check_plain(name: str, value: object, *, table: Any, hint: str = "") -> None:
    """Raise `BadValue` unless plain containers, as of a JSON or YAML file, are what a table says.

    Args:
        name: dotted name of the value; that of a whole file is empty.
        value: what stands there.
        table: what may stand there. A function of name and value checks by itself; a list of one
            table wants a list of such values; a mapping wants exactly its keys, each as its own
            table says, or, with a table for the key `...`, any keys; a tuple has the values to
            choose from; `...` takes anything, and everything else wants exactly that.
        hint: what to do about a key that is not in the table.
    """
    if callable(table):
        table(name, value)
    elif isinstance(table, list):
        check_list(name, value)
        for item in value:  # type: ignore[attr-defined]
            check_plain(name, item, table=table[0])
    elif isinstance(table, dict):
        _check_keys(name, value, table=table, hint=hint)
        for key, each in value.items():  # type: ignore[attr-defined]
            part = f"{name}.{key}" if name else str(key)
            check_plain(part, each, table=table.get(key, table.get(...)))
    elif table is not ...:
        choices = table if isinstance(table, tuple) else (table,)
        # Of equal values of two types, as 1 and true, only one is meant.
        known = any(value == choice and type(value) is type(choice) for choice in choices)
        check(known, name, value, allowed=f"must be {' or '.join(map(str, choices))}")


def _check_keys(name: str, value: object, *, table: Mapping[Any, Any], hint: str) -> None:
    """Raise `BadValue` unless a value is a mapping with the keys of a table, and no others."""
    known = [key for key in table if key is not ...]
    allowed = f"must be a mapping with {', '.join(known)}" if known else "must be a mapping"
    check(isinstance(value, dict), name or "content", value, allowed=allowed)
    if ... in table:
        return
    keys: list[Any] = list(value)  # type: ignore[call-overload]
    dot = f"{name}." if name else ""
    for odd in (str(key) for key in keys if key not in known):
        near = get_close_matches(odd, known, n=1)
        mend = f"did you mean {near[0]}?" if near else hint
        check(
            False,
            f"{dot}key",
            f"{odd:.100}",
            allowed=f"must be one of {', '.join(known)}",
            hint=mend,
        )
    for lacking in (key for key in known if key not in keys):
        check(False, f"{dot}{lacking}", "missing", allowed=allowed)


def nullable(function: Check) -> Check:
    """Return a check that also takes None."""
    return lambda name, value: None if value is None else function(name, value)
