"""What classifiers are fed: names of columns or of one tensor, and finite float32 arrays.

Columns fit into any memory, tensors do not: 100 000 covariances are as many pages of shards on
disk. `Rows` stand for an array whose rows are fetched when they are asked for. Whoever needs the
whole array says `as_input(x, inputs)`.

What is believed of a wall hypothesis depends on the others of its walk. Rows of `strips` therefore
say which walk they are of, and no block parts one (`walks_in`).
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check
from echolearn.localization.columns import STRIP_ENTRIES, STRIPS, TENSOR_VIEWS

FEATURES = "features"
COVARIANCE = "covariance"
MAP = "map"
POSE = "pose"
VIEWS = {
    FEATURES: "columns",
    COVARIANCE: "(B, bands, M * M)",
    MAP: "(B, sectors + 1 + M, lags)",
    POSE: "(B, candidates, K)",
    STRIPS: f"(B, poses, {STRIP_ENTRIES})",
}
"""What a classifier can look at; of tensors the shape."""

TRUTH = (
    "reflector",
    "on_map",
    "time_and_direction",
    "is_wall",
    "wall",
    "walls",
    "odometry_error",
    "snr_db",
    "t60",
    "gain_db",
    "position",
    "heading",
    "room",
    "group",
    "truth_toa",
)
"""Columns that only a simulation knows; a classifier that saw them would be told the answer."""

AT_ONCE = 2**23
"""Most numbers of a block of rows: 32 MiB."""

LARGEST_WALK = 128
"""Wall hypotheses of a walk that are looked at together, at most."""


def view_of(inputs: Sequence[str]) -> str:
    """Return the view of `inputs`: columns, or the kind of a tensor."""
    name = inputs[0] if inputs else ""
    if name == STRIPS:
        # No tensor of an echo, so no bundle of a filter may name it.
        return STRIPS
    return TENSOR_VIEWS.get(name, COVARIANCE if name.startswith(COVARIANCE) else FEATURES)


def is_tensor(inputs: Sequence[str]) -> bool:
    """Return whether `inputs` name a tensor rather than columns."""
    return view_of(inputs) != FEATURES


def check_inputs(inputs: Sequence[str], *, views: Sequence[str] = (FEATURES,)) -> tuple[str, ...]:
    """Return `inputs` as a tuple of names.

    Args:
        inputs: names of columns, or the name of one tensor.
        views: views that the classifier can work on.

    Raises:
        BadValue: not a list of distinct names, a name that only a simulation knows, several
            tensors, or the wrong view.
    """
    listed = isinstance(inputs, list | tuple) and len(inputs) > 0
    need = partial(check, name="classifier.inputs", value=list(inputs) if listed else inputs)
    named = listed and all(isinstance(name, str) for name in inputs)
    need(named, allowed="a list of column names, or of one tensor's name")

    names = tuple(inputs)
    need(len(set(names)) == len(names), allowed="each name once")
    known = ", ".join(sorted({*names} & {*TRUTH}))
    hint = f"only a simulation knows {known}"
    need(not known, allowed="what a robot can measure", hint=hint)

    tensors = sum(is_tensor([name]) for name in names)
    need(not tensors or len(names) == 1, allowed="columns, or one tensor alone")
    kinds = ["columns" if view == FEATURES else "a tensor" for view in views]
    allowed = " or ".join(dict.fromkeys(kinds))
    need(view_of(names) in views, allowed=f"{allowed} for this classifier")
    return names


def stack_inputs(names: Sequence[str], columns: Any) -> Array:
    """Return what a classifier looks at, (B, K), or a tensor (B, ...).

    The columns, each of shape (B, ...), come by name from a mapping or a set.
    """
    if is_tensor(names):
        return columns[names[0]]
    return np.stack([columns[name] for name in names], axis=1)


@dataclass(frozen=True)
class Rows:
    """Some rows of a set's inputs, left where they are until they are asked for.

    `rows[which]` is an array, float32 and finite, shape (len(which), ...), for a slice or indices;
    `rows.part(which)` are fewer rows that still lie where they lay; `np.asarray(rows)` is all of
    them.

    Attributes:
        gather: function that returns rows by their numbers in the set, in that order.
        numbers: numbers of these rows in the set, shape (B,).
        inputs: names of what a row holds.
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
"""What a classifier is given: columns or a tensor, of a shape of `VIEWS`."""


