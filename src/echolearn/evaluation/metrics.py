"""Metrics of labels and maps: pure functions on arrays, in the manner of mir_eval.

Conventions, valid for every function here:

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

A map is evaluated against the room's outline, `corners` (C, 2) in m: a point is true within 0.10 m
of it. `echolearn.evaluation.coverage` holds what speaks of the walls as a whole.

A new metric of labels is an entry of `evaluate_labels`, one of maps an entry of `evaluate_map`.
"""

import numpy as np
from scipy.stats import rankdata

from echolearn.acoustics.geometry import distance_to_outline
from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.evaluation.coverage import nearest_neighbour_error, wall_coverage

MAP_TOLERANCE = 0.10
"""m; a map point this close to a wall is true."""

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
    counts = _weights(reference, weights) @ cells.T.astype(float)
    true_kept, false_kept, true_dropped, false_dropped = np.moveaxis(counts, -1, 0)
    true = true_kept + true_dropped
    false = false_kept + false_dropped
    recall = _ratio(true_kept, true)
    specificity = _ratio(false_dropped, false)
    return {
        "accuracy": _ratio(true_kept + false_dropped, true + false),
        "balanced_accuracy": (recall + specificity) / 2,
        "precision": _ratio(true_kept, true_kept + false_kept),
        "recall": recall,
        "specificity": specificity,
        "f1": _ratio(2 * true_kept, 2 * true_kept + false_kept + true_dropped),
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
        "auc": _ratio(np.einsum("...d,...d->...", true, below), all_true * all_false),
        "average_precision": _ratio(np.einsum("...d,...d->...", true, precision), all_true),
    }


def auc(reference: Array, confidence: Array, *, weights: Array | None = None) -> Array:
    """Return the area under the ROC curve; arguments as for `orders`.

    Args:
        reference: truth, shape (B,), bool.
        confidence: beliefs, shape (B,); only their order counts.
        weights: counts of the rows, shape (..., B), or None.
    """
    return orders(reference, confidence, weights=weights)["auc"]


def auc_shares(reference: Array, *, first: Array, second: Array) -> Array:
    """Return what each row adds to auc(first) - auc(second): the sign turns if answers are swapped.

    Confidences are replaced by their ranks, so that models of different scales can be swapped. A
    pair of a reflector i and a spurious row j adds K(a_i, a_j) - K(b_i, b_j), K = 1, 1/2 or 0 as
    the reflector is above, level or below. Over the four ways to swap i and j that is linear in the
    signs s_i, s_j, with the weights 1/2 sum_j [K(a_i, .) - K(b_i, .)] and 1/2 sum_i [K(., a_j) -
    K(., b_j)], where . runs over both answers.

    Args:
        reference: shape (B,), bool.
        first, second: confidences of the two, shape (B,).

    Returns:
        Shape (B,).
    """
    validate(reference, first)
    validate(reference, second)
    first, second = rankdata(first), rankdata(second)
    # Either answer of the other row may be the one it is compared with, so both are counted.
    true_ranks = np.append(first[reference], second[reference])
    false_ranks = np.append(first[~reference], second[~reference])
    above_false = _above(first, false_ranks) - _above(second, false_ranks)
    above_true = _above(first, true_ranks) - _above(second, true_ranks)
    shares = np.where(reference, above_false, -above_true)
    return shares / (2.0 * reference.sum() * (~reference).sum())


def balanced_accuracy_shares(reference: Array, *, first: Array, second: Array) -> Array:
    """Return what each row adds to balanced_accuracy(first) - balanced_accuracy(second).

    Args:
        reference: shape (B,), bool.
        first, second: what each of the two keeps, shape (B,), bool.

    Returns:
        Shape (B,).
    """
    validate(reference, first)
    validate(reference, second)
    true_share = 0.5 / max(reference.sum(), 1)
    false_share = 0.5 / max((~reference).sum(), 1)
    return (first.astype(float) - second) * np.where(reference, true_share, -false_share)


def _above(values: Array, others: Array) -> Array:
    """Return how many of `others` each value is above, ties counting half."""
    rising = np.sort(others)
    return (np.searchsorted(rising, values, "left") + np.searchsorted(rising, values, "right")) / 2


def pr_curve(reference: Array, confidence: Array) -> tuple[Array, Array]:
    """Return precision and recall, each (D,), for every distinct confidence, highest first."""
    true, false = _ladder(reference, confidence)
    found = np.cumsum(true)
    return _ratio(found, found + np.cumsum(false)), _ratio(found, found[-1:])


