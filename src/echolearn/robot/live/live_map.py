"""What is known of a walk while it goes on, in memory that does not grow with it.

The grid holds every echo that is drawn. Of their points a fair sample is kept (algorithm R of
Vitter, Random sampling with a reservoir, 1985): point n takes the place of a random one with
probability `POINTS` / n. Walls are fitted to the sample whenever a sixteenth more points have been
drawn, so that all fits together cost no more than a few of the last. Of the waterfall the last rows
are kept, of the path the last poses.
"""

from collections import deque
from dataclasses import dataclass, field
from threading import Lock

import numpy as np

from echolearn.acoustics.types import Array, Pose
from echolearn.mapping.walls import Line, fit_lines
from echolearn.robot.live.growing_grid import GrowingGrid
from echolearn.robot.waterfall import SIZE
from echolearn.survey.health import Health

POINTS = 2048
"""Points that are kept."""

PATH = 4096
"""Poses whose places are kept."""

REFIT = 16
"""Share of new points, 1 / REFIT, after which walls are fitted anew; and their least number, half
of it."""


@dataclass(frozen=True)
class LivePose:
    """A pose with its echoes.

    Attributes:
        number: its `index`.
        pose: where the robot stood.
        points: of its echoes, shape (R, 2), in m.
        confidence: shape (R,), 0 to 1.
        shown: which are drawn: kept, and of walls, shape (R,), bool.
        heard: row of the waterfall, levels (L,), uint8; empty where it is not known any more.
    """

    number: int
    pose: Pose
    points: Array
    confidence: Array
    shown: Array
    heard: Array = field(default_factory=lambda: np.zeros(0, dtype=np.uint8))


class PointSample:
    """A fair sample of points and the directions in which they were seen."""

    def __init__(self) -> None:
        self.seen = 0
        self._rng = np.random.default_rng(0)
        # x, y, the unit vector toward the point, and the confidence.
        self._rows = np.zeros((POINTS, 5))

    @property
    def rows(self) -> Array:
        """The points, shape (K, 2), toward them (K, 2), and confidences, side by side: (K, 5)."""
        return self._rows[: self.seen]

    def add(self, point: Array, place: Array, *, belief: float) -> None:
        """Add a point.

        Args:
            point: shape (2,), in m.
            place: where it was seen from, shape (2,), in m.
            belief: its confidence, 0 to 1.
        """
        toward = point - place
        row = [*point, *(toward / max(float(np.hypot(*toward)), 1e-9)), belief]
        number = self.seen if self.seen < POINTS else int(self._rng.integers(self.seen + 1))
        if number < POINTS:
            self._rows[number] = row
        self.seen += 1


@dataclass
class LiveMap:
    """A map that grows; whoever reads it from another thread holds its lock.

    Attributes:
        grid: occupancy.
        sample: of the points that are drawn.
        walls: fitted to the sample.
        path: last poses.
        last: pose that was added last.
        heard: last rows of the waterfall, levels (L,).
        poses, left_out, kept, shown: numbers of poses, of rows that could not be mapped, and of
            echoes and points.
        health: what recordings say of themselves.
        lines: what there is to say of it.
        complaints: the last rows that were left out.
        ended: whether no more poses come.
    """

    grid: GrowingGrid
    sample: PointSample = field(default_factory=PointSample)
    walls: list[Line] = field(default_factory=list)
    path: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=PATH))
    last: LivePose | None = None
    heard: deque[Array] = field(default_factory=lambda: deque(maxlen=SIZE[0]))
    poses: int = 0
    left_out: int = 0
    shown: int = 0
    health: Health | None = None
    lines: list[str] = field(default_factory=list)
    complaints: deque[str] = field(default_factory=lambda: deque(maxlen=8))
    ended: bool = False
    lock: Lock = field(default_factory=Lock)
    _next_fit: int = 4

    def add(self, new: LivePose) -> None:
        """Add a pose."""
        place = np.asarray(new.pose.position[:2], dtype=float)
        with self.lock:
            for point, belief in zip(new.points[new.shown], new.confidence[new.shown], strict=True):
                self.grid.add(place, point, belief=float(belief))
                self.sample.add(point, place, belief=float(belief))
            self.poses += 1
            self.shown += int(new.shown.sum())
            self.path.append((float(place[0]), float(place[1])))
            self.last = new
            if len(new.heard):
                self.heard.append(new.heard)
        if self.sample.seen >= self._next_fit:
            self.fit()

    def end(self) -> None:
        """Fit the walls for the last time: no more poses come."""
        self.fit()
        with self.lock:
            self.ended = True

    def fit(self) -> None:
        """Fit the walls anew."""
        rows = self.sample.rows
        # Outside the lock: only this thread changes the sample.
        found = fit_lines(rows[:, :2], rows[:, 2:4])
        with self.lock:
            self.walls = found
        self._next_fit = self.sample.seen + max(REFIT // 2, self.sample.seen // REFIT)
