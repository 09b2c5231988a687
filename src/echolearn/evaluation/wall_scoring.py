"""How well lines that somebody believes tell the walls that a walk could hear.

    true walls, true poses --odometry's frame--> HeardWalls
    HeardWalls + BelievedLines --match_walls--> WalkCount, summed over walks--> metrics

A wall counts as *audible* if `AUDIBLE` poses hear an echo of it: the foot of their perpendicular
lies on the wall, within the window, and nothing stands in between. It is *found* if a believed line
is matched with it, one to one (`wall_matching`). Then

    found = found audible walls / audible walls,    precision = matched lines / believed lines,

both of all walks together, and of matched lines the median errors of offset (at the middle of the
path) and angle, and the median overlap of extents, the length that is both told and heard over the
length that is either, in pieces of `PIECE`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.geometry import wrap
from echolearn.acoustics.types import Array
from echolearn.evaluation.coverage import feet
from echolearn.evaluation.map_metrics import error_quantile
from echolearn.evaluation.metrics import each_weight, ratio
from echolearn.evaluation.wall_matching import alignment, carried, match_walls, wall_lines

AUDIBLE = 20
"""Poses that must hear a wall before it counts as one that can be found."""

PIECE = 0.05
"""m of wall; extents are told to such pieces."""

GAP = 1.5
"""m between feet beyond which a wall is not known to go on, as for maps (`mapping.walls`)."""


@dataclass(frozen=True)
class HeardWalls:
    """The walls of one walk in the odometry's frame.

    Attributes:
        lines: theta in rad and rho in m, shape (W, 2).
        heard: poses that hear each, shape (W,).
        pieces: numbers of the pieces of each that are heard, along its line.
        middle: of the path, shape (2,), in m.
    """

    lines: Array
    heard: Array
    pieces: tuple[Array, ...]
    middle: Array


@dataclass(frozen=True)
class BelievedLines:
    """Lines that somebody takes for walls.

    Attributes:
        lines: by which they are matched, theta in rad and rho in m, shape (K, 2).
        told: the same after a fit, whose errors count, shape (K, 2).
        stretches: ends of their parts, shape (K, S, 2, 2), in m, NaN where there are fewer.
        score: belief in each, shape (K,).
    """

    lines: Array
    told: Array
    stretches: Array
    score: Array

    def part(self, which: Array) -> "BelievedLines":
        """Return some of them."""
        return BelievedLines(*(each[which] for each in vars(self).values()))


class WalkCount(NamedTuple):
    """What came of one walk: numbers, and figures of each matched line."""

    found: int
    audible: int
    right: int
    believed: int
    offset_error: Array
    angle_error: Array
    overlap: Array


def heard_walls(
    sides: Array, *, poses: Array, told: Array, nearest: float, farthest: float
) -> HeardWalls:
    """Return the walls of a walk in the odometry's frame, and what of them could be heard.

    Args:
        sides: of the floor plan, shape (S, 2, 2), in m.
        poses: true places, shape (P, 2), in m.
        told: places by odometry, shape (P, 2), in m.
        nearest, farthest: window, in m.
    """
    lines = wall_lines(sides)
    own = wall_lines_of(sides, lines)
    foot, echoes = feet(sides, poses, nearest=nearest, farthest=farthest)
    angle, shift = alignment(poses, told)
    there = carried(lines, angle=angle, shift=shift)
    heard = []
    pieces = []
    for number, (theta, _) in enumerate(lines):
        beside = own == number
        heard.append(int(echoes[:, beside].any(axis=1).sum()))
        # A turn and a shift of the frame move pieces along the line, which the tangent tells.
        along = foot[:, beside][echoes[:, beside]] @ _tangent(theta)
        moved = shift @ _tangent(theta + angle)
        pieces.append(_pieces(_runs(np.sort(along + moved))))
    return HeardWalls(there, np.array(heard), tuple(pieces), told.mean(axis=0))


def wall_lines_of(sides: Array, lines: Array) -> Array:
    """Return on which of some lines (W, 2) each side (S, 2, 2) stands, shape (S,)."""
    own = [wall_lines(side[None])[0] for side in sides]
    apart = [np.abs(wrap(lines[:, 0] - a)) + np.abs(lines[:, 1] - b) for a, b in own]
    return np.array([int(each.argmin()) for each in apart])


def count_walk(walls: HeardWalls, believed: BelievedLines) -> WalkCount:
    """Return how the lines that somebody believes match the walls of a walk."""
    matched = match_walls(walls.lines, believed.lines, middle=walls.middle)
    audible = walls.heard >= AUDIBLE
    right = np.flatnonzero(matched >= 0)
    wall = matched[right]
    true, told = walls.lines[wall], believed.told[right]
    offsets = [each[:, 1] - _along(each[:, 0], walls.middle) for each in (told, true)]
    overlaps = [
        _overlap(walls.pieces[here], _told_pieces(believed.stretches[line], walls.lines[here, 0]))
        for line, here in zip(right, wall, strict=True)
    ]
    return WalkCount(
        found=int(audible[wall].sum()),
        audible=int(audible.sum()),
        right=len(right),
        believed=len(matched),
        offset_error=np.abs(offsets[0] - offsets[1]),
        angle_error=np.abs(wrap(told[:, 0] - true[:, 0])),
        overlap=np.array(overlaps),
    )


def evaluate_walks(
    counts: Sequence[WalkCount], weights: Array | None = None
) -> Mapping[str, Array]:
    """Return all metrics of some walks (N,), for each row of weights (resamples, N) if there are.

    Angles are in degrees, offsets in m.
    """
    each = each_weight(np.zeros(len(counts)), weights)
    sums = [np.array([count[number] for count in counts], dtype=float) for number in range(4)]
    found, audible, right, believed = (each @ column for column in sums)
    result = {"found": ratio(found, audible), "precision": ratio(right, believed)}
    walk = np.repeat(np.arange(len(counts)), [count.right for count in counts])
    for name, scale in (("offset_error", 1.0), ("angle_error", 180.0 / np.pi), ("overlap", 1.0)):
        figures = scale * np.concatenate([np.empty(0), *(getattr(c, name) for c in counts)])
        every = np.ones(len(figures), dtype=bool)
        given = None if weights is None else each[..., walk]
        result[name] = error_quantile(figures, every, share=0.5, weights=given)
    return result


def found_shares(first: Sequence[WalkCount], second: Sequence[WalkCount]) -> Array:
    """Return what each walk adds to the difference of what two have found, shape (N,)."""
    more = np.array([a.found - b.found for a, b in zip(first, second, strict=True)], dtype=float)
    return more / max(sum(count.audible for count in first), 1)


def _runs(along: Array) -> Array:
    """Return the ends of the parts between gaps of rising places, shape (runs, 2), in m."""
    if not len(along):
        return np.empty((0, 2))
    parts = np.split(along, np.flatnonzero(np.diff(along) > GAP) + 1)
    return np.array([[part[0], part[-1]] for part in parts])


def _pieces(runs: Array) -> Array:
    """Return the numbers of the pieces between ends (runs, 2)."""
    ends = np.floor(runs / PIECE).astype(int)
    return np.unique(np.concatenate([np.empty(0, int), *(np.arange(a, b + 1) for a, b in ends)]))


def _told_pieces(stretches: Array, theta: float) -> Array:
    """Return the pieces of a wall with the normal theta that stretches (S, 2, 2) cover."""
    there = stretches[np.isfinite(stretches).all(axis=(1, 2))]
    return _pieces(np.sort(there @ _tangent(theta), axis=1))


def _overlap(first: Array, second: Array) -> float:
    """Return how many pieces are of both, over those that are of either."""
    either = len(np.union1d(first, second))
    return len(np.intersect1d(first, second)) / either if either else 0.0


def _tangent(theta: float) -> Array:
    return np.array([-np.sin(theta), np.cos(theta)])


def _along(theta: Array, place: Array) -> Array:
    return np.cos(theta) * place[0] + np.sin(theta) * place[1]
