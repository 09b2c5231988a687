"""Walls from map points: straight lines, how far they reach, how certain they are.

An echo of a flat wall comes from its perpendicular, so each point p with the direction u it was
heard from proposes a
line by itself: normal u, offset u . p. The proposal that most points support (within `WIDTH` of the
    line, heard from
within `SLANT` of its normal) is fitted by total least squares to its supporters; where these leave
a gap of more than `GAP`, the wall ends. Its points are taken away, and the next line is sought,
while one has `SUPPORT` points.

For n points with residuals of standard deviation s and positions t along the line, the offset at
the middle has the standard deviation s / sqrt(n), the angle s / sqrt(sum (t - mean t)^2).
"""

from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.types import Array

WIDTH = 0.10
SLANT = np.deg2rad(15.0)
GAP = 1.5
SUPPORT = 4


@dataclass(frozen=True)
class Line:
    """A stretch of wall.

    Attributes:
        start, end: shape (2,), in m.
        normal: direction from the robot to the wall, in rad.
        offset: distance of the wall's line from the origin along the normal, in m.
        normal_sd: in rad.
        offset_sd: in m, at the middle of the stretch.
        rms: of the points' distances from the line, in m.
        points: that it was fitted to.
    """

    start: Array
    end: Array
    normal: float
    offset: float
    normal_sd: float
    offset_sd: float
    rms: float
    points: int


def fit_lines(points: Array, toward: Array) -> list[Line]:
    """Return the walls that points suggest, those with the most points first.

    Args:
        points: shape (P, 2), in m.
        toward: unit vectors from where each was heard to it, shape (P, 2).
    """
    found, free = [], np.ones(len(points), dtype=bool)
    while free.sum() >= SUPPORT:
        members = _best(points, toward, free)
        if len(members) < SUPPORT:
            break
        found.append(_fit(points[members], toward[members]))
        free[members] = False
    return found


def _best(points: Array, toward: Array, free: Array) -> Array:
    """Return the free points that support the best line, refitted until they stay the same."""
    near = np.abs(points @ toward.T - np.sum(points * toward, axis=1)) <= WIDTH  # [point, proposal]
    alike = toward @ toward.T >= np.cos(SLANT)
    support = near & alike & free[:, None] & free[None, :]
    members = _longest(points, np.flatnonzero(support[:, support.sum(axis=0).argmax()]))
    for _ in range(10):
        if len(members) < SUPPORT:
            return members
        line = _fit(points[members], toward[members])
        normal = np.array([np.cos(line.normal), np.sin(line.normal)])
        inside = (
            (np.abs(points @ normal - line.offset) <= WIDTH)
            & (toward @ normal >= np.cos(SLANT))
            & free
        )
        again = _longest(points, np.flatnonzero(inside))
        if np.array_equal(again, members):
            break
        members = again
    return members


def _longest(points: Array, members: Array) -> Array:
    """Return the largest group of members without a gap along their common line."""
    if len(members) < SUPPORT:
        return members
    centred = points[members] - points[members].mean(axis=0)
    along = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    order = np.argsort(along)
    groups = np.split(order, np.flatnonzero(np.diff(along[order]) > GAP) + 1)
    return np.sort(members[max(groups, key=len)])


def _fit(points: Array, toward: Array) -> Line:
    """Return the total least squares line through points, its normal on the side they were heard
    toward.
    """
    centre = points.mean(axis=0)
    axes = np.linalg.svd(points - centre, full_matrices=False)[2]
    if (
        np.ptp((points - centre) @ axes[0]) < 2 * WIDTH
    ):  # a heap has no direction of its own: take the rays'
        normal = toward.mean(axis=0) / np.linalg.norm(toward.mean(axis=0))
    else:
        normal = axes[1] * (1.0 if axes[1] @ toward.mean(axis=0) >= 0 else -1.0)
    tangent = np.array([-normal[1], normal[0]])
    along, residual = (points - centre) @ tangent, (points - centre) @ normal
    deviation = float(np.sqrt(np.sum(residual**2) / max(len(points) - 2, 1)))
    return Line(
        start=centre + along.min() * tangent,
        end=centre + along.max() * tangent,
        normal=float(np.arctan2(normal[1], normal[0])),
        offset=float(centre @ normal),
        normal_sd=float(min(deviation / max(np.sqrt(np.sum(along**2)), 1e-9), np.pi)),
        offset_sd=deviation / float(np.sqrt(len(points))),
        rms=float(np.sqrt(np.mean(residual**2))),
        points=len(points),
    )
