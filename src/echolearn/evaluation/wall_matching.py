"""Which wall hypotheses are right: lines against the walls of a room, one to one.

A side of the floor plan runs with the room to its left (`acoustics.sides`), so its normal from the
robot to the wall points to the right of it: the line n . x = rho, of which the other side, (theta +
pi, -rho), is another. Sides on one line are one wall, as those on either hand of a door.

An odometry has a frame of its own. Walls are carried there by the turn and shift that bring the
true places nearest to the told ones in the mean square (Umeyama 1991, without scale): so errors of
the odometry's shape count, and those of its frame do not.

A hypothesis is right if its normal is within `TURN` of a wall's, which also tells the side, and its
offset within `APART`. Of all ways to pair them one to one the one with the most pairs counts, and
among those the one with the smallest errors (`matching`): a second one on the same wall is wrong.
Offsets are compared at the middle of the path, lest a turn in a frame far away look like a shift.
"""

import numpy as np

from echolearn.acoustics.geometry import wrap
from echolearn.acoustics.types import Array
from echolearn.evaluation.matching import UNMATCHED

TURN = np.deg2rad(2.0)
"""rad by which the normal of a wall may be missed."""

APART = 0.05
"""m by which its offset may be missed."""

SAME = 1e-6
"""rad or m within which two sides are on one line."""


def wall_lines(sides: Array) -> Array:
    """Return the lines of sides (S, 2, 2): theta in rad and rho in m, shape (W, 2)."""
    along = sides[:, 1] - sides[:, 0]
    theta = np.arctan2(-along[:, 0], along[:, 1])
    rho = np.cos(theta) * sides[:, 0, 0] + np.sin(theta) * sides[:, 0, 1]
    lines: list[Array] = []
    for line in np.stack([theta, rho], axis=1):
        new = [np.abs(wrap(line[0] - a)) > SAME or abs(line[1] - b) > SAME for a, b in lines]
        if all(new):
            lines.append(line)
    return np.array(lines).reshape(-1, 2)


def alignment(true: Array, told: Array) -> tuple[float, Array]:
    """Return the turn in rad and the shift (2,) in m that bring true places (P, 2) to told ones."""
    centred = [places - places.mean(axis=0) for places in (true, told)]
    first, second = (each[:, 0] + 1j * each[:, 1] for each in centred)
    angle = float(np.angle(np.sum(second * first.conj())))
    return angle, told.mean(axis=0) - _turned(true.mean(axis=0), angle)


def carried(lines: Array, *, angle: float, shift: Array) -> Array:
    """Return lines (W, 2) in a frame that is turned and shifted.

    Args:
        lines: theta in rad and rho in m.
        angle: by which places are turned, in rad.
        shift: by which they are shifted then, shape (2,), in m.
    """
    theta = wrap(lines[:, 0] + angle)
    return np.stack([theta, lines[:, 1] + _along(theta, shift)], axis=1)


def match_walls(reference: Array, estimated: Array, *, middle: Array) -> Array:
    """Return the wall that each hypothesis is matched with, `UNMATCHED` (-1) where none, (K,).

    Args:
        reference: lines of the walls, shape (W, 2).
        estimated: those of the hypotheses, shape (K, 2), in the same frame.
        middle: of the path, from which offsets are told, shape (2,), in m.
    """
    from scipy.optimize import linear_sum_assignment

    turn = np.abs(wrap(estimated[:, None, 0] - reference[None, :, 0])) / TURN
    offsets = [lines[:, 1] - _along(lines[:, 0], middle) for lines in (estimated, reference)]
    apart = np.abs(offsets[0][:, None] - offsets[1]) / APART
    fits = (turn <= 1.0) & (apart <= 1.0)

    # A pair that does not fit costs more than all others together, so it is taken last.
    cost = np.where(fits, turn + apart, 4.0 * (1 + sum(fits.shape)))
    rows, columns = linear_sum_assignment(cost)
    good = fits[rows, columns]
    matched = np.full(len(estimated), UNMATCHED)
    matched[rows[good]] = columns[good]
    return matched


def _along(theta: Array, place: Array) -> Array:
    return np.cos(theta) * place[0] + np.sin(theta) * place[1]


def _turned(place: Array, angle: float) -> Array:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([cos * place[0] - sin * place[1], sin * place[0] + cos * place[1]])
