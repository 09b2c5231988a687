"""Evidence for walls: what all poses of a walk say of every line of a grid.

    H(theta, rho) = sum_p z_p(theta, rho) / sqrt(N),     N = poses that have the line in the window

With z_p = J_p (`walk`), read exactly where each pose should hear the line, N poses whose places are
known buy 10 log10 N dB over one: `exact_evidence`. Odometry is never exact, and an error of half a
lag already costs most of it. So

    z_p,w = J_p, the largest within w lags and 2 degrees, standardised over the pose's window

forgives errors of w / 2 lags (w = 2: 1.5 cm, w = 6: 5 cm) and pays for it with a higher floor:
`forgiving_evidence`. Between the two lies

    z_p = log(1 - s + s (g * exp(a J_p - a^2 / 2))),     s = `SHARE`, a = `AMPLITUDE`

the log likelihood ratio of an echo of amplitude a, heard with probability s, at a place that is
off by the Gaussian g, standardised alike: `soft_evidence`. Which of them is right depends on the
odometry, which nobody tells.

A line and the same line from its other side, (theta + pi, -rho), are two cells, of which a robot
faces one: D_p > 0. Grids of lines have their origin at the middle of the path.

Summing over poses goes by loops that numba compiles where it is installed (`pip install
echolearn[walls]`), or else by numpy, which says the same several times slower.

Who went before: Hough transforms over times of arrival (Antonacci, Filos et al. 2012), direct
multipath SLAM, on the signal itself (Liang, Leitinger, Meyer 2024, arXiv 2409.20552).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from types import ModuleType

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import check_number, check_whole
from echolearn.walls.neighbourhood import largest_near
from echolearn.walls.walk import FINER, HeardWalk

SHARE = 0.9
"""Probability that a pose which has a wall in the window hears it."""

AMPLITUDE = 2.0
"""Amplitude that soft evidence expects of an echo, in units of J."""


@dataclass(frozen=True)
class Grid:
    """Lines of which evidence is sought: normals at even angles, offsets at even steps.

    Attributes:
        normals: number T of normals around the circle; the first has the angle -pi.
        low: least offset from `origin`, in m.
        step: from one offset to the next, in m.
        offsets: their number R.
        origin: from which offsets are counted, shape (2,), in m.
    """

    normals: int
    low: float
    step: float
    offsets: int
    origin: tuple[float, float]

    @property
    def theta(self) -> Array:
        """Angles of the normals, shape (T,), in rad."""
        return -np.pi + 2.0 * np.pi / self.normals * np.arange(self.normals)

    @property
    def rho(self) -> Array:
        """Offsets from the origin, shape (R,), in m."""
        return self.low + self.step * np.arange(self.offsets)


@dataclass(frozen=True)
class Evidence:
    """What a walk says of the lines of a grid.

    Attributes:
        grid: the lines.
        values: H, shape (T, R); 0 where no pose has the line in the window.
        counts: N, poses that have it there, shape (T, R).
    """

    grid: Grid
    values: Array
    counts: Array


def grid_of(walk: HeardWalk, *, degrees: float = 0.5, step: float = 0.01) -> Grid:
    """Return a grid of all lines that some pose of a walk has in its window.

    Args:
        walk: its poses and its window.
        degrees: from one normal to the next.
        step: from one offset to the next, in m.
    """
    check_number("grid.degrees", degrees, low=0.05, high=30.0, unit="degrees")
    check_number("grid.step", step, low=0.001, high=0.2, unit="m")
    places = walk.poses[:, :2]
    # Around the middle the grid is smallest, and a turn of a normal moves far lines least.
    middle = (places.min(axis=0) + places.max(axis=0)) / 2.0
    reach = float(np.linalg.norm(places - middle, axis=1).max()) + walk.window.farthest
    half = math.ceil(reach / step) + 1
    x, y = middle.tolist()
    return Grid(round(360.0 / degrees), -half * step, step, 2 * half + 1, (x, y))


def exact_evidence(walk: HeardWalk, grid: Grid, *, compiled: bool = True) -> Evidence:
    """Return H of poses that are taken to be exact.

    Args:
        walk: what was heard, and where.
        grid: lines.
        compiled: whether to use numba where it is installed.
    """
    if compiled and (loops := _loops()):
        directions = grid.theta[:, None] - walk.poses[:, 2]
        places = walk.scale * FINER, float(walk.first * FINER)
        filters = loops.Filters(walk.fine, directions, walk.array.positions, *places)
        return _evidence(grid, loops.sum_exact(filters, loops.Lines(*_lines(walk, grid))))

    sums = np.zeros((grid.normals, grid.offsets))
    counts = np.zeros_like(sums)
    # No line is twice among those of one pose, so that adding by index adds all.
    for pose, (cells, azimuth, distance) in enumerate(_lines_by_pose(walk, grid)):
        sums[cells] += walk.at(pose=np.array(pose), azimuth=azimuth, distance=distance)
        counts[cells] += 1
    return _evidence(grid, (sums, counts))


def forgiving_evidence(
    walk: HeardWalk, grid: Grid, *, width: int, compiled: bool = True
) -> Evidence:
    """Return H that forgives errors of the poses.

    Args:
        walk: what was heard, and where.
        grid: lines.
        width: w, lags within which an echo may be; 2 forgives 1.5 cm, 6 forgives 5 cm.
        compiled: whether to use numba where it is installed.
    """
    z = forgiving(walk.responses, width=width)
    return summed(walk, grid, z=z, compiled=compiled)


def soft_evidence(walk: HeardWalk, grid: Grid, *, blur: float, compiled: bool = True) -> Evidence:
    """Return H by the likelihood of an echo whose place is known up to a blur.

    Args:
        walk: what was heard, and where.
        grid: lines.
        blur: standard deviation of the place, in m.
        compiled: whether to use numba where it is installed.
    """
    z = soft(walk.responses, blur=blur / walk.step)
    return summed(walk, grid, z=z, compiled=compiled)


def forgiving(responses: Array, *, width: int) -> Array:
    """Return z_p,w of responses (P, A, D): the largest near each, standardised, float32."""
    check_whole("evidence.width", width, low=0, high=100, unit="lags")
    # First along the distances, then across the circle of directions.
    near = largest_near(responses, width, axis=2)
    return _standardised(largest_near(near, 1, axis=1, circular=True))


def soft(responses: Array, *, blur: float) -> Array:
    """Return soft z_p of responses (P, A, D), `blur` in lags, standardised, float32."""
    return blurred(likelihood(responses), blur=blur)


def likelihood(responses: Array) -> Array:
    """Return the likelihood ratio of an echo against noise alone of J, any shape."""
    # Beyond six standard deviations all are echoes, and larger ones would outshout everything.
    return np.exp(AMPLITUDE * np.clip(responses, -6.0, 6.0) - AMPLITUDE**2 / 2.0)


def blurred(likelihoods: Array, *, blur: float) -> Array:
    """Return soft z_p of likelihoods (P, A, D), `blur` in lags, standardised, float32."""
    check_number("evidence.blur", blur, low=0.1, high=100.0, unit="lags")
    from scipy.ndimage import gaussian_filter1d

    likely = gaussian_filter1d(likelihoods, blur, axis=2, mode="nearest")
    return _standardised(np.log(1.0 - SHARE + SHARE * likely))


def summed(walk: HeardWalk, grid: Grid, *, z: Array, compiled: bool = True) -> Evidence:
    """Return H of any z_p, read where it is tabled nearest to each line.

    Args:
        walk: poses and window.
        grid: lines.
        z: shape (P, A, D), float32.
        compiled: whether to use numba where it is installed.
    """
    turn = len(walk.azimuths) / (2.0 * np.pi)
    if compiled and (loops := _loops()):
        directions = grid.theta[:, None] - walk.poses[:, 2] + np.pi
        rows = np.rint(directions * turn).astype(np.int64) % len(walk.azimuths)
        table = loops.Table(z, rows, walk.step)
        return _evidence(grid, loops.sum_tabled(table, loops.Lines(*_lines(walk, grid))))

    sums = np.zeros((grid.normals, grid.offsets))
    counts = np.zeros_like(sums)
    for table, (cells, azimuth, distance) in zip(z, _lines_by_pose(walk, grid), strict=True):
        row = np.rint((azimuth + np.pi) * turn).astype(int) % len(walk.azimuths)
        column = np.rint((distance - walk.window.nearest) / walk.step).astype(int)
        sums[cells] += table[row, np.minimum(column, table.shape[1] - 1)]
        counts[cells] += 1
    return _evidence(grid, (sums, counts))


def read_table(walk: HeardWalk, z: Array, *, azimuth: Array, distance: Array) -> Array:
    """Return z_p (P, A, D) where it is tabled nearest to directions and distances (..., P).

    Args:
        walk: how z is tabled.
        z: evidence of each pose.
        azimuth: of the normals in the robot's frame, in rad.
        distance: in m; beyond the window its nearest edge counts.
    """
    row = np.rint((azimuth + np.pi) * z.shape[1] / (2.0 * np.pi)).astype(int) % z.shape[1]
    column = np.rint((distance - walk.window.nearest) / walk.step).astype(int)
    return z[np.arange(len(z)), row, np.clip(column, 0, z.shape[2] - 1)]


def _evidence(grid: Grid, summed_up: tuple[Array, Array]) -> Evidence:
    """Return the evidence of sums over poses, and of how many there were."""
    sums, counts = summed_up
    values = sums / np.sqrt(np.maximum(counts, 1))
    return Evidence(grid, values.astype(np.float32), counts.astype(np.int32))


def _standardised(z: Array) -> Array:
    """Return z (P, A, D) less its mean, over its standard deviation, of each pose by itself."""
    centred = z - z.mean(axis=(1, 2), keepdims=True)
    deviation = centred.std(axis=(1, 2), keepdims=True)
    return np.asarray(centred / np.where(deviation > 0, deviation, 1.0), np.float32)


def _lines(walk: HeardWalk, grid: Grid) -> tuple[Array, float, float, float, float, int]:
    """Return what the compiled loops want to know of the lines."""
    near, far = float(walk.window.nearest), float(walk.window.farthest)
    return _offsets(walk, grid), near, far, grid.low, grid.step, grid.offsets


def _offsets(walk: HeardWalk, grid: Grid) -> Array:
    """Return n . (x_p - origin), by which each pose is on its way to a line, shape (T, P), in m."""
    normals = np.stack([np.cos(grid.theta), np.sin(grid.theta)], axis=1)
    return normals @ (walk.poses[:, :2] - np.array(grid.origin)).T


def _lines_by_pose(
    walk: HeardWalk, grid: Grid
) -> Iterator[tuple[tuple[Array, Array], Array, Array]]:
    """Yield which cells each pose has in its window, and direction and distance it has them in."""
    rho = grid.rho
    near, far = walk.window.nearest, walk.window.farthest
    for pose, along in zip(walk.poses, _offsets(walk, grid).T, strict=True):
        distance = rho - along[:, None]
        cells = np.nonzero((distance >= near - 1e-9) & (distance <= far + 1e-9))
        azimuth = (grid.theta - pose[2])[cells[0]]
        yield (cells[0], cells[1]), azimuth, distance[cells]


@cache
def _loops() -> ModuleType | None:
    """Return the compiled loops, or None where there is no numba."""
    # It takes a third of a second to import, which one sum of these already saves.
    if not find_spec("numba"):
        return None
    from echolearn.walls import evidence_loops

    return evidence_loops
