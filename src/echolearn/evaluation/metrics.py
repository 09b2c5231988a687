"""Judge labels and maps: pure functions on arrays, one per metric, in the manner of mir_eval.

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
- Whatever is 0/0 is NaN, in words at each metric: no rows, one class only, nothing kept.

A map is judged against the room's outline, `corners` (C, 2) in m: a point is true within 0.10 m of
it. `echolearn.evaluation.coverage` holds what speaks of the walls as a whole.
"""

import numpy as np

from echolearn.acoustics.geometry import distance_to_outline
from echolearn.acoustics.types import Array
from echolearn.checks import check, check_whole
from echolearn.evaluation.coverage import nearest_neighbour_error, wall_coverage

TOLERANCE = 0.10
"""m; a map point this close to a wall is true."""


def validate(reference: Array, estimated: Array, weights: Array | None = None) -> None:
    """Check that two columns and the weights belong together.

    Raises:
        BadValue: unequal lengths, a reference that is not bool, a NaN, or weights of another
            length.
    """
    shapes = f"{np.shape(reference)} and {np.shape(estimated)}"
    equal = np.ndim(reference) == 1 and np.shape(reference) == np.shape(estimated)
    check(
        equal,
        "reference, estimated",
        shapes,
        allowed="two equal shapes (B,)",
        hint="rows of different sets?",
    )
    _check_bool(
        "reference", reference, hint="class numbers? the paper's class 0, the wall, is True here"
    )
    check(
        bool(np.isfinite(estimated).all()), "estimated", "NaN or infinity", allowed="finite numbers"
    )
    if weights is not None:
        check(
            np.shape(weights)[-1:] == np.shape(reference),
            "weights",
            np.shape(weights),
            allowed="shape (..., B)",
        )


def kept(confidence: Array, threshold: float) -> Array:
    """Return which rows the filter keeps, bool: those with confidence >= threshold."""
    return np.asarray(confidence) >= threshold


def confusion(
    reference: Array, kept: Array, *, weights: Array | None = None
) -> tuple[Array, Array, Array, Array]:
    """Count true kept, false kept, true dropped, false dropped."""
    validate(reference, kept, weights)
    _check_bool("kept", kept, hint="a confidence? compare it with the threshold first")
    cells = np.stack(
        [reference & kept, ~reference & kept, reference & ~kept, ~reference & ~kept], axis=-1
    )
    counts = _weights(reference, weights) @ cells.astype(float)
    return counts[..., 0], counts[..., 1], counts[..., 2], counts[..., 3]


def rates(reference: Array, kept: Array, *, weights: Array | None = None) -> dict[str, Array]:
    """Return all metrics of what is kept, by name; each is also a function of its own."""
    kept_true, kept_false, dropped_true, dropped_false = confusion(reference, kept, weights=weights)
    true, false = kept_true + dropped_true, kept_false + dropped_false
    recall, specificity = _ratio(kept_true, true), _ratio(dropped_false, false)
    return {
        "accuracy": _ratio(kept_true + dropped_false, true + false),
        "balanced_accuracy": (recall + specificity) / 2,
        "precision": _ratio(kept_true, kept_true + kept_false),
        "recall": recall,
        "specificity": specificity,
        "f1": _ratio(2 * kept_true, 2 * kept_true + kept_false + dropped_true),
    }


def precision(reference: Array, kept: Array, *, weights: Array | None = None) -> Array:
    """Return the share of kept rows that are reflectors; NaN where nothing is kept."""
    return rates(reference, kept, weights=weights)["precision"]


def recall(reference: Array, kept: Array, *, weights: Array | None = None) -> Array:
    """Return the share of reflectors that are kept, of a map its true retention; NaN without
    reflectors.
    """
    return rates(reference, kept, weights=weights)["recall"]


def specificity(reference: Array, kept: Array, *, weights: Array | None = None) -> Array:
    """Return the share of spurious rows that are dropped, of a map its spurious removal; NaN
    without any.
    """
    return rates(reference, kept, weights=weights)["specificity"]


def accuracy(reference: Array, kept: Array, *, weights: Array | None = None) -> Array:
    """Return the share of rows judged rightly; NaN without rows. Never report it without
    `balanced_accuracy`.
    """
    return rates(reference, kept, weights=weights)["accuracy"]


def balanced_accuracy(reference: Array, kept: Array, *, weights: Array | None = None) -> Array:
    """Return the mean of `recall` and `specificity`; NaN unless both classes are there."""
    return rates(reference, kept, weights=weights)["balanced_accuracy"]


def f1(reference: Array, kept: Array, *, weights: Array | None = None) -> Array:
    """Return the harmonic mean of `precision` and `recall`; 0 if all is lost, NaN without
    reflectors and kept rows.
    """
    return rates(reference, kept, weights=weights)["f1"]


