"""Bad input ends in one line: `name=value unit: what is allowed; the likely mistake`.

The checks stand below every room, so that whoever is handed a value can refuse it where it arrives.
"""

import math
from collections.abc import Sequence
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import NDArray

LONGEST_NAME = 100
"""Bytes of a folder's name; a file system takes 255, to which digests and endings are added."""


class BadValue(ValueError):
    """A value from outside that cannot be used: `name=value unit`, what is allowed, the likely
    mistake.
    """


def check(condition: bool, name: str, value: object, *, allowed: str, hint: str = "") -> None:
    """Raise `BadValue` in the house's one-line form unless `condition` holds.

    Args:
        condition: what must be true.
        name: dotted name of the offending argument.
        value: its value, with its unit where it has one.
        allowed: what would be accepted.
        hint: the likely mistake, or what to do about it.
    """
    if not condition:
        raise BadValue(f"{name}={value}: {allowed}" + (f"; {hint}" if hint else ""))


def is_number(value: object) -> bool:
    """Tell whether `value` is a finite real number (a bool is not)."""
    real = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    return real and math.isfinite(value)  # type: ignore[arg-type]


def check_number(
    name: str,
    value: object,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    unit: str = "",
    hint: str = "",
) -> None:
    """Raise `BadValue` unless `value` is a number in [low, high]."""
    allowed = f"a number from {low:g} to {high:g}" + (f" {unit}" if unit else "")
    shown = f"{value} {unit}".rstrip()
    check(
        is_number(value), name, shown, allowed=allowed, hint=hint or "was text given for a number?"
    )
    check(low <= float(value) <= high, name, shown, allowed=allowed, hint=hint)  # type: ignore[arg-type]


def check_whole(
    name: str, value: object, *, low: int, high: int = 10**9, unit: str = "", hint: str = ""
) -> None:
    """Raise `BadValue` unless `value` is a whole number in [low, high]."""
    check_number(name, value, low=low, high=high, unit=unit, hint=hint)
    check(
        isinstance(value, int | np.integer),
        name,
        f"{value} {unit}".rstrip(),
        allowed="a whole number",
        hint=hint,
    )


def check_name(name: str, value: object) -> None:
    """Raise `BadValue` unless `value` can name a folder: letters, digits, dots, - and _, no dot or
    - first.
    """
    spelled = (
        isinstance(value, str)
        and value[:1] not in ".-"
        and all(c.isalnum() or c in "._-" for c in value)
    )
    check(
        bool(spelled and value),
        name,
        value,
        allowed="a name of letters, digits, dots, - and _",
        hint="no path",
    )
    size = len(str(value).encode())
    check(
        size <= LONGEST_NAME,
        name,
        f"{value!s:.20}...",
        allowed=f"at most {LONGEST_NAME} bytes",
        hint=f"it has {size}",
    )


def check_list(
    name: str, value: object, *, length: int | None = None, allowed: str = "a list, [a,b]"
) -> None:
    """Raise `BadValue` unless `value` is a list, of `length` items if that is given."""
    listed = isinstance(value, list | tuple | np.ndarray)
    fits = listed and length in (None, len(value))  # type: ignore[arg-type]
    check(
        fits,
        name,
        list(value) if listed else value,
        allowed=allowed,
        hint="" if listed else "are brackets missing?",
    )  # type: ignore[call-overload]


def real_array(name: str, value: object, *, allowed: str, hint: str = "") -> NDArray[Any]:
    """Return real numbers of any dtype as float64, or raise `BadValue`: sums of squares would
    overflow int16 unseen.
    """
    try:
        array = np.asarray(value)
    except ValueError:  # rows of several lengths
        array = np.array(None)
    check(array.dtype.kind in "iuf", name, f"dtype {array.dtype}", allowed=allowed, hint=hint)
    found: NDArray[Any] = array.astype(float, copy=False)
    return found


def finite_array(name: str, value: object, *, shape: tuple[int, ...], allowed: str) -> NDArray[Any]:
    """Return finite real numbers of a shape, in which -1 is any number, as float64, or raise
    `BadValue`.
    """
    array = real_array(name, value, allowed=allowed)
    fits = array.ndim == len(shape) and all(
        want in (-1, n) for n, want in zip(array.shape, shape, strict=True)
    )
    check(fits, name, f"shape {array.shape}", allowed=allowed)
    check(bool(np.isfinite(array).all()), name, "NaN or infinity", allowed=allowed)
    return array


def suggest(word: str, known: Sequence[str]) -> str:
    """Return the name in `known` that comes closest to `word`, by its last part if not as a whole,
    or all of them.
    """
    if not known:
        return "it has none"
    leaves = {name.rpartition(".")[2]: name for name in reversed(known)}
    near = get_close_matches(word, known, n=1) or [
        leaves[leaf] for leaf in get_close_matches(word, list(leaves), n=1)
    ]
    top = [name for name in known if "." not in name]
    return f"did you mean {near[0]}?" if near else f"known are {', '.join(top)}"
