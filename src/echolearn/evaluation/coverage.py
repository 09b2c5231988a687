"""How much of the walls a map shows: coverage, and distances in both directions.

Walls 1 to 2 m from a pose give an echo inside the search window. The foot of the perpendicular from
the pose is where that echo's map point belongs, and the wall within 0.25 m of a foot is
*reachable*. A kept point covers the wall within 0.25 m of itself, so a map of every perfect point
has a coverage of exactly 1. The symmetric distance is that of Barshan, "Objective error criterion
for evaluation of mapping accuracy based on sensor time-of-flight measurements", Sensors 8 (2008):
(mean_p min_q |p - q| + mean_q min_p |p - q|) / 2 for kept points p and reachable wall q.

Both speak of a union of points. Bootstrap resampling drops a third of the poses and would bias
them: no weights here.
"""

import math

import numpy as np

from echolearn.acoustics.sides import blocked
from echolearn.acoustics.types import Array
from echolearn.evaluation.metrics import ratio

NEAREST, FARTHEST = 1.0, 2.0
"""m; wall distances whose echoes lie inside the search window."""

REACH = 0.25
"""m of wall on either side that one point covers."""

STEP = 0.05
"""m; the longest piece of wall that counts as one."""


def wall_samples(walls: Array) -> tuple[Array, Array]:
    """Cut walls (W, 2, 2) into pieces: their middles (S, 2) and their lengths (S,), in m."""
    starts = walls[:, 0]
    edges = walls[:, 1] - starts
    lengths = np.linalg.norm(edges, axis=1)
    counts = np.ceil(lengths / STEP - 1e-9).astype(int)
    middles = []
    for start, edge, count in zip(starts, edges, counts, strict=True):
        along = (np.arange(count) + 0.5)[:, None] / count
        middles.append(start + along * edge)
    return np.concatenate(middles), np.repeat(lengths / counts, counts)


def feet(
    walls: Array, poses: Array, *, nearest: float = NEAREST, farthest: float = FARTHEST
) -> tuple[Array, Array]:
    """Drop perpendiculars from poses on walls: feet (P, W, 2) in m, which echo, (P, W).

    Those echo whose foot lies on the wall, within the distances, and no other wall in between.

    Args:
        walls: of the floor plan, shape (W, 2, 2), in m.
        poses: shape (P, 2), in m.
        nearest, farthest: distances, in m.
    """
    start = walls[:, 0]
    edge = walls[:, 1] - start
    along = ((poses[:, None] - start) * edge).sum(-1) / (edge**2).sum(-1)
    foot = start + along[..., None] * edge
    distance = np.linalg.norm(foot - poses[:, None], axis=-1)
    echoes = (along >= 0) & (along <= 1) & (distance >= nearest) & (distance <= farthest)
    pose, wall = np.nonzero(echoes)
    echoes[pose, wall] = ~blocked(poses[pose], foot[pose, wall], side=wall, sides=walls)
    return foot, echoes


def attainable(walls: Array, poses: Array) -> float:
    """Return the share of poses (P, 2) with a wall 1 to 2 m away; NaN without poses.

    It is about what one echo a pose can get right.
    """
    return float(feet(walls, poses)[1].any(axis=1).mean()) if len(poses) else math.nan


def of_walls(walls: Array, shown: Array, *, poses: Array) -> dict[str, float]:
    """Return `wall_coverage` and `nearest_neighbour_error` of the points that a map shows.

    Args:
        walls: of the floor plan, shape (W, 2, 2), in m.
        shown: kept points, shape (any, 2), in m.
        poses: positions of the whole walk, shape (any, 2), in m.

    Returns:
        Coverage is the share of the reachable wall within 0.25 m of a point; NaN if none is
        reachable. The error is the mean distance in m between points and reachable wall, over both
        directions (Barshan, 2008); NaN if there is no point, or nothing is reachable.
    """
    middles, lengths = wall_samples(walls)
    foot, echoes = feet(walls, poses)
    reachable = _nearest(middles, foot[echoes]) <= REACH
    wall = middles[reachable]
    lengths = lengths[reachable]
    away = _nearest(wall, shown)
    covered = float(ratio(lengths[away <= REACH].sum(), lengths.sum()))
    error = math.nan
    if len(wall) and len(shown):
        error = float(_nearest(shown, wall).mean() + away.mean()) / 2
    return {"wall_coverage": covered, "nearest_neighbour_error": error}


def _nearest(points: Array, others: Array) -> Array:
    """Return each point's distance to the nearest of the others, infinite if there are none."""
    # Loaded here: whoever makes sets needs none of it, and starts a process for each core.
    from scipy.spatial.distance import cdist

    distance: Array = cdist(points, others).min(axis=1, initial=np.inf)
    return distance