def orders(
    reference: Array, confidence: Array, *, weights: Array | None = None
) -> dict[str, Array]:
    """Return all metrics that look at the order of confidences only, by name; each is also a
    function of its own.
    """
    true, false = _ladder(reference, confidence, weights)
    found, spurious = np.cumsum(true, axis=-1), np.cumsum(false, axis=-1)
    total, others = true.sum(axis=-1), false.sum(axis=-1)
    below = others[..., None] - spurious + false / 2
    share = np.divide(found, found + spurious, out=np.zeros_like(found), where=found > 0)
    return {
        "auc": _ratio(np.einsum("...d,...d->...", true, below), total * others),
        "average_precision": _ratio(np.einsum("...d,...d->...", true, share), total),
    }


def auc(reference: Array, confidence: Array, *, weights: Array | None = None) -> Array:
    """Return the chance that a reflector outranks a spurious row, ties counting half; NaN unless
    both are there.
    """
    return orders(reference, confidence, weights=weights)["auc"]


def average_precision(
    reference: Array, confidence: Array, *, weights: Array | None = None
) -> Array:
    """Return the area under the precision-recall curve as a sum of steps, not interpolated; NaN
    without reflectors.
    """
    return orders(reference, confidence, weights=weights)["average_precision"]


def auc_shares(reference: Array, first: Array, second: Array) -> Array:
    """Return what each row adds to auc(first) - auc(second), shape (B,): the sign turns if its
    answers are swapped.

    A pair of a reflector i and a spurious row j adds K(a_i, a_j) - K(b_i, b_j), K = 1, 1/2 or 0 as
    the reflector is above, level or below. Over the four ways to swap i and j that is linear in the
    signs s_i, s_j, with the weights 1/2 sum_j [K(a_i, .) - K(b_i, .)] and 1/2 sum_i [K(., a_j) -
    K(., b_j)], where . runs over both answers.
    """
    validate(reference, first)
    validate(reference, second)
    wins = [
        _level(values[reference], np.append(first[~reference], second[~reference]))
        for values in (first, second)
    ]
    losses = [
        _level(values[~reference], np.append(first[reference], second[reference]))
        for values in (first, second)
    ]
    shares = np.empty(len(reference))
    shares[reference], shares[~reference] = wins[0] - wins[1], losses[1] - losses[0]
    return shares / (2.0 * reference.sum() * (~reference).sum())


def balanced_accuracy_shares(reference: Array, first: Array, second: Array) -> Array:
    """Return what each row adds to balanced_accuracy(first) - balanced_accuracy(second), as
    `auc_shares` does.
    """
    validate(reference, first)
    validate(reference, second)
    share = (
        np.where(reference, 1.0 / max(reference.sum(), 1), -1.0 / max((~reference).sum(), 1)) / 2
    )
    return (first.astype(float) - second) * share


def _level(values: Array, others: Array) -> Array:
    """Return how many of `others` each value is above, ties counting half."""
    rising = np.sort(others)
    return (np.searchsorted(rising, values, "left") + np.searchsorted(rising, values, "right")) / 2


def pr_curve(reference: Array, confidence: Array) -> tuple[Array, Array, Array]:
    """Return precision, recall and threshold, each (D,), for every distinct confidence, the highest
    first.
    """
    true, false = _ladder(reference, confidence, None)
    found, spurious = np.cumsum(true), np.cumsum(false)
    return _ratio(found, found + spurious), _ratio(found, found[-1:]), np.unique(confidence)[::-1]


def reliability_curve(
    reference: Array, confidence: Array, *, bins: int = 10
) -> tuple[Array, Array, Array, Array]:
    """Compare belief and truth in equal bins of confidence.

    Args:
        reference: shape (B,), bool.
        confidence: shape (B,), 0 to 1.
        bins: how many; each holds its lower edge, the last one also 1.

    Returns:
        Centre, mean confidence, share of reflectors and number of rows of each bin, shape (bins,);
        the two in the middle are NaN in empty bins.
    """
    member = _bins(reference, confidence, bins)
    count = member.sum(axis=0)
    centre = (np.arange(bins) + 0.5) / bins
    return centre, _ratio(confidence @ member, count), _ratio(reference @ member, count), count


def expected_calibration_error(
    reference: Array, confidence: Array, *, bins: int = 10, weights: Array | None = None
) -> Array:
    """Return the mean of |mean confidence - share of reflectors| over rows, in the bins of `reliability_curve`.

    NaN without rows. Source: Naeini, Cooper, Hauskrecht (AAAI 2015).
    """
    member = _bins(reference, confidence, bins)
    each = _weights(reference, weights)
    surplus = each @ (member * (confidence - reference)[:, None])
    return _ratio(np.abs(surplus).sum(axis=-1), each.sum(axis=-1))


