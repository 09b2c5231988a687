"""Walls from map points: straight lines, and how far they reach.

An echo of a flat wall comes from its perpendicular, so each point p with the unit vector u, from
the robot toward it, proposes a line by itself: normal u, offset u . p. The proposal that most
points support (within `WIDTH` of the line, seen within `SLANT` of its normal) is fitted by total
least squares to the longest stretch of its supporters, one without a gap of more than `GAP`. Other
stretches of `SUPPORT` points on the same line belong to the same wall. Its points are taken away,
and the next line is sought, while one has `SUPPORT` points.

Supporters are counted for normals of whole degrees: points are sorted once by their offsets along
each, so that n points cost n log n. How certain a line is, is told by the scatter of its points
here; `uncertainty` knows what the scatter does not show.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.types import Array

WIDTH = 0.10
"""m that a point may be off its line."""

SLANT = np.deg2rad(15.0)
"""rad between the ray to a point and the normal of its line."""

GAP = 1.5
"""m without a point at which a stretch of a wall ends."""

SUPPORT = 4
"""Points that make a stretch."""

REFITS = 10
"""How often a line is fitted anew to its supporters, which settle after two or three."""

HEAP_SD = np.deg2rad(2.0) / np.sqrt(12)
"""rad; least standard deviation of a normal that rays alone tell: those of a grid of 2 degrees."""


@dataclass(frozen=True)
class Line:
    """A wall, in one stretch or several.

    Attributes:
        start, end: its ends, each of shape (2,), in m.
        normal: direction from the robot to the wall, in rad.
        offset: distance of the wall's line from the origin along the normal, in m.
        normal_sd: standard deviation of the normal, in rad.
        offset_sd: standard deviation of the offset, in m.
        rms: root mean square of the points' distances from the line, in m.
        points: number of points that it was fitted to.
        members: which points these are, shape (points,), counted from 0.
    """

    start: Array
    end: Array
    normal: float
    offset: float
    normal_sd: float
    offset_sd: float
    rms: float
    points: int
    members: Array


def fit_lines(points: Array, toward: Array) -> list[Line]:
    """Return the walls that points suggest, those with the most points first.

    Args:
        points: shape (P, 2), in m.
        toward: unit vectors from where the robot stood to each, shape (P, 2).
    """
    found: list[Line] = []
    free = np.ones(len(points), dtype=bool)
    if len(points) < SUPPORT:
        return found
    votes = _Votes.of(points, toward)
    while free.any():
        first = votes.most(free)
        # Rays within `SLANT` of a normal that is within `SLANT` of the first one.
        near = np.flatnonzero(free & (toward @ toward[first] >= np.cos(2 * SLANT)))
        chosen = _supporters(points[near], toward[near], first=int(near.searchsorted(first)))
        members = near[chosen]
        if len(members) < SUPPORT:
            break
        found.append(fit(points, toward, members=members))
        free[members] = False
    return found


@dataclass(frozen=True)
class _Votes:
    """Who supports whose line.

    Attributes:
        voters: points by normal in whole degrees and offset along it; each stands at all normals
            that it supports.
        low, high: voters low ... high - 1 support the line that a point proposes, each (P,).
        support: their number or, of points that have been taken away since, more, shape (P,).
    """

    voters: Array
    low: Array
    high: Array
    support: Array

    @classmethod
    def of(cls, points: Array, toward: Array) -> "_Votes":
        """Sort points (P, 2) with their rays (P, 2)."""
        slant = int(np.rad2deg(SLANT))
        degree = np.floor(np.rad2deg(np.arctan2(toward[:, 1], toward[:, 0]))).astype(int) % 360
        angle = np.deg2rad(np.arange(360) + 0.5)
        normals = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        near = (degree[:, None] + np.arange(-slant, slant + 1)) % 360
        # From the middle of all points: half a degree moves far ones the least.
        centred = points - points.mean(axis=0)
        apart = 3.0 * np.abs(centred).max() + 1.0

        places = (near * apart + np.einsum("pi,pai->pa", centred, normals[near])).ravel()
        order = places.argsort(kind="stable")
        own = degree * apart + (centred * normals[degree]).sum(axis=1)
        low = places[order].searchsorted(own - WIDTH)
        high = places[order].searchsorted(own + WIDTH, side="right")
        return cls(order // near.shape[1], low, high, high - low)

    def most(self, free: Array) -> int:
        """Return the free point whose line most free points support."""
        self.support[~free] = 0
        while True:
            # Support only shrinks: once the largest has been counted anew, no other can exceed it.
            best = int(self.support.argmax())
            count = int(free[self.voters[self.low[best] : self.high[best]]].sum())
            if count == self.support[best]:
                return best
            self.support[best] = count


def _supporters(points: Array, toward: Array, *, first: int) -> Array:
    """Return the points that support the line of point `first`, refitted until they settle."""
    # The line that a single ray proposes is less certain than the one through all its supporters.
    normal = toward[first]
    offset = points[first] @ normal
    members = np.empty(0, dtype=int)
    for _ in range(1 + REFITS):
        near = np.abs(points @ normal - offset) <= WIDTH
        support = np.flatnonzero(near & (toward @ normal >= np.cos(SLANT)))
        again = max(_stretches(points, support), key=len)
        settled = np.array_equal(again, members)
        members = again
        if len(members) < SUPPORT or settled:
            break
        line = fit(points, toward, members=members)
        normal = _unit(line.normal)
        offset = line.offset
    return _extended(points, toward, members=members)


def _extended(points: Array, toward: Array, *, members: Array) -> Array:
    """Return a stretch with all others of its wall."""
    if len(members) < SUPPORT:
        return members
    line = fit(points, toward, members=members)
    normal = _unit(line.normal)
    away = np.linalg.norm(points - (line.start + line.end) / 2, axis=1)
    # The farther away, the less a short stretch knows where its line passes.
    near = np.abs(points @ normal - line.offset) <= WIDTH + 2 * line.normal_sd * away
    support = near & (toward @ normal >= np.cos(SLANT))
    support[members] = False

    for stretch in _stretches(points, np.flatnonzero(support)):
        both = np.union1d(members, stretch)
        if len(stretch) >= SUPPORT and fit(points, toward, members=both).rms <= WIDTH / 2:
            members = both
    return members


def _stretches(points: Array, members: Array) -> Iterator[Array]:
    """Yield the groups of members between gaps along their common line; too few are one group."""
    if len(members) < SUPPORT:
        yield members
        return
    centred = points[members] - points[members].mean(axis=0)
    along = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    # Sorted along the line, a gap is a step between neighbours.
    order = np.argsort(along)
    for group in np.split(order, np.flatnonzero(np.diff(along[order]) > GAP) + 1):
        yield np.sort(members[group])


def fit(points: Array, toward: Array, *, members: Array) -> Line:
    """Return the total least squares line through some points, its normal pointing as the rays do.

    Args:
        points: shape (P, 2), in m.
        toward: unit vectors from where the robot stood to each, shape (P, 2).
        members: which of them, shape (any,).
    """
    chosen = points[members]
    rays = toward[members]
    centre = chosen.mean(axis=0)
    ray = rays.mean(axis=0)
    tangent, across = np.linalg.svd(chosen - centre, full_matrices=False)[2]

    slanted = abs(across @ ray) < np.cos(SLANT) * np.linalg.norm(ray)
    heap = slanted or np.ptp((chosen - centre) @ tangent) < 2 * WIDTH
    # A heap, as of a robot that stands still, has no direction of its own: take the rays'.
    normal = ray / np.linalg.norm(ray) if heap else across * np.copysign(1.0, across @ ray)
    deviation = np.sqrt(np.sum(((chosen - centre) @ normal) ** 2) / max(len(members) - 2, 1))
    tangent = np.array([-normal[1], normal[0]])
    if heap:
        normal_sd = max(HEAP_SD, np.std(rays @ tangent) / np.sqrt(len(members)))
    else:
        normal_sd = deviation / np.sqrt(np.sum(((chosen - centre) @ tangent) ** 2))
    return line_of(
        chosen,
        members,
        normal=float(np.arctan2(normal[1], normal[0])),
        offset=float(centre @ normal),
        normal_sd=float(normal_sd),
        # At the origin, the normal's error moves the line by its distance from the middle.
        offset_sd=float(np.hypot(deviation / np.sqrt(len(members)), normal_sd * centre @ tangent)),
    )


def line_of(
    chosen: Array,
    members: Array,
    *,
    normal: float,
    offset: float,
    normal_sd: float,
    offset_sd: float,
) -> Line:
    """Return a line of which the normal and the offset are known.

    Args:
        chosen: points that it was fitted to, shape (any, 2), in m.
        members: which these are.
        normal: its direction, in rad.
        offset: its distance from the origin along the normal, in m.
        normal_sd: standard deviation of the normal, in rad.
        offset_sd: that of the offset, in m.
    """
    across = _unit(normal)
    tangent = np.array([-across[1], across[0]])
    along = chosen @ tangent
    residual = chosen @ across - offset
    return Line(
        start=offset * across + along.min() * tangent,
        end=offset * across + along.max() * tangent,
        normal=normal,
        offset=offset,
        normal_sd=normal_sd,
        offset_sd=offset_sd,
        rms=float(np.sqrt(np.mean(residual**2))),
        points=len(members),
        members=members,
    )


def _unit(angle: float) -> Array:
    return np.array([np.cos(angle), np.sin(angle)])
