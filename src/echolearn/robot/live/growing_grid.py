"""An occupancy grid that grows with the walk: the sums of `mapping.files.grid`, echo by echo."""

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.mapping.files.grid import LIMIT, MARGIN, Origin, mark, ray_cells, shades

STEP = 64
"""Cells by which it grows at least, so that it seldom does."""

MOST = 4_000_000
"""Cells that it may have: 100 m by 100 m of 5 cm, in 20 MB."""


class GrowingGrid:
    """Log-odds of occupancy around everything seen.

    Attributes:
        resolution: side of a cell, in m.
        beyond: echoes that were left out, since the grid would have more than `MOST` cells.
    """

    def __init__(self, resolution: float) -> None:
        self.resolution = resolution
        self.beyond = 0
        self._low = np.zeros(2, dtype=int)
        self._odds = np.zeros((0, 0), dtype=np.float32)
        self._touched = np.zeros((0, 0), dtype=bool)

    def add(self, start: Array, end: Array, *, belief: float) -> None:
        """Add an echo.

        Args:
            start: where the robot stood, shape (2,), in m.
            end: its point, shape (2,), in m.
            belief: its confidence, 0 to 1.
        """
        ends = np.stack([start, end]) / self.resolution
        low, high = np.floor([ends.min(axis=0), ends.max(axis=0)]).astype(int)
        # Before the way there is drawn, which may be long.
        if not self._reach(low, high):
            self.beyond += 1
            return
        cells = ray_cells(*ends)
        mark(self._odds, self._touched, ray=cells - self._low, belief=belief)

    def pixels(self) -> tuple[Array, Origin]:
        """Return pixels as `map.pgm` has them, but row 0 the smallest y, and the lower left corner.

        The shape is (height, width), uint8; the corner is in m.
        """
        odds = np.clip(self._odds, -LIMIT, LIMIT)
        return shades(odds, self._touched), self.corner

    @property
    def corner(self) -> Origin:
        """Lower left corner, in m."""
        x, y = (self._low * self.resolution).tolist()
        return x, y

    @property
    def size(self) -> tuple[int, int]:
        """Its width and height, in cells."""
        height, width = self._odds.shape
        return width, height

    def _reach(self, low: Array, high: Array) -> bool:
        """Tell whether cells from `low` to `high`, each (2,), fit in, after growing if need be."""
        size = np.array(self.size)
        if size.all() and (low >= self._low).all() and (high < self._low + size).all():
            return True
        margin = int(np.ceil(MARGIN / self.resolution))
        first, last = low - margin, high + margin + 1
        if size.all():
            # A robot that drives on would make it grow at every pose.
            first = np.where(first < self._low, first - STEP, self._low)
            last = np.where(last > self._low + size, last + STEP, self._low + size)
        if np.prod((last - first).astype(float)) > MOST:
            return False
        self._enlarge(first, last)
        return True

    def _enlarge(self, first: Array, last: Array) -> None:
        """Let the cells go from `first` to before `last`, each (2,), which hold those that are."""
        width, height = self.size
        left, below = (self._low - first).tolist() if width else (0, 0)
        columns, rows = (last - first).tolist()
        around = (slice(below, below + height), slice(left, left + width))
        for name in ("_odds", "_touched"):
            wider = np.zeros((rows, columns), dtype=getattr(self, name).dtype)
            wider[around] = getattr(self, name)
            setattr(self, name, wider)
        self._low = first
