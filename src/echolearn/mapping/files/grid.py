"""`map.pgm` and `map.yaml`: an occupancy grid that nav2's map_server loads.

Each kept echo of confidence p says: with probability p there is a wall where its point lies and
nothing before it, else nothing at all. So the occupancy that it alone would give is

    p HIT + (1 - p) / 2     in the point's cell
    p MISS + (1 - p) / 2    in the cells between robot and point

and the log-odds of all echoes add up, limited to +-LIMIT. A cell that no echo touched stays unknown
(205). Row 0 of the image is the largest y; `origin` is the pose of the lower left corner of the
lower left cell.
"""

import math

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.mapping.mapped_walk import Files, MappedWalk

HIT = 0.9
MISS = 0.1
"""Occupancy below `FREE`, so that one sure echo makes a path free to map_server: what came back has
been there and back."""
LIMIT = 5.0
MARGIN = 0.5
"""m of unknown around everything seen."""

UNKNOWN = 205
OCCUPIED = 0.65
FREE = 0.196
"""Thresholds of occupancy by which map_server tells cells that are occupied, free or unknown."""

MOST_CELLS = 16_000_000

Origin = tuple[float, float]


def write(walk: MappedWalk) -> Files:
    """Return image and description.

    Raises:
        BadValue: a resolution that makes the grid too large.
    """
    pixels, origin = image(walk)
    height, width = pixels.shape
    x, y = origin
    about = f"""\
image: map.pgm
mode: trinary
resolution: {walk.resolution!r}
origin: [{x!r}, {y!r}, 0.0]
negate: 0
occupied_thresh: {OCCUPIED}
free_thresh: {FREE}
"""
    header = f"P5\n{width} {height}\n255\n"
    return {"map.pgm": header.encode() + pixels.tobytes(), "map.yaml": about.encode()}


def image(walk: MappedWalk) -> tuple[Array, Origin]:
    """Return the pixels, shape (height, width), uint8, row 0 the largest y, and the origin."""
    odds, touched, origin = occupancy(walk)
    return shades(odds, touched)[::-1], origin


def shades(odds: Array, touched: Array) -> Array:
    """Return the pixels of log-odds (height, width), uint8, `UNKNOWN` where nothing was seen."""
    free = 1.0 - 1.0 / (1.0 + np.exp(-odds))
    return np.where(touched, np.rint(255.0 * free), UNKNOWN).astype(np.uint8)


def cells(walk: MappedWalk) -> tuple[Array, Origin]:
    """Return what map_server makes of the image, and the origin.

    The cells have the shape (height, width), int8, row 0 the smallest y: 100 is occupied, 0 is
    free, -1 is unknown.
    """
    # From the pixels, so that both say the same after rounding.
    pixels, origin = image(walk)
    return known_cells(pixels[::-1]), origin


def known_cells(pixels: Array) -> Array:
    """Return pixels (height, width) as map_server reads them: 100, 0 or -1, int8."""
    occupied = (255.0 - pixels) / 255.0
    known = np.where(occupied > OCCUPIED, 100, np.where(occupied < FREE, 0, -1))
    return known.astype(np.int8)


def occupancy(walk: MappedWalk) -> tuple[Array, Array, Origin]:
    """Return log-odds, whether a cell was touched, and the origin.

    Both grids have the shape (height, width), row 0 the smallest y.
    """
    points = walk.map.points[walk.shown]
    low, width, height = _extent(np.concatenate([points, walk.path[:, :2]]), walk.resolution)
    odds = np.zeros((height, width))
    touched = np.zeros((height, width), dtype=bool)

    starts = walk.map.poses[walk.shown] / walk.resolution - low
    ends = points / walk.resolution - low
    for start, end, belief in zip(starts, ends, walk.map.confidence[walk.shown], strict=True):
        mark(odds, touched, ray=ray_cells(start, end), belief=belief)

    x, y = (low * walk.resolution).tolist()
    return np.clip(odds, -LIMIT, LIMIT), touched, (x, y)


def mark(odds: Array, touched: Array, *, ray: Array, belief: float) -> None:
    """Add an echo to a grid.

    Args:
        odds: log-odds of the cells, shape (height, width); changed.
        touched: whether each was seen, the same shape; changed.
        ray: columns and rows of the cells from the robot to the point, shape (K, 2).
        belief: confidence of the echo, 0 to 1.
    """
    columns, rows = ray.T
    odds[rows, columns] += _log_odds(MISS, belief)
    # The last cell holds the point itself: there the wall is, so the path's share is undone.
    odds[rows[-1], columns[-1]] += _log_odds(HIT, belief) - _log_odds(MISS, belief)
    touched[rows, columns] = True


def _extent(seen: Array, resolution: float) -> tuple[Array, int, int]:
    """Return the lower left corner, in cells, width and height of a grid around points (K, 2)."""
    low = np.floor((seen.min(axis=0) - MARGIN) / resolution)
    high = np.ceil((seen.max(axis=0) + MARGIN) / resolution)
    width, height = (high - low).astype(int).tolist()
    check(
        width * height <= MOST_CELLS,
        "resolution",
        f"{resolution} m",
        allowed=f"must leave at most {MOST_CELLS} cells",
        hint="choose a larger one; are the poses in m?",
    )
    return low, width, height


def ray_cells(start: Array, end: Array) -> Array:
    """Return the cells between two places, in cells, each once, shape (K, 2); `end`'s is last."""
    # Two steps a cell: none between the ends is passed over unless it is touched at a corner only.
    steps = 2 * math.ceil(float(np.abs(end - start).max())) + 1
    passed = start + np.linspace(0.0, 1.0, steps + 1)[:, None] * (end - start)
    cells = np.floor(passed).astype(int)
    left = (np.diff(cells, axis=0) != 0).any(axis=1)
    return cells[np.append(left, True)]


def _log_odds(occupied: float, belief: float) -> float:
    """Return the log-odds of a cell of which one echo of this belief says that it is occupied."""
    mixed = belief * occupied + (1.0 - belief) / 2.0
    return math.log(mixed / (1.0 - mixed))