def reliability_curve(reference: Array, confidence: Array) -> tuple[Array, Array]:
    """Compare belief and truth in equal bins of confidence.

    Returns:
        Mean confidence and share of reflectors of each bin, shape (10,); NaN in empty bins.
    """
    member = _bins(reference, confidence)
    count = member.sum(axis=0)
    return _ratio(confidence @ member, count), _ratio(reference @ member, count)


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
    each = _weights(reference, weights)
    surplus = each @ (_bins(reference, confidence) * (confidence - reference)[:, None])
    return _ratio(np.abs(surplus).sum(axis=-1), each.sum(axis=-1))


def error_mean(error: Array, kept: Array, *, weights: Array | None = None) -> Array:
    """Return the mean error of the kept points; NaN where nothing is kept.

    Args:
        error: distance from point to wall, shape (B,), in m.
        kept: shape (B,), bool.
        weights: shape (..., B).
    """
    each = _weights(error, weights)
    return _ratio(each @ np.where(kept, error, 0.0), each @ np.asarray(kept, dtype=float))


def error_quantile(
    error: Array, kept: Array, *, share: float, weights: Array | None = None
) -> Array:
    """Return the smallest error that `share` of the kept points do not exceed.

    Args:
        error: distance from point to wall, shape (B,), in m.
        kept: shape (B,), bool; if nothing is, the result is NaN.
        share: 0 to 1.
        weights: shape (..., B).
    """
    rising = np.argsort(error[kept], kind="stable")
    reached = np.cumsum(_weights(error, weights)[..., kept][..., rising], axis=-1)
    total = reached[..., -1] if len(rising) else np.zeros(reached.shape[:-1])
    # Rounding must not push a whole count, such as 0.05 * 100, to the next point.
    index = (reached < share * total[..., None] * (1 - 1e-12)).sum(axis=-1)
    return np.where(total > 0, np.append(error[kept][rising], np.nan)[index], np.nan)


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


def evaluate_map(
    corners: Array,
    points: Array,
    *,
    kept: Array,
    confidence: Array,
    poses: Array,
    weights: Array | None = None,
) -> dict[str, Array]:
    """Return every metric of a map; with `weights` each value has shape (...).

    `wall_coverage` and `nearest_neighbour_error` speak of a union of points. Resampling, which
    drops a third of the poses, would bias them, so with weights they are absent.

    Args:
        corners: the room's outline, shape (C, 2), in m.
        points: points of the map, shape (P, 2), in m.
        kept: shape (P,), bool.
        confidence: shape (P,), 0 to 1.
        poses: positions of the whole walk, shape (any, 2), in m.
        weights: shape (..., P).

    Raises:
        BadValue: columns that do not belong together, a confidence outside 0 to 1.
    """
    error = distance_to_outline(points, corners)
    reference = error <= MAP_TOLERANCE
    rate = rates(reference, kept, weights=weights)
    values = {
        "balanced_accuracy": rate["balanced_accuracy"],
        "precision": rate["precision"],
        "true_retention": rate["recall"],
        "spurious_removal": rate["specificity"],
        "f1": rate["f1"],
        "average_precision": orders(reference, confidence, weights=weights)["average_precision"],
        "expected_calibration_error": expected_calibration_error(
            reference, confidence, weights=weights
        ),
        "error_mean": error_mean(error, kept, weights=weights),
        "error_median": error_quantile(error, kept, share=0.5, weights=weights),
        "error_p95": error_quantile(error, kept, share=0.95, weights=weights),
    }
    if weights is None:
        # A union of points has no resamples: without a third of the poses it covers less.
        for whole in (wall_coverage, nearest_neighbour_error):
            found = whole(corners, points, kept=kept, poses=poses)
            values[whole.__name__] = np.asarray(found)
    return values


def _weights(column: Array, weights: Array | None) -> Array:
    return np.ones(len(column)) if weights is None else np.asarray(weights, dtype=float)


def _ratio(part: Array, whole: Array) -> Array:
    part, whole = np.broadcast_arrays(np.asarray(part, dtype=float), whole)
    ratio: Array = np.divide(part, whole, out=np.full(whole.shape, np.nan), where=whole > 0)
    return ratio


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
    each = np.take(_weights(reference, weights), order, axis=-1)
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
