"""What classifiers are fed: names of columns or of one tensor, and finite float32 arrays.

Columns fit into any memory, tensors do not: 100 000 covariances are as many pages of shards on
    disk. `Rows` stand
for an array whose rows are fetched when they are asked for. Whoever needs the whole array says
`as_input(x, inputs)`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check

FEATURES = "features"
COVARIANCE = "covariance"

TRUTH = (
    "reflector",
    "on_map",
    "snr_db",
    "t60",
    "gain_db",
    "position",
    "heading",
    "room",
    "group",
    "truth_toa",
)
"""Columns that only a simulation knows; a classifier that saw them would be judged on an answer it
was told."""


def view_of(inputs: Sequence[str]) -> str:
    """Return the view that `inputs` belong to: tensors are called covariance..., everything else is
    a column.
    """
    return COVARIANCE if inputs and inputs[0].startswith(COVARIANCE) else FEATURES


def check_inputs(inputs: Sequence[str], *, views: Sequence[str] = (FEATURES,)) -> tuple[str, ...]:
    """Return `inputs` as a tuple of names.

    Args:
        inputs: names of columns, or the name of one tensor.
        views: those the classifier can work on.

    Raises:
        BadValue: not a list of distinct names, a name that is the truth's, several tensors, or the
            wrong view.
    """
    named = (
        isinstance(inputs, list | tuple)
        and len(inputs) > 0
        and all(isinstance(name, str) for name in inputs)
    )
    check(
        named,
        "classifier.inputs",
        inputs,
        allowed="a list of column names, or of one tensor's name",
    )
    names, shown = tuple(inputs), list(inputs)
    check(len(set(names)) == len(names), "classifier.inputs", shown, allowed="each name once")
    told = [name for name in names if name in TRUTH]
    check(
        not told,
        "classifier.inputs",
        shown,
        allowed="what a robot can measure",
        hint=f"{told} is known to simulations only",
    )
    tensors = [name for name in names if view_of([name]) == COVARIANCE]
    check(
        not tensors or len(names) == 1,
        "classifier.inputs",
        shown,
        allowed="columns, or one tensor alone",
    )
    check(
        view_of(names) in views,
        "classifier.inputs",
        shown,
        allowed=f"{' or '.join(views)} for this classifier",
    )
    return names


@dataclass(frozen=True)
class Rows:
    """Some rows of a set's inputs, left where they are until they are asked for.

    `rows[which]` is an array, float32 and finite, shape (len(which), ...), for a slice or indices;
    `rows.part(which)` are fewer rows that still lie where they lay; `np.asarray(rows)` is all of
    them.

    Attributes:
        gather: returns rows by their numbers in the set, in that order.
        numbers: of these rows in the set, shape (B,).
        inputs: the names of what a row holds.
    """

    gather: Callable[[Array], Array]
    numbers: Array
    inputs: Sequence[str]

    def __len__(self) -> int:
        return len(self.numbers)

    @property
    def shape(self) -> tuple[int, ...]:
        """Return the shape of the array these rows would be."""
        return (len(self), *self.gather(self.numbers[:0]).shape[1:])

    def part(self, which: Array) -> "Rows":
        """Return the rows at indices `which` of these."""
        return Rows(self.gather, self.numbers[which], self.inputs)

    def __getitem__(self, which: slice | Array) -> Array:
        numbers = self.numbers[which]
        return as_input(self.gather(numbers), self.inputs, numbers=numbers)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.asarray(self[:], dtype=dtype)


Inputs = Array | Rows
"""What a classifier is given: (B, K) columns or (B, bands, M * M) tensors."""


def rows_of(x: Inputs, inputs: Sequence[str]) -> Rows:
    """Return `x` as rows; an array is checked at once (`as_input`)."""
    if isinstance(x, Rows):
        return x
    whole = as_input(x, inputs)
    return Rows(whole.__getitem__, np.arange(len(whole)), inputs)


def blocks(x: Inputs, inputs: Sequence[str], *, size: int = 2048) -> Iterator[Array]:
    """Yield `x` as arrays of at most `size` rows, and one without rows if there are none."""
    rows = rows_of(x, inputs)
    for start in range(0, max(1, len(rows)), size):
        yield rows[start : start + size]


def as_input(x: Inputs, inputs: Sequence[str], *, numbers: Array | None = None) -> Array:
    """Return `x` as a contiguous float32 array, the precision that every scorer sees.

    Args:
        x: shape (B, K) for K columns, (B, bands, M * M) for a tensor.
        inputs: the names of what `x` holds.
        numbers: of the rows, shape (B,), for the message; as they follow each other if None.

    Raises:
        BadValue: the wrong shape, or a value that is not finite in float32.
    """
    x = np.asarray(x)
    covariance = view_of(inputs) == COVARIANCE
    fits = x.ndim == 3 if covariance else x.ndim == 2 and x.shape[1] == len(inputs)
    allowed = (
        "(B, bands, M * M)"
        if covariance
        else f"(B, {len(inputs)}), the columns {', '.join(inputs)}"
    )
    check(fits, "x.shape", x.shape, allowed=allowed, hint="was the array taken from another view?")
    with np.errstate(over="ignore"):
        x = np.ascontiguousarray(x, dtype=np.float32)
    if not np.isfinite(x).all():
        place = np.argwhere(~np.isfinite(x))[0]
        name, row = (
            inputs[0] if covariance else inputs[place[1]],
            place[0] if numbers is None else numbers[place[0]],
        )
        raise BadValue(
            f"{name}={x[tuple(place)]} in row {row}: finite numbers; was a silent recording analysed?"
        )
    return x


def check_labels(y: Array, rows: int) -> Array:
    """Return `y` as a bool array of `rows` labels that holds both classes, or raise `BadValue`."""
    y = np.asarray(y).astype(bool)
    check(y.shape == (rows,), "y.shape", y.shape, allowed=f"({rows},), one label per row of x")
    count = int(y.sum())
    check(
        0 < count < rows,
        "reflectors",
        f"{count} of {rows} training rows",
        allowed="both classes",
        hint="use more rows",
    )
    return y
