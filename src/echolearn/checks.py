"""Bad input ends in one line: `name=value unit: what is allowed; the likely mistake`.

The checks stand below every room, so that whoever is handed a value can refuse it where it arrives.
"""

import math
from collections.abc import Mapping, Sequence
from difflib import get_close_matches
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

Range = tuple[float, float] | tuple[float, float, str]
"""Least and largest value of a number, and their unit if they have one."""

LONGEST_NAME = 100
"""Bytes of a folder's name; a file system takes 255, to which digests and endings are added."""


LONGEST_LINE = 2000
"""Characters of a line about an error; a stranger's text may have millions."""


def printable(text: str) -> str:
    """Return a text as one line that can be printed: escaped, and cut in the middle.

    A stranger's text must not move the cursor of whoever reads it, nor fill the screen.
    """
    if len(text) > LONGEST_LINE:
        text = f"{text[: LONGEST_LINE - 500]} ... {text[-495:]}"
    return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)


class BadValue(ValueError):
    """A value from outside that cannot be used, in the one-line form of this module's header.

    The line can be printed, whatever is in the value.
    """

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


def check(
    condition: bool | np.bool, name: str, value: object, *, allowed: str, hint: str = ""
) -> None:
    """Raise `BadValue` in the house's one-line form unless `condition` holds.

    Args:
        condition: what must be true.
        name: dotted name of the offending argument.
        value: its value, with its unit where it has one.
        allowed: what would be accepted.
        hint: the likely mistake, or what to do about it.
    """
    if not condition:
        raise BadValue(f"{name}={value!s:.500}: {allowed}" + (f"; {hint}" if hint else ""))


