"""`map.pgm` and `map.yaml`: an occupancy grid that nav2's map_server loads.

Each kept echo of confidence p says: with probability p there is a wall where its point lies and
    nothing before it,
else nothing at all. So the occupancy that it alone would give is

    p HIT + (1 - p) / 2    in the point's cell,        p MISS + (1 - p) / 2    in the cells between robot and point,

and the log-odds of all echoes add up, limited to +-LIMIT. A cell that no echo touched stays unknown
(205). Row 0 of the image is the largest y; `origin` is the pose of the lower left corner of the
lower left cell.
"""

import math

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.mapping.files.chart import Chart, Files

HIT = 0.9
MISS = 0.1
"""Below `FREE`, so that one sure echo makes a path free to map_server: what came back has been
there and back."""
LIMIT = 5.0
MARGIN = 0.5
"""m of unknown around everything seen."""

UNKNOWN = 205
OCCUPIED = 0.65
FREE = 0.196
"""Thresholds of occupancy by which map_server tells cells that are occupied, free or unknown."""

CELLS = 16_000_000
"""Most cells of a grid."""


def write(chart: Chart) -> Files:
    """Return image and description.

    Raises:
        BadValue: a resolution that makes the grid too large.
    """
    pixels, origin = image(chart)
    height, width = pixels.shape
    about = (
        "image: map.pgm\nmode: trinary\n"
        f"resolution: {chart.resolution!r}\norigin: [{origin[0]!r}, {origin[1]!r}, 0.0]\n"
        f"negate: 0\noccupied_thresh: {OCCUPIED}\nfree_thresh: {FREE}\n"
    )
    return {
        "map.pgm": f"P5\n{width} {height}\n255\n".encode() + pixels.tobytes(),
        "map.yaml": about.encode(),
    }


def image(chart: Chart) -> tuple[Array, tuple[float, float]]:
    """Return the pixels, shape (height, width), uint8, row 0 the largest y, and the origin."""
    odds, touched, origin = occupancy(chart)
    occupied = 1.0 / (1.0 + np.exp(-odds))
    return np.where(touched, np.rint(255.0 * (1.0 - occupied)), UNKNOWN).astype(np.uint8)[
        ::-1
    ], origin


def cells(chart: Chart) -> tuple[Array, tuple[float, float]]:
    """Return what map_server makes of the image, shape (height, width), int8, row 0 the smallest y,
    and the origin.

    A cell is 100, occupied; 0, free; or -1, unknown.
    """
    pixels, origin = image(chart)
    occupied = (255.0 - pixels[::-1]) / 255.0
    return np.select([occupied > OCCUPIED, occupied < FREE], [100, 0], default=-1).astype(
        np.int8
    ), origin


def occupancy(chart: Chart) -> tuple[Array, Array, tuple[float, float]]:
    """Return log-odds and whether a cell was touched, both (height, width), row 0 the smallest y,
    and the origin.
    """
    step, shown = chart.resolution, chart.drawn
    points, poses = chart.map.points[shown], chart.map.poses[shown]
    seen = np.concatenate([points, chart.path[:, :2]])
    low = np.floor((seen.min(axis=0) - MARGIN) / step)
    width, height = (np.ceil((seen.max(axis=0) + MARGIN) / step) - low).astype(int).tolist()
    hint = "choose a larger one; are the poses in m?"
    check(
        width * height <= CELLS,
        "resolution",
        f"{step} m",
        allowed=f"at most {CELLS} cells",
        hint=hint,
    )
    odds, touched = np.zeros((height, width)), np.zeros((height, width), dtype=bool)
    for point, pose, belief in zip(points, poses, chart.map.confidence[shown], strict=True):
        cells = _ray(pose / step - low, point / step - low)
        rows, columns = cells[:, 1], cells[:, 0]
        odds[rows, columns] += _log_odds(MISS, belief)
        odds[rows[-1], columns[-1]] += _log_odds(HIT, belief) - _log_odds(MISS, belief)
        touched[rows, columns] = True
    return np.clip(odds, -LIMIT, LIMIT), touched, (float(low[0] * step), float(low[1] * step))


def _ray(start: Array, end: Array) -> Array:
    """Return the cells from `start` to `end`, in cells, each once, shape (K, 2); the last one holds
    `end`.
    """
    count = 2 * math.ceil(float(np.abs(end - start).max())) + 1
    cells = np.floor(start + np.linspace(0.0, 1.0, count + 1)[:, None] * (end - start)).astype(int)
    kept = np.append((np.diff(cells, axis=0) != 0).any(axis=1), True)
    return cells[kept]


def _log_odds(occupied: float, belief: float) -> float:
    mixed = belief * occupied + (1.0 - belief) / 2.0
    return math.log(mixed / (1.0 - mixed))
