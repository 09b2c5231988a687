"""What a bundle's model looks at: columns or a tensor, of an echo or of a wall hypothesis."""

from collections.abc import Mapping
from typing import Any

from echolearn.checks import check
from echolearn.localization.columns import (
    EVERY_COLUMN,
    SEVERAL,
    STRIP_ENTRIES,
    STRIPS,
    TENSOR_VIEWS,
    UNITS,
    tensor_shape,
)
from echolearn.walls.nouns import SOUND

NEWER = "was it made by a newer echolearn?"


def echo_inputs(
    about: Mapping[str, Any], microphones: int
) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return what a classifier of echoes looks at, and the shape of one input."""
    view = about["view"]
    tensor = view != "features"
    known = [name for name, kind in TENSOR_VIEWS.items() if kind == view]
    known = known if tensor else [*EVERY_COLUMN, *SEVERAL]
    names = [column["name"] for column in about["columns"]]
    wrong = [name for name in names if name not in known]
    check(not wrong, "columns", wrong, allowed=f"must be some of {', '.join(known)}", hint=NEWER)
    once = 0 < len(names) == len(set(names)) and not (tensor and len(names) > 1)
    check(
        once,
        "columns",
        names,
        allowed="must be one tensor, or columns that are there once",
    )

    # The same number in ms would be taken for one in s without a word.
    units = [column["unit"] for column in about["columns"]]
    meant = [UNITS.get(name, "1") for name in names]
    check(units == meant, "columns", units, allowed=f"must be the units {meant}")

    shape = [*tensor_shape(names[0], microphones)] if tensor else [len(names)]
    given = about["input_shape"]
    check(given == shape, "input_shape", given, allowed=f"must be {shape}")
    return tuple(names), tuple(shape)


def wall_inputs(about: Mapping[str, Any]) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return what a classifier of walls looks at, and the shape of one input."""
    names = [column["name"] for column in about["columns"]]
    tensor = about["view"] == STRIPS
    known = (STRIPS,) if tensor else SOUND
    once = 0 < len(names) == len(set(names)) and {*names} <= {*known}
    allowed = f"must be some of {', '.join(known)}, each once"
    check(once, "columns", ", ".join(names)[:200], allowed=allowed, hint=NEWER)
    units = {column["unit"] for column in about["columns"]}
    check(units == {"1"}, "columns", sorted(units), allowed="must have the unit 1")

    # A strip has any number of poses, in which the golden ones are those of the training walks.
    given = about["input_shape"]
    fits = given[1:] == [STRIP_ENTRIES] if tensor else given == [len(names)]
    allowed = f"must be [poses, {STRIP_ENTRIES}]" if tensor else f"must be [{len(names)}]"
    check(fits, "input_shape", given, allowed=allowed)
    return tuple(names), tuple(given)
