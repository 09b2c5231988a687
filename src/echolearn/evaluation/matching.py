"""Match estimated echoes with true ones, one to one, in the manner of mir_eval.

A pair may match where time and, if given, direction differ by less than their tolerances. Of all
ways to pair each echo with at most one wall and each wall with at most one echo, the one with the
most pairs is taken, and among those the one with the smallest sum of errors relative to the
tolerances. So a wall found twice counts once, and an echo between two walls serves the one that no
other echo does.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from echolearn.acoustics.geometry import wrap
from echolearn.acoustics.types import Array
from echolearn.checks import check, check_number

UNMATCHED = -1


def match_echoes(
    reference_toa: Array,
    estimated_toa: Array,
    *,
    tolerance: float,
    reference_azimuth: Array | None = None,
    estimated_azimuth: Array | None = None,
    azimuth_tolerance: float = np.pi,
) -> Array:
    """Return the wall that each echo is matched with, shape (R,), whole numbers; `UNMATCHED` (-1)
    where none.

    Args:
        reference_toa: of W walls, shape (W,), in s; may be empty.
        estimated_toa: of R echoes, shape (R,), in s; may be empty.
        tolerance: times differ by less, in s.
        reference_azimuth, estimated_azimuth: directions, shapes (W,) and (R,), in rad; both or
            none.
        azimuth_tolerance: directions differ by less, in rad.

    Raises:
        BadValue: times or directions that are not finite or of other shapes, tolerances that are
            not positive.
    """
    check_number(
        "tolerance",
        tolerance,
        low=np.finfo(float).tiny,
        high=1.0,
        unit="s",
        hint="are times in samples?",
    )
    check_number(
        "azimuth_tolerance", azimuth_tolerance, low=np.finfo(float).tiny, high=np.pi, unit="rad"
    )
    both = (reference_azimuth is None) == (estimated_azimuth is None)
    check(both, "reference_azimuth, estimated_azimuth", "one of them", allowed="both or none")
    error = _apart("toa", reference_toa, estimated_toa) / tolerance
    if reference_azimuth is not None and estimated_azimuth is not None:
        turned = (
            np.abs(wrap(_apart("azimuth", reference_azimuth, estimated_azimuth)))
            / azimuth_tolerance
        )
        check(
            turned.shape == error.shape,
            "azimuth",
            turned.shape,
            allowed=f"as many as times, {error.shape}",
        )
        error = np.where(turned < 1, error, np.inf) + turned
        fits = (error - turned < 1) & (turned < 1)
    else:
        fits = error < 1
    costs = np.where(fits, error, 4.0 * (1 + sum(error.shape)))
    echoes, walls = linear_sum_assignment(costs)
    matched = np.full(len(error), UNMATCHED)
    good = fits[echoes, walls]
    matched[echoes[good]] = walls[good]
    return matched


def _apart(name: str, reference: Array, estimated: Array) -> Array:
    """Return |estimated - reference| of every pair, shape (R, W)."""
    for side, values in (("reference", reference), ("estimated", estimated)):
        fine = np.ndim(values) == 1 and bool(np.isfinite(values).all())
        check(
            fine,
            f"{side}_{name}",
            np.shape(values),
            allowed="one finite number for each, shape (R,) or (W,)",
        )
    return np.abs(np.asarray(estimated, dtype=float)[:, None] - np.asarray(reference, dtype=float))