def is_number(value: object) -> TypeGuard[float]:
    """Tell whether `value` is a finite real number (a bool is not)."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:
        # A whole number of more digits than a float can hold is finite, but of no use.
        return False


def check_number(
    name: str,
    value: object,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    unit: str = "",
    hint: str = "",
) -> None:
    """Raise `BadValue` unless `value` is a number in [low, high].

    Args:
        name: dotted name of the argument.
        value: its value.
        low, high: least and largest number allowed.
        unit: of all three, for the message.
        hint: the likely mistake.
    """
    bounds = f"from {low:g} to {high:g} {unit}".rstrip() if high < math.inf else "that is finite"
    check(
        is_number(value) and low <= value <= high,
        name,
        f"{value} {unit}".rstrip(),
        allowed=f"must be a number {bounds}",
        hint=hint or ("was text given?" if isinstance(value, str) else ""),
    )


def check_whole(
    name: str, value: object, *, low: int, high: int = 10**9, unit: str = "", hint: str = ""
) -> None:
    """Raise `BadValue` unless `value` is a whole number in [low, high].

    Args:
        name, value, low, high, unit, hint: as those of `check_number`.
    """
    whole = isinstance(value, int | np.integer)
    # As 1e5 is read.
    if is_number(value) and not whole and low <= value <= high and float(value).is_integer():
        hint = f"type {int(value)}"
    check(
        is_number(value) and whole and low <= value <= high,
        name,
        f"{value} {unit}".rstrip(),
        allowed=f"must be a whole number from {low} to {high} {unit}".rstrip(),
        hint=hint,
    )


def check_fields(name: str, owner: object, *, ranges: Mapping[str, Range]) -> None:
    """Raise `BadValue` unless the fields of a dataclass are in their ranges.

    Args:
        name: of the dataclass, for the message.
        owner: the dataclass.
        ranges: by field; others are not looked at. Whole bounds want a whole number.
    """
    for field, value in vars(owner).items():
        if field in ranges:
            low, high, unit = (*ranges[field], "")[:3]
            if isinstance(low, int) and isinstance(high, int):
                check_whole(f"{name}.{field}", value, low=low, high=high, unit=unit)
            else:
                check_number(f"{name}.{field}", value, low=low, high=high, unit=unit)


def check_range(name: str, limits: Sequence[float], *, bounds: Range) -> None:
    """Raise `BadValue` unless `limits` are two ordered numbers within bounds.

    Args:
        name: dotted name of the argument.
        limits: lowest and highest.
        bounds: least and largest value of both, and their unit if they have one.
    """
    allowed = "must be two numbers, lowest first"
    check_list(name, limits, length=2, allowed=allowed)
    low, high, unit = (*bounds, "")[:3]
    for value in limits:
        check_number(name, value, low=low, high=high, unit=unit)
    ascending = limits[0] <= limits[1]
    check(ascending, name, list(limits), allowed=allowed, hint="are they swapped?")


NO_PATH = "a path is no name"


def check_name(name: str, value: object, *, hint: str = NO_PATH) -> None:
    """Raise `BadValue` unless `value` can name a folder that everybody sees.

    Args:
        name: dotted name of the argument.
        value: its value; text to pass.
        hint: the likely mistake.
    """
    text = value if isinstance(value, str) else ""
    plain = text.isprintable() and text == text.strip() and "/" not in text
    check(
        plain and text[:1] not in ("", ".", "-"),
        name,
        value,
        allowed="must be a name without /, beginning with neither a dot, - nor a blank",
        hint=hint,
    )
    size = len(str(value).encode())
    check(
        size <= LONGEST_NAME,
        name,
        f"{value!s:.20}...",
        allowed=f"must have at most {LONGEST_NAME} bytes",
        hint=f"it has {size}" if hint == NO_PATH else f"it has {size}; {hint}",
    )


def check_choice(name: str, value: object, *choices: str) -> None:
    """Raise `BadValue` unless `value` is one of two choices or more."""
    *others, last = choices
    check(value in choices, name, value, allowed=f"must be {', '.join(others)} or {last}")


def check_list(
    name: str, value: object, *, length: int | None = None, allowed: str = "must be a list, [a,b]"
) -> None:
    """Raise `BadValue` unless `value` is a list, of `length` items if that is given.

    Args:
        name: dotted name of the argument.
        value: its value.
        length: number of items.
        allowed: what would be accepted, for the message.
    """
    if not isinstance(value, list | tuple | np.ndarray):
        hint = "none is []" if value in ("", None) else "are brackets missing?"
        check(False, name, value, allowed=allowed, hint=hint)
    else:
        check(length in (None, len(value)), name, list(value), allowed=allowed)


def check_text(name: str, value: object) -> None:
    """Raise `BadValue` unless `value` is a printable text of one line, at most 1000 characters."""
    plain = isinstance(value, str) and 0 < len(value) <= 1000 and value.isprintable()
    allowed = "must be a printable text of at most 1000 characters"
    check(plain, name, f"{value!a:.100}", allowed=allowed)


NO_NUMBERS = {
    "U": "words",
    "S": "words",
    "b": "true or false",
    "c": "complex numbers",
    "O": "rows of several lengths, or no numbers",
}
"""What stands where numbers should, by the kind of its dtype."""


def real_array(name: str, value: object, *, allowed: str, hint: str = "") -> NDArray[Any]:
    """Return real numbers of any dtype as float64, or raise `BadValue`.

    Args:
        name: dotted name of the argument.
        value: its value.
        allowed: what would be accepted, for the message.
        hint: the likely mistake.
    """
    try:
        array = np.asarray(value)
    except ValueError:
        # Rows of several lengths are no array.
        array = np.array(None)
    shown = NO_NUMBERS.get(array.dtype.kind, f"dtype {array.dtype}")
    check(array.dtype.kind in "iuf", name, shown, allowed=allowed, hint=hint)
    # Sums of squares would overflow int16 unseen.
    found: NDArray[Any] = array.astype(float, copy=False)
    return found


def check_finite(name: str, values: object, *, allowed: str, hint: str = "") -> None:
    """Raise `BadValue` unless all numbers of an array are finite.

    Args:
        name: dotted name of the array.
        values: the numbers.
        allowed: what would be accepted, for the message.
        hint: the likely mistake.
    """
    finite = np.isfinite(values).all()  # type: ignore[call-overload]
    check(finite, name, "NaN or infinity", allowed=allowed, hint=hint)


def check_speed(name: str, speed_of_sound: object) -> None:
    """Raise `BadValue` unless sound could be that fast, in m/s, in air or in water."""
    check_number(name, speed_of_sound, low=100.0, high=2000.0, unit="m/s", hint="air is 343 m/s")


def check_rate(name: str, sample_rate: object) -> None:
    """Raise `BadValue` unless sound can be sampled at that rate, in Hz."""
    check_number(name, sample_rate, low=1000.0, high=400_000.0, unit="Hz")


def finite_vector(
    name: str, value: object, *, allowed: str, length: int | None = None
) -> NDArray[Any]:
    """Return a list of finite real numbers as float64, or raise `BadValue`.

    Args:
        name: dotted name of the argument.
        value: its value.
        allowed: what would be accepted, for the message.
        length: number of items; any unless given.
    """
    array = real_array(name, value, allowed=allowed)
    fits = array.ndim == 1 and length in (None, len(array))
    check(fits, name, f"shape {array.shape}", allowed=allowed)
    check_finite(name, array, allowed=allowed)
    return array


def check_metres(
    name: str, value: object, *, shape: tuple[int, ...], most: float = 100.0
) -> NDArray[Any]:
    """Return coordinates as an array, or raise `BadValue`.

    Args:
        name: dotted name of the value.
        value: lists of numbers in m.
        shape: shape that they must have; -1 is any number.
        most: largest magnitude, in m.
    """
    axes = " x ".join("many" if size == -1 else str(size) for size in shape)
    allowed = f"must be {axes} finite numbers in m"
    places = real_array(name, value, allowed=allowed)
    fits = len(shape) == places.ndim and all(
        wanted in (-1, size) for wanted, size in zip(shape, places.shape, strict=True)
    )
    check(fits, name, f"shape {places.shape}", allowed=allowed)
    check_finite(name, places, allowed=allowed)
    largest = np.abs(places).max(initial=0.0)
    allowed = f"must be coordinates from -{most:g} to {most:g} m"
    check(largest <= most, name, f"{largest:g} m", allowed=allowed, hint="are they in mm?")
    return places


def suggest(word: str, known: Sequence[str]) -> str:
    """Return the known name that comes closest, by its last part if not as a whole, or all."""
    if not known:
        return "it has none"
    leaves = {name.rpartition(".")[2]: name for name in reversed(known)}
    near = get_close_matches(word, known, n=1)
    near += [leaves[leaf] for leaf in get_close_matches(word, list(leaves), n=1)]
    if near:
        return f"did you mean {near[0]}?"
    return f"known are {', '.join(name for name in known if '.' not in name)}"
