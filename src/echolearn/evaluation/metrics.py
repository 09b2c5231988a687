"""Metrics of labels: pure functions on arrays, in the manner of mir_eval.

Conventions, valid for every function here and for those of maps:

- `reference`, shape (B,), bool: True is a reflector, or a map point on a wall. It comes before what
  is estimated.
- `kept`, shape (B,), bool: what the filter `kept`, that is confidence >= threshold.
- `confidence`, shape (B,): belief that a row is a reflector; any finite score where only its order
  counts.
- `weights`, shape (..., B), not negative: how often each row counts; once unless given. The result
  then has shape (...), one value for each set of weights. A row of weight k counts as k equal rows,
  so integer weights are a bootstrap (`echolearn.evaluation.stats`). Without weights the result is
  one number.
- Whatever is 0/0 is NaN: no rows, one class only, nothing kept.

`echolearn.evaluation.map_metrics` has those of maps. A new metric of labels is an entry of
`rates`, `orders` or `evaluate_labels`.
"""

from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import check

CALIBRATION_BINS = 10
"""Equal bins of confidence; each holds its lower edge, the last one also 1."""


def validate(reference: Array, estimated: Array, *, weights: Array | None = None) -> None:
    """Check that two columns and the weights belong together.

    Args:
        reference: shape (B,), bool.
        estimated: shape (B,), finite.
        weights: shape (..., B).

    Raises:
        BadValue: unequal lengths, a reference that is not bool, a NaN, or weights of another
            length.
    """
    shapes = np.shape(reference), np.shape(estimated)
    check(
        len(shapes[0]) == 1 and shapes[0] == shapes[1],
        "reference, estimated",
        f"{shapes[0]} and {shapes[1]}",
        allowed="must be two equal shapes (B,)",
        hint="rows of different sets?",
    )
    hint = "class numbers? the paper's class 0, the wall, is True here"
    _check_bool(reference, name="reference", hint=hint)
    finite = bool(np.isfinite(estimated).all())
    check(finite, "estimated", "NaN or infinity", allowed="must be a finite number for each row")
    if weights is not None:
        fits = np.shape(weights)[-1:] == shapes[0]
        check(
            fits,
            "weights",
            np.shape(weights),
            allowed="must have shape (..., B), a weight for each row",
        )


def kept(confidence: Array, threshold: float) -> Array:
    """Return which rows the filter keeps, bool: those with confidence >= threshold."""
    return np.asarray(confidence) >= threshold


def rates(reference: Array, kept: Array, *, weights: Array | None = None) -> dict[str, Array]:
    """Return all metrics of what is kept, by name.

    Args:
        reference: shape (B,), bool.
        kept: shape (B,), bool.
        weights: shape (..., B).

    Returns:
        Precision is the share of kept rows that are true. Recall, of a map its true retention, is
        the share of true rows that are kept; specificity, of a map its spurious removal, the share
        of false rows that are dropped. Balanced accuracy is the mean of these two. F1 is the
        harmonic mean of precision and recall, 0 if all that is true is lost.
    """
    validate(reference, kept, weights=weights)
    _check_bool(kept, name="kept", hint="a confidence? compare it with the threshold first")
    # The four cells of the confusion table, each weighted at once.
    cells = np.stack([reference & kept, ~reference & kept, reference & ~kept, ~reference & ~kept])
    counts = each_weight(reference, weights) @ cells.T.astype(float)
    true_kept, false_kept, true_dropped, false_dropped = np.moveaxis(counts, -1, 0)
    true = true_kept + true_dropped
    false = false_kept + false_dropped
    recall = ratio(true_kept, true)
    specificity = ratio(false_dropped, false)
    return {
        "accuracy": ratio(true_kept + false_dropped, true + false),
        "balanced_accuracy": (recall + specificity) / 2,
        "precision": ratio(true_kept, true_kept + false_kept),
        "recall": recall,
        "specificity": specificity,
        "f1": ratio(2 * true_kept, 2 * true_kept + false_kept + true_dropped),
    }


def balanced_accuracy(reference: Array, kept: Array, *, weights: Array | None = None) -> Array:
    """Return the mean of recall and specificity; arguments as for `rates`.

    Args:
        reference: truth, shape (B,), bool.
        kept: what survived the filter, shape (B,), bool.
        weights: counts of the rows, shape (..., B), or None.
    """
    return rates(reference, kept, weights=weights)["balanced_accuracy"]


def orders(
    reference: Array, confidence: Array, *, weights: Array | None = None
) -> dict[str, Array]:
    """Return all metrics that look at the order of confidences only, by name.

    Args:
        reference: shape (B,), bool.
        confidence: shape (B,).
        weights: shape (..., B).

    Returns:
        AUC is the chance that a reflector outranks a spurious row, ties counting half. Average
        precision is the area under the precision-recall curve as a sum of steps, not interpolated.
    """
    true, false = _ladder(reference, confidence, weights=weights)
    found = np.cumsum(true, axis=-1)
    spurious = np.cumsum(false, axis=-1)
    all_true = true.sum(axis=-1)
    all_false = false.sum(axis=-1)
    # Spurious rows ranked below each confidence; ties count half.
    below = all_false[..., None] - spurious + false / 2
    precision = np.divide(found, found + spurious, out=np.zeros_like(found), where=found > 0)
    return {
        "auc": ratio(np.einsum("...d,...d->...", true, below), all_true * all_false),
        "average_precision": ratio(np.einsum("...d,...d->...", true, precision), all_true),
    }


