"""Metrics of maps: what the filter has left, against the room's outline.

`walls` are sides of the floor plan (`acoustics.sides`), shape (W, 2, 2), in m; a map point is true
within 0.10 m of one. Points that are kept, confidences and weights are as in
`echolearn.evaluation.metrics`, whose conventions hold here, too; `echolearn.evaluation.coverage`
holds what speaks of the walls as a whole.

A new metric of maps is an entry of `evaluate_map`.
"""

import numpy as np

from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.types import Array
from echolearn.evaluation import coverage
from echolearn.evaluation.labelling import MAP_TOLERANCE
from echolearn.evaluation.metrics import (
    each_weight,
    expected_calibration_error,
    orders,
    rates,
    ratio,
)


def error_mean(error: Array, kept: Array, *, weights: Array | None = None) -> Array:
    """Return the mean error of the kept points; NaN where nothing is kept.

    Args:
        error: distance from point to wall, shape (B,), in m.
        kept: shape (B,), bool.
        weights: shape (..., B).
    """
    each = each_weight(error, weights)
    return ratio(each @ np.where(kept, error, 0.0), each @ np.asarray(kept, dtype=float))


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
    reached = np.cumsum(each_weight(error, weights)[..., kept][..., rising], axis=-1)
    total = reached[..., -1] if len(rising) else np.zeros(reached.shape[:-1])
    # Rounding must not push a whole count, such as 0.05 * 100, to the next point.
    index = (reached < share * total[..., None] * (1 - 1e-12)).sum(axis=-1)
    return np.where(total > 0, np.append(error[kept][rising], np.nan)[index], np.nan)


def evaluate_map(
    walls: Array,
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
        walls: of the floor plan, shape (W, 2, 2), in m.
        points: points of the map, shape (P, 2), in m.
        kept: shape (P,), bool.
        confidence: shape (P,), 0 to 1.
        poses: positions of the whole walk, shape (any, 2), in m.
        weights: shape (..., P).

    Raises:
        BadValue: columns that do not belong together, a confidence outside 0 to 1.
    """
    error = distance_to_outline(points, walls)
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
        whole = coverage.of_walls(walls, points[kept], poses=poses)
        values |= {name: np.asarray(value) for name, value in whole.items()}
    return values
