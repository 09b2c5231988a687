"""Match estimated echoes with true ones, one to one, in the manner of mir_eval.

A pair may match where its times differ by less than the tolerance. Of all ways to pair each echo
with at most one wall and each wall with at most one echo, the one with the most pairs is taken, and
among those the one with the smallest sum of errors. So a wall found twice counts once, and an echo
between two walls serves the one that no other echo does.

Where directions are known, a pair may also be asked to agree in them: azimuths within the
tolerance, or, where the true echo comes from so near the array's axis that its azimuth says
nothing, the angle between the two directions. What an array cannot tell apart counts as one
(`acoustics.arrays.representative`): floor and ceiling for a level ring; of a line, to which the
angle is all that it hears, both sides.
"""

import numpy as np

from echolearn.acoustics.arrays import axes, representative
from echolearn.acoustics.geometry import direction, wrap
from echolearn.acoustics.types import Array, MicArray, Truth
from echolearn.checks import check_number, finite_vector

TOA_TOLERANCE_SAMPLES = 10
"""Samples by which an echo's time may miss that of a wall: the paper's label."""

ANGLE_TOLERANCE = np.deg2rad(10.0)
"""rad by which an echo's direction may miss that of a true one: the label `time_and_direction`."""

UNMATCHED = -1


def match_echoes(
    reference_toa: Array,
    estimated_toa: Array,
    *,
    tolerance: float,
    allowed: Array | None = None,
) -> Array:
    """Return the wall that each echo is matched with, `UNMATCHED` (-1) where none.

    Args:
        reference_toa: times of W walls, shape (W,), in s; may be empty.
        estimated_toa: times of R echoes, shape (R,), in s; may be empty.
        tolerance: bound that the difference of two times stays below, in s.
        allowed: which pairs may match at all, shape (R, W), bool; all unless given.

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
    fits = error < 1 if allowed is None else (error < 1) & allowed
    # A third of a second to load, which every process that makes a set would pay.
    from scipy.optimize import linear_sum_assignment

    # A pair that does not fit costs more than all others together, so it is taken last.
    costs = np.where(fits, error, 4.0 * (1 + sum(error.shape)))
    rows, columns = linear_sum_assignment(costs)
    good = fits[rows, columns]
    matched = np.full(len(error), UNMATCHED)
    matched[rows[good]] = columns[good]
    return matched


def agree(
    reference: Truth, *, azimuth: Array, elevation: Array, array: MicArray | None = None
) -> Array:
    """Tell which echoes come from the directions of which true ones, shape (..., R, W), bool.

    Args:
        reference: W true echoes, fields (..., W); a direction that is NaN is nobody's.
        azimuth, elevation: of R echoes, shape (..., R), in rad.
        array: what heard them; None tells all directions apart.
    """
    found = direction(azimuth, elevation)
    true = direction(reference.azimuth, reference.elevation)
    there = reference.azimuth
    apart = 3 if array is None else len(axes(array))
    if array is not None and apart < 3:
        found = representative(array, found)
        true = representative(array, true)
        azimuth = np.arctan2(found[..., 1], found[..., 0])
        there = np.arctan2(true[..., 1], true[..., 0])
    between = np.arccos(np.clip(found @ np.swapaxes(true, -1, -2), -1.0, 1.0))
    turned = np.abs(wrap(azimuth[..., None] - there[..., None, :]))
    upright = np.hypot(true[..., 0], true[..., 1]) < np.sin(ANGLE_TOLERANCE)
    # Around a line nothing has an azimuth.
    beside = np.where(upright[..., None, :] | (apart < 2), between, turned)
    near: Array = beside <= ANGLE_TOLERANCE
    return near


def _times(name: str, values: Array) -> Array:
    allowed = "must be one finite time in s for each, in one row"
    return finite_vector(name, values, allowed=allowed)