def rows_of(x: Inputs, inputs: Sequence[str]) -> Rows:
    """Return `x` as rows; an array is checked at once (`as_input`)."""
    if isinstance(x, Rows):
        return x
    whole = as_input(x, inputs)
    return Rows(whole.__getitem__, np.arange(len(whole)), inputs)


def blocks_of(x: Inputs, inputs: Sequence[str], *, size: int = 2048) -> Iterator[Array]:
    """Yield `x` as arrays of at most `size` rows, and one without rows if there are none.

    Args:
        x: shape (B, ...).
        inputs: names of what a row holds.
        size: rows in an array, at most.
    """
    rows = rows_of(x, inputs)
    yield from parts_of(rows, size, together=view_of(inputs) == STRIPS)


def parts_of(rows: Inputs, size: int, *, together: bool) -> Iterator[Array]:
    """Yield rows as arrays of at most `size`, fewer where they are large, and one if there is none.

    Args:
        rows: shape (B, ...).
        size: rows in an array, at most.
        together: whether they are strips, of which no walk is parted.
    """
    # Attention grows with the square of the rows.
    size = LARGEST_WALK if together else block_rows(rows.shape[1:], size)
    start = 0
    while start < max(1, len(rows)):
        block = rows[start : start + size]
        if together and start + size < len(rows):
            # The last walk may go on behind the block: it comes with the next one.
            walk = walks_in(block)
            block = block[walk < max(walk[-1], 1)]
        yield block
        start += max(1, len(block))


def block_rows(shape: Sequence[int], most: int) -> int:
    """Return how many rows of a shape, at most `most`, are worked on at a time."""
    return max(1, min(most, AT_ONCE // max(1, math.prod(shape))))


def walks_in(strips: Array) -> Array:
    """Return the walk of each strip (B, poses, entries) as 0, 1, 2 ... in their order, (B,)."""
    marks = strips[:, :2, 0]
    return np.cumsum(np.any(np.diff(marks, axis=0, prepend=marks[:1]) != 0, axis=1))


def walks_of(rows: Rows) -> Array | None:
    """Return the walk of each row as 0, 1, 2 ..., (B,), or None if each stands by itself."""
    if view_of(rows.inputs) != STRIPS:
        return None
    found: list[Array] = []
    for block in blocks_of(rows, rows.inputs):
        # A block begins with a walk of its own.
        found.append(walks_in(block) + (found[-1][-1] + 1 if found else 0))
    return np.concatenate(found)


def as_input(x: Inputs, inputs: Sequence[str], *, numbers: Array | None = None) -> Array:
    """Return `x` as a contiguous float32 array, the precision that every scorer sees.

    Args:
        x: shape (B, K) for K columns, for a tensor as `VIEWS` says.
        inputs: names of what a row holds.
        numbers: numbers of the rows, shape (B,), for the message; 0 ... B - 1 if None.

    Raises:
        BadValue: the wrong shape, or a value that is not finite in float32.
    """
    x = np.asarray(x)
    if is_tensor(inputs):
        fits = x.ndim == 3
        allowed = VIEWS[view_of(inputs)]
    else:
        fits = x.ndim == 2 and x.shape[1] == len(inputs)
        allowed = f"(B, {len(inputs)}), the columns {', '.join(inputs)}"
    check(fits, "x.shape", x.shape, allowed=allowed, hint="was the array taken from another view?")

    # What overflows float32 becomes infinite here, and is refused below by its name.
    with np.errstate(over="ignore"):
        x = np.ascontiguousarray(x, dtype=np.float32)
    if not np.isfinite(x).all():
        place = np.argwhere(~np.isfinite(x))[0]
        name = inputs[0] if x.ndim == 3 else inputs[place[1]]
        row = place[0] if numbers is None else numbers[place[0]]
        value = x[tuple(place)]
        raise BadValue(
            f"{name}={value} in row {row}: must be finite; was a silent recording analysed?"
        )
    return x


def check_labels(y: Array, rows: int) -> None:
    """Raise `BadValue` unless `y` has `rows` labels, both classes among them."""
    check(y.shape == (rows,), "y.shape", y.shape, allowed=f"({rows},), one label per row of x")
    count = int(y.sum())
    shown = f"{count} of {rows} training rows"
    hint = "use more rows"
    check(0 < count < rows, "reflectors", shown, allowed="must hold both classes", hint=hint)
