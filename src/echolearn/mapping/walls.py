"""Walls from map points: straight lines, how far they reach, how certain they are.

An echo of a flat wall comes from its perpendicular, so each point p with the unit vector u, from
the robot toward it, proposes a line by itself: normal u, offset u . p. The proposal that most
points support (within `WIDTH` of the line, seen within `SLANT` of its normal) is fitted by total
least squares to its supporters; where these leave a gap of more than `GAP`, the wall ends. Its
points are taken away, and the next line is sought, while one has `SUPPORT` points.

For n points with residuals of standard deviation s and positions t along the line, the offset at
the middle has the standard deviation s / sqrt(n), the angle s / sqrt(sum (t - mean t)^2).
"""

from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.types import Array

WIDTH = 0.10
"""m that a point may be off its line."""

SLANT = np.deg2rad(15.0)
"""rad between the ray to a point and the normal of its line."""

GAP = 1.5
"""m without a point at which a wall ends."""

SUPPORT = 4
"""Points that make a line."""

REFITS = 10
"""How often a line is fitted anew to its supporters, which settle after two or three."""


@dataclass(frozen=True)
class Line:
    """A stretch of wall.

    Attributes:
        start, end: its ends, each of shape (2,), in m.
        normal: direction from the robot to the wall, in rad.
        offset: distance of the wall's line from the origin along the normal, in m.
        normal_sd: standard deviation of the normal, in rad.
        offset_sd: standard deviation of the offset, in m, at the middle of the stretch.
        rms: root mean square of the points' distances from the line, in m.
        points: number of points that it was fitted to.
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
        toward: unit vectors from where the robot stood to each, shape (P, 2).
    """
    found = []
    free = np.ones(len(points), dtype=bool)
    while free.sum() >= SUPPORT:
        members = _supporters(points, toward, free=free)
        if len(members) < SUPPORT:
            break
        found.append(_fit(points[members], toward[members]))
        free[members] = False
    return found


def _supporters(points: Array, toward: Array, *, free: Array) -> Array:
    """Return the free points that support the best line, refitted until they stay the same."""
    # The line that a single ray proposes is less certain than the one through all its supporters.
    normals = toward[free]
    offsets = np.sum(points[free] * normals, axis=1)
    members = np.empty(0, dtype=int)
    for _ in range(1 + REFITS):
        near = np.abs(points @ normals.T - offsets) <= WIDTH
        alike = toward @ normals.T >= np.cos(SLANT)
        support = near & alike & free[:, None]
        again = _longest(points, np.flatnonzero(support[:, support.sum(axis=0).argmax()]))
        if len(again) < SUPPORT or np.array_equal(again, members):
            return again
        members = again
        line = _fit(points[members], toward[members])
        normals = np.array([[np.cos(line.normal), np.sin(line.normal)]])
        offsets = np.array([line.offset])
    return members


def _longest(points: Array, members: Array) -> Array:
    """Return the largest group of members without a gap along their common line."""
    if len(members) < SUPPORT:
        return members
    centred = points[members] - points[members].mean(axis=0)
    along = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    # Sorted along the line, a gap is a step between neighbours.
    order = np.argsort(along)
    groups = np.split(order, np.flatnonzero(np.diff(along[order]) > GAP) + 1)
    return np.sort(members[max(groups, key=len)])


def _fit(points: Array, toward: Array) -> Line:
    """Return the total least squares line through points, its normal pointing as the rays do."""
    centre = points.mean(axis=0)
    ray = toward.mean(axis=0)
    tangent, across = np.linalg.svd(points - centre, full_matrices=False)[2]

    if np.ptp((points - centre) @ tangent) < 2 * WIDTH:
        # A heap, as of a robot that stands still, has no direction of its own: take the rays'.
        normal = ray / np.linalg.norm(ray)
    else:
        normal = across if across @ ray >= 0 else -across

    tangent = np.array([-normal[1], normal[0]])
    along = (points - centre) @ tangent
    residual = (points - centre) @ normal
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