def recall_at(
    reference: Array, confidence: Array, *, precision: float, weights: Array | None = None
) -> Array:
    """Return the largest recall over all cuts that have at least a precision; 0 if none has.

    Args:
        reference: shape (B,), bool.
        confidence: shape (B,).
        precision: share of what is kept that must be true, 0 to 1.
        weights: shape (..., B).
    """
    true, false = _ladder(reference, confidence, weights=weights)
    found = np.cumsum(true, axis=-1)
    kept = found + np.cumsum(false, axis=-1)
    # Rounding must not push a whole count, such as 0.9 * 10, out.
    precise = found >= precision * kept * (1 - 1e-12)
    most = np.where(precise, found, 0.0).max(axis=-1, initial=0.0)
    return ratio(most, true.sum(axis=-1))


def auc(reference: Array, confidence: Array, *, weights: Array | None = None) -> Array:
    """Return the area under the ROC curve; arguments as for `orders`.

    Args:
        reference: truth, shape (B,), bool.
        confidence: beliefs, shape (B,); only their order counts.
        weights: counts of the rows, shape (..., B), or None.
    """
    return orders(reference, confidence, weights=weights)["auc"]


def pr_curve(reference: Array, confidence: Array) -> tuple[Array, Array]:
    """Return precision and recall, each (D,), for every distinct confidence, highest first."""
    true, false = _ladder(reference, confidence)
    found = np.cumsum(true)
    return ratio(found, found + np.cumsum(false)), ratio(found, found[-1:])


def reliability_curve(reference: Array, confidence: Array) -> tuple[Array, Array]:
    """Compare belief and truth in equal bins of confidence.

    Returns:
        Mean confidence and share of reflectors of each bin, shape (10,); NaN in empty bins.
    """
    member = _bins(reference, confidence)
    count = member.sum(axis=0)
    return ratio(confidence @ member, count), ratio(reference @ member, count)


def expected_calibration_error(
    reference: Array, confidence: Array, *, weights: Array | None = None
) -> Array:
    """Return the mean over rows of |mean confidence - share of reflectors| in the row's bin.

    Source: Naeini, Cooper, Hauskrecht (AAAI 2015).

    Args:
        reference: shape (B,), bool.
        confidence: shape (B,), 0 to 1.
        weights: shape (..., B).
    """
    each = each_weight(reference, weights)
    surplus = each @ (_bins(reference, confidence) * (confidence - reference)[:, None])
    return ratio(np.abs(surplus).sum(axis=-1), each.sum(axis=-1))


def evaluate_labels(
    reference: Array, confidence: Array, *, threshold: float, weights: Array | None = None
) -> dict[str, Array]:
    """Return every metric of labels; with `weights` each value has shape (...).

    Args:
        reference: shape (B,), bool.
        confidence: shape (B,), 0 to 1.
        threshold: confidence from which a row is kept.
        weights: shape (..., B).

    Raises:
        BadValue: columns that do not belong together, a confidence outside 0 to 1.
    """
    error = expected_calibration_error(reference, confidence, weights=weights)
    ranked = orders(reference, confidence, weights=weights) | {"expected_calibration_error": error}
    return ranked | rates(reference, kept(confidence, threshold), weights=weights)


def finite(value: Any) -> float | None:
    """Return a metric's value as JSON has it: None where there is none, NaN or an empty cell."""
    return None if value == "" or not np.isfinite(float(value)) else float(value)


def each_weight(column: Array, weights: Array | None) -> Array:
    """Return weights as floats, one for each row unless given."""
    return np.ones(len(column)) if weights is None else np.asarray(weights, dtype=float)


def ratio(part: Array, whole: Array) -> Array:
    """Return part / whole, NaN where the whole is 0."""
    part, whole = np.broadcast_arrays(np.asarray(part, dtype=float), whole)
    share: Array = np.divide(part, whole, out=np.full(whole.shape, np.nan), where=whole > 0)
    return share


def _ladder(
    reference: Array, confidence: Array, *, weights: Array | None = None
) -> tuple[Array, Array]:
    """Sum the weights of true and of false rows at each distinct confidence, highest first.

    Returns:
        Two arrays of shape (..., D).
    """
    validate(reference, confidence, weights=weights)
    order = np.argsort(-confidence, kind="stable")
    steps = np.flatnonzero(np.diff(confidence[order], prepend=np.inf))
    each = np.take(each_weight(reference, weights), order, axis=-1)
    true = each * reference[order]
    false = each * ~reference[order]
    # Without ties there is nothing to sum, and `reduceat` is slow.
    if len(steps) == len(order):
        return true, false
    return np.add.reduceat(true, steps, axis=-1), np.add.reduceat(false, steps, axis=-1)


def _bins(reference: Array, confidence: Array) -> Array:
    """Return which of the equal bins each row falls into, shape (B, 10), as 0 and 1."""
    validate(reference, confidence)
    outside = confidence[(confidence < 0) | (confidence > 1)]
    hint = "was a logit given for a confidence?"
    check(
        len(outside) == 0,
        "confidence",
        outside[:3],
        allowed="must be numbers from 0 to 1",
        hint=hint,
    )
    number = np.minimum((confidence * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    member: Array = np.eye(CALIBRATION_BINS)[number]
    return member


def _check_bool(column: Array, *, name: str, hint: str) -> None:
    dtype = np.asarray(column).dtype
    check(dtype.kind == "b", f"{name}.dtype", dtype, allowed="must be bool", hint=hint)
