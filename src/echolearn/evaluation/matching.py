"""Match estimated echoes with true ones, one to one, in the manner of mir_eval.

A pair may match where its times differ by less than the tolerance. Of all ways to pair each echo
with at most one wall and each wall with at most one echo, the one with the most pairs is taken, and
among those the one with the smallest sum of errors. So a wall found twice counts once, and an echo
between two walls serves the one that no other echo does.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from echolearn.acoustics.types import Array
from echolearn.checks import check_number, finite_vector

TOA_TOLERANCE_SAMPLES = 10
"""Samples by which an echo's time may miss that of a wall: the paper's label."""

UNMATCHED = -1


def match_echoes(reference_toa: Array, estimated_toa: Array, *, tolerance: float) -> Array:
    """Return the wall that each echo is matched with, `UNMATCHED` (-1) where none.

    Args:
        reference_toa: times of W walls, shape (W,), in s; may be empty.
        estimated_toa: times of R echoes, shape (R,), in s; may be empty.
        tolerance: bound that the difference of two times stays below, in s.

    Returns:
        Numbers of walls, shape (R,), whole numbers.

    Raises:
        BadValue: times that are not finite or of another shape, a tolerance that is not positive.
    """
    least = np.finfo(float).tiny
    hint = "are times in samples?"
    check_number("tolerance", tolerance, low=least, high=1.0, unit="s", hint=hint)
    walls = _times("reference_toa", reference_toa)
    echoes = _times("estimated_toa", estimated_toa)
    error = np.abs(echoes[:, None] - walls) / tolerance
    fits = error < 1
    # A pair that does not fit costs more than all others together, so it is taken last.
    costs = np.where(fits, error, 4.0 * (1 + sum(error.shape)))
    rows, columns = linear_sum_assignment(costs)
    good = fits[rows, columns]
    matched = np.full(len(error), UNMATCHED)
    matched[rows[good]] = columns[good]
    return matched


def _times(name: str, values: Array) -> Array:
    allowed = "must be one finite time in s for each, in one row"
    return finite_vector(name, values, allowed=allowed)
