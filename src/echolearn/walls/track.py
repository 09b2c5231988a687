"""Tracks: where each pose heard a wall, and the wall's line and extents from that.

In a strip the wall is a bright line that wobbles with the odometry. The *lag track* is the path
l_p through the lags that maximises

    sum_p J_p(n, D_p + l_p step) - sum_p (l_p - l_{p-1})^2 / (2 `WANDER`^2 (p - p'))

over the poses that have the wall in their window (Viterbi 1967; p' is the one before p among
them): consecutive errors of an odometry are alike. A pose *hears* the wall where J on the track is
above `HEARD`, and not much fainter than what others hear; its point is the foot of its
perpendicular there,

    x_p + (D_p + l_p step) n.

The line of the wall is fitted to these points (`mapping.walls.fit`), and reaches from the first to
the last foot, in stretches where there are gaps. A wall that too few poses hear by themselves keeps
the hypothesis's line, and nothing tells how certain that is (NaN).
"""

from dataclasses import dataclass, replace

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.mapping.walls import GAP, Line, fit
from echolearn.walls.evidence import SHARE, likelihood
from echolearn.walls.nouns import Hypotheses
from echolearn.walls.strips import Strips
from echolearn.walls.walk import HeardWalk

WANDER = 1.5
"""Lags by which the track moves from one pose to the next, in the root mean square: 1.2 cm."""

HEARD = 3.0
"""J above which a pose may have heard the wall by itself."""

FAINT = 0.5
"""Share of the median J of those that may have, below which one heard noise."""

FEWEST = 4
"""Poses that must hear a wall before its line is fitted anew."""

DEVIATION = 6
"""Lags by which a point may be off the line before it counts as somebody else's: 5 cm."""


@dataclass(frozen=True)
class Track:
    """A wall as the poses of a walk heard it.

    Attributes:
        poses: numbers of the poses that have it in their window, shape (N,).
        lags: where each heard it, from the hypothesis, shape (N,), whole lags.
        response: J there, shape (N,).
        heard: whether that is an echo rather than noise, shape (N,).
        points: feet of the perpendiculars, shape (N, 2), in m.
        line: the wall's line, fitted to the points that were heard if there are enough.
        stretches: ends of the wall along the line, shape (S, 2, 2), in m.
    """

    poses: Array
    lags: Array
    response: Array
    heard: Array
    points: Array
    line: Line
    stretches: Array

    @property
    def told(self) -> Array:
        """Which poses tell of the wall: those that heard it, or all if too few did, (N,)."""
        return self.heard if self.heard.sum() >= FEWEST else np.ones(len(self.poses), dtype=bool)

    @property
    def places(self) -> Array:
        """Points (N, 2) in m, on the line where the pose heard nothing by itself."""
        normal = np.array([np.cos(self.line.normal), np.sin(self.line.normal)])
        feet = self.points + (self.line.offset - self.points @ normal)[:, None] * normal
        return np.where(self.heard[:, None], self.points, feet)


def follow(walk: HeardWalk, found: Hypotheses, *, cut: Strips, number: int) -> Track:
    """Return the track of one hypothesis.

    Args:
        walk: what was heard, and where.
        found: hypotheses.
        cut: their strips.
        number: which of them.
    """
    poses = np.flatnonzero(cut.seen[number])
    strip = cut.values[number, poses, :, cut.values.shape[3] // 2]
    known = cut.known[number, poses]
    reach = strip.shape[1] // 2
    chosen = lag_track(np.where(known, strip, 0.0), np.diff(poses))
    response = strip[np.arange(len(poses)), chosen]

    theta, rho = found.theta[number], found.rho[number]
    normal = np.array([np.cos(theta), np.sin(theta)])
    places = walk.poses[poses, :2]
    away = rho - places @ normal + walk.step * (chosen - reach)
    points = places + away[:, None] * normal
    heard = _heard(response, chosen, possible=known[np.arange(len(poses)), chosen])
    line = _line(points, normal, heard=heard, rho=float(rho))
    stretches = _stretches(points[heard] if heard.sum() >= FEWEST else points, line)
    return Track(poses, chosen - reach, response, heard, points, line, stretches)


def _heard(response: Array, lags: Array, *, possible: Array) -> Array:
    """Tell which poses heard the wall, shape (N,).

    Args:
        response: J on the track, shape (N,).
        lags: of the track, shape (N,).
        possible: whether the pose has that lag in its window, shape (N,).
    """
    heard = possible & (response > HEARD)
    if not heard.any():
        return heard
    # Noise is a little above the limit now and then; echoes of others lie beside the line.
    loud = response > FAINT * np.median(response[heard])
    near = np.abs(lags - np.median(lags[heard])) <= DEVIATION
    return heard & loud & near


def hearing(response: Array) -> Array:
    """Return the probability that poses with these J (N,) heard a wall that is there.

    By the model of soft evidence (`evidence`): noise, or an echo of amplitude a with probability s.
    """
    odds = SHARE * likelihood(response)
    return np.asarray(odds / (1.0 - SHARE + odds))


def lag_track(strip: Array, steps: Array) -> Array:
    """Return the lags (N,) of the smooth path through a strip (N, L) on which its sum is largest.

    Args:
        strip: J of each pose at each lag.
        steps: poses from each to the next, shape (N - 1,).
    """
    lags = np.arange(strip.shape[1])
    cost = (lags[:, None] - lags) ** 2 / (2.0 * WANDER**2)
    best = strip[:1].sum(axis=0)
    came = np.zeros(strip.shape, dtype=int)
    for pose, step in enumerate(steps, start=1):
        reached = best - cost / step
        came[pose] = reached.argmax(axis=1)
        best = reached.max(axis=1) + strip[pose]

    # Back from the best end, along the way that led there.
    chosen = np.zeros(len(strip), dtype=int)
    for pose in range(len(strip) - 1, -1, -1):
        last = pose == len(strip) - 1
        chosen[pose] = best.argmax() if last else came[pose + 1, chosen[pose + 1]]
    return chosen


def _line(points: Array, normal: Array, *, heard: Array, rho: float) -> Line:
    """Return the line of the points that were heard, or the hypothesis's if there are too few.

    Args:
        points: shape (N, 2), in m.
        normal: of the hypothesis, shape (2,).
        heard: which were heard, shape (N,).
        rho: offset of the hypothesis, in m.
    """
    toward = np.tile(normal, (len(points), 1))
    if heard.sum() >= FEWEST:
        return fit(points, toward, members=np.flatnonzero(heard))
    feet = points + (rho - points @ normal)[:, None] * normal
    line = fit(feet, toward, members=np.arange(len(points)))
    # Feet on one line agree, which is no measurement of how certain it is.
    line = replace(line, normal_sd=np.nan, offset_sd=np.nan, rms=np.nan)
    return replace(line, points=0, members=np.flatnonzero(heard))


def _stretches(points: Array, line: Line) -> Array:
    """Return the ends of the parts of a line between gaps of its points, shape (S, 2, 2), in m."""
    normal = np.array([np.cos(line.normal), np.sin(line.normal)])
    tangent = np.array([-normal[1], normal[0]])
    along = np.sort(points @ tangent)
    runs = np.split(along, np.flatnonzero(np.diff(along) > GAP) + 1)
    # A single foot is no stretch, unless there is nothing else.
    long = [run for run in runs if len(run) > 1] or runs
    ends = np.array([[run[0], run[-1]] for run in long])
    return line.offset * normal + ends[..., None] * tangent
