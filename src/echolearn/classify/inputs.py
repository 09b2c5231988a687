"""What classifiers are fed: names of columns or of one tensor, and finite float32 arrays."""

from collections.abc import Sequence

import numpy as np

from echolearn.types import Array, BadValue, check

FEATURES = "features"
COVARIANCE = "covariance"

TRUTH = ("reflector", "on_map", "snr_db", "t60", "gain_db", "position", "heading", "room", "group", "truth_toa")
"""Columns that only a simulation knows; a classifier that saw them would be judged on an answer it was told."""


def view_of(inputs: Sequence[str]) -> str:
    """Return the view that `inputs` belong to: tensors are called covariance..., everything else is a column."""
    return COVARIANCE if inputs and inputs[0].startswith(COVARIANCE) else FEATURES


def check_inputs(inputs: Sequence[str], *, views: Sequence[str] = (FEATURES,)) -> tuple[str, ...]:
    """Return `inputs` as a tuple of names.

    Args:
        inputs: names of columns, or the name of one tensor.
        views: those the classifier can work on.

    Raises:
        BadValue: not a list of distinct names, a name that is the truth's, several tensors, or the wrong view.
    """
    named = not isinstance(inputs, str) and len(inputs) > 0 and all(isinstance(name, str) for name in inputs)
    check(named, "classifier.inputs", inputs, allowed="a list of column names, or of one tensor's name")
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
    check(not tensors or len(names) == 1, "classifier.inputs", shown, allowed="columns, or one tensor alone")
    check(view_of(names) in views, "classifier.inputs", shown, allowed=f"{' or '.join(views)} for this classifier")
    return names


def as_input(x: Array, inputs: Sequence[str]) -> Array:
    """Return `x` as a contiguous float32 array, the precision that every scorer sees.

    Args:
        x: shape (B, K) for K columns, (B, bands, M * M) for a tensor.
        inputs: the names of what `x` holds.

    Raises:
        BadValue: the wrong shape, or a value that is not finite in float32.
    """
    x = np.asarray(x)
    covariance = view_of(inputs) == COVARIANCE
    fits = x.ndim == 3 if covariance else x.ndim == 2 and x.shape[1] == len(inputs)
    allowed = "(B, bands, M * M)" if covariance else f"(B, {len(inputs)}), the columns {', '.join(inputs)}"
    check(fits, "x.shape", x.shape, allowed=allowed, hint="was the array taken from another view?")
    with np.errstate(over="ignore"):
        x = np.ascontiguousarray(x, dtype=np.float32)
    if not np.isfinite(x).all():
        place = np.argwhere(~np.isfinite(x))[0]
        name = inputs[0] if covariance else inputs[place[1]]
        raise BadValue(f"{name}={x[tuple(place)]} in row {place[0]}: finite numbers; was a silent recording analysed?")
    return x


def check_labels(y: Array, rows: int) -> Array:
    """Return `y` as a bool array of `rows` labels that holds both classes, or raise `BadValue`."""
    y = np.asarray(y).astype(bool)
    check(y.shape == (rows,), "y.shape", y.shape, allowed=f"({rows},), one label per row of x")
    count = int(y.sum())
    check(
        0 < count < rows, "reflectors", f"{count} of {rows} training rows", allowed="both classes", hint="use more rows"
    )
    return y