def error_mean(error: Array, kept: Array, *, weights: Array | None = None) -> Array:
    """Return the mean of `error` (B,), point to wall in m, over the kept points; NaN where nothing
    is kept.
    """
    _check_bool("kept", kept)
    each = _weights(error, weights)
    return _ratio(each @ np.where(kept, error, 0.0), each @ np.asarray(kept, dtype=float))


def error_quantile(
    error: Array, kept: Array, *, share: float = 0.5, weights: Array | None = None
) -> Array:
    """Return the smallest error (B,) in m that `share` of the kept points do not exceed; NaN where
    nothing is kept.
    """
    _check_bool("kept", kept)
    rising = np.argsort(error[kept], kind="stable")
    reached = np.cumsum(_weights(error, weights)[..., kept][..., rising], axis=-1)
    total = reached[..., -1] if len(rising) else np.zeros(reached.shape[:-1])
    index = (reached < share * total[..., None] * (1 - 1e-12)).sum(axis=-1)
    return np.where(total > 0, np.append(error[kept][rising], np.nan)[index], np.nan)


def evaluate_labels(
    reference: Array, confidence: Array, *, threshold: float = 0.5, weights: Array | None = None
) -> dict[str, Array]:
    """Return every metric of labels; with `weights` each value has shape (...).

    Raises:
        BadValue: columns that do not belong together, a confidence outside 0 to 1.
    """
    _check_confidence(confidence)
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

    `wall_coverage` and `nearest_neighbour_error` judge a union of points. Resampling, which drops a
    third of the poses, would bias them, so with weights they are absent.

    Args:
        corners: the room's outline, shape (C, 2), in m.
        points: of the map, shape (P, 2), in m.
        kept: shape (P,), bool.
        confidence: shape (P,), 0 to 1.
        poses: of the whole walk, shape (any, 2), in m.
        weights: shape (..., P).

    Raises:
        BadValue: columns that do not belong together, a confidence outside 0 to 1.
    """
    _check_confidence(confidence)
    error = distance_to_outline(points, corners)
    reference = error <= TOLERANCE
    judged = rates(reference, kept, weights=weights)
    names = {"recall": "true_retention", "specificity": "spurious_removal"}
    values = {
        names.get(name, name): value for name, value in judged.items() if name != "accuracy"
    } | {
        "average_precision": average_precision(reference, confidence, weights=weights),
        "expected_calibration_error": expected_calibration_error(
            reference, confidence, weights=weights
        ),
        "error_mean": error_mean(error, kept, weights=weights),
        "error_median": error_quantile(error, kept, share=0.5, weights=weights),
        "error_p95": error_quantile(error, kept, share=0.95, weights=weights),
    }
    if weights is not None:
        return values
    whole = (wall_coverage, nearest_neighbour_error)
    return values | {
        m.__name__: np.asarray(m(corners, points, kept=kept, poses=poses)) for m in whole
    }


def _weights(column: Array, weights: Array | None) -> Array:
    return np.ones(len(column)) if weights is None else np.asarray(weights, dtype=float)


def _ratio(part: Array, whole: Array) -> Array:
    part, whole = np.broadcast_arrays(np.asarray(part, dtype=float), whole)
    ratio: Array = np.divide(part, whole, out=np.full(whole.shape, np.nan), where=whole > 0)
    return ratio


def _ladder(reference: Array, confidence: Array, weights: Array | None) -> tuple[Array, Array]:
    """Sum the weights of reflectors and of others at each distinct confidence, highest first: (...,
    D) each.
    """
    validate(reference, confidence, weights)
    order = np.argsort(-confidence, kind="stable")
    steps = np.flatnonzero(np.diff(confidence[order], prepend=np.inf))
    each, true = np.take(_weights(reference, weights), order, axis=-1), reference[order]
    if len(steps) == len(order):  # no ties, nothing to sum
        return each * true, each * ~true
    return np.add.reduceat(each * true, steps, axis=-1), np.add.reduceat(
        each * ~true, steps, axis=-1
    )


def _bins(reference: Array, confidence: Array, bins: int) -> Array:
    """Return which of the equal bins each row falls into, shape (B, bins), as 0 and 1."""
    validate(reference, confidence)
    _check_confidence(confidence)
    check_whole("bins", bins, low=1)
    member: Array = np.eye(bins)[np.minimum((confidence * bins).astype(int), bins - 1)]
    return member


def _check_bool(name: str, column: Array, hint: str = "") -> None:
    dtype = np.asarray(column).dtype
    check(dtype.kind == "b", f"{name}.dtype", dtype, allowed="bool", hint=hint)


def _check_confidence(confidence: Array) -> None:
    inside = bool(((confidence >= 0) & (confidence <= 1)).all())
    check(
        inside,
        "confidence",
        "outside",
        allowed="from 0 to 1",
        hint="was a logit given for a confidence?",
    )
