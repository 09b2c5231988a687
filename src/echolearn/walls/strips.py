"""Strips: what each pose heard around a hypothesis, and columns that describe them.

A strip is J of each pose that has the hypothesis in its window, at the distances D_p + l `step` for
lags l = -reach ... reach, and at the directions of the normal and some beside it:

    strip[p, l, a] = J_p(n turned by a, D_p + l step)

A true wall is a bright line at l = 0, straight where poses are exact, wobbling with the odometry,
ending where the wall ends. A corner mirrors like a point, so its line bends; the floor has no
direction.

*A leak.* Walks that follow walls have them at the distances that the path was made for. Which lags
lie outside the window, how many poses have the line, how far it is, tell true walls from false ones
without any sound. Lags outside the window are therefore masked, and `filled` puts noise there:
values drawn from the same pose. Columns of `nouns.SOUND` are of sound alone, those of
`nouns.GEOMETRY` are all the rest, for a control that should know nothing.
"""

import math
from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import check_whole
from echolearn.walls.evidence import forgiving, read_table
from echolearn.walls.nouns import GEOMETRY, Hypotheses
from echolearn.walls.walk import HeardWalk

REACH = 24
"""Lags on either side of a hypothesis: 19 cm."""

DIGITS = 2048
"""Whole numbers below this are exact in float16."""

BESIDE = np.deg2rad([-9.0, -6.0, -3.0, 0.0, 3.0, 6.0, 9.0])
"""Directions of a strip, from that of the normal, in rad."""


@dataclass(frozen=True)
class Strips:
    """What K hypotheses of a walk look like from its P poses.

    Attributes:
        values: J, shape (K, P, lags, directions), float32; 0 where `known` is False.
        known: whether the pose has that lag in its window, shape (K, P, lags).
        seen: whether the pose has the hypothesis itself in its window, shape (K, P).
    """

    values: Array
    known: Array
    seen: Array


def strips(
    walk: HeardWalk, found: Hypotheses, *, reach: int = REACH, beside: Array = BESIDE
) -> Strips:
    """Cut the strips of some hypotheses.

    Args:
        walk: what was heard, and where.
        found: K hypotheses.
        reach: lags on either side.
        beside: directions from that of the normal, shape (A,), in rad.
    """
    check_whole("strips.reach", reach, low=0, high=1000, unit="lags")
    azimuth, distance, seen = walk.seen(found.theta, found.rho)
    lags = walk.step * np.arange(-reach, reach + 1)
    away = distance[..., None] + lags
    window = walk.window
    known = (away >= window.nearest) & (away <= window.farthest) & seen[..., None]

    values = np.zeros((*known.shape, len(beside)), np.float32)
    hypothesis, pose, lag = np.nonzero(known)
    for number, turn in enumerate(beside):
        toward = azimuth[hypothesis, pose] + turn
        there = away[hypothesis, pose, lag]
        values[hypothesis, pose, lag, number] = walk.at(pose=pose, azimuth=toward, distance=there)
    return Strips(values, known, seen)


def filled(walk: HeardWalk, cut: Strips, *, rng: np.random.Generator) -> Array:
    """Return the values of strips with noise where nothing is known, of the same shape.

    Args:
        walk: whose responses the noise is drawn from.
        cut: strips of the walk.
        rng: draws it.
    """
    # Of the same pose, so that silence or reverberation there looks like the rest of it.
    table = walk.responses.reshape(len(walk.poses), -1)
    hypothesis, pose, lag = np.nonzero(~cut.known)
    drawn = rng.integers(table.shape[1], size=(len(pose), cut.values.shape[-1]))
    whole = cut.values.copy()
    whole[hypothesis, pose, lag] = table[pose[:, None], drawn]
    return whole


def strip_rows(walk: HeardWalk, cut: Strips, *, number: int, rng: np.random.Generator) -> Array:
    """Return strips as classifiers look at them, shape (K, P, 1 + lags directions), float16.

    Args:
        walk: what was heard, and where.
        cut: strips of its hypotheses.
        number: of the walk, by which its hypotheses are known to belong together.
        rng: draws the noise where nothing is known.
    """
    values = filled(walk, cut, rng=rng) * cut.seen[..., None, None]
    count, poses = cut.seen.shape
    entries = math.prod(values.shape[2:])
    table = np.zeros((count, poses, 1 + entries), np.float16)
    # So that a network need not look at what has nothing.
    first = np.argsort(~cut.seen, axis=1, kind="stable")
    ordered = np.take_along_axis(values.reshape(count, poses, entries), first[..., None], axis=1)
    table[..., 1:] = ordered
    table[:, :2, 0] = divmod(number, DIGITS)
    return table


def sound_columns(walk: HeardWalk, found: Hypotheses, *, cut: Strips) -> Array:
    """Return the columns `nouns.SOUND` of K hypotheses, shape (K, columns), float32.

    Args:
        walk: what was heard, and where.
        found: the hypotheses.
        cut: their strips.
    """
    azimuth, distance, seen = walk.seen(found.theta, found.rho)
    middle = cut.values.shape[2] // 2, cut.values.shape[3] // 2
    there = cut.values[:, :, middle[0], middle[1]]
    sums = [_sum(there, seen)]
    for width in (2, 6, 12):
        z = forgiving(walk.responses, width=width)
        near = read_table(walk, z, azimuth=azimuth, distance=distance)
        sums.append(_sum(near, seen))
        if width == 2:
            nearest = np.where(seen, near, np.nan)

    # The mean over poses along the lags: of a wall, one peak over a flat floor.
    profile = _mean(cut.values[..., middle[1]], cut.known)
    peak = profile.max(axis=1)
    offset = np.abs(profile.argmax(axis=1) - middle[0])
    off = np.sqrt(np.mean(np.square(profile), axis=1))
    # A wall has a direction; floor and ceiling sound alike from all sides.
    around = _mean(cut.values[:, :, middle[0]], seen[..., None])
    beside = np.delete(around, middle[1], axis=1)
    # What the strongest line of the walk has: there is one wall at least in most.
    relative = sums[1] / max(float(sums[1].max(initial=0.0)), 1e-9)
    columns = [
        *sums,
        found.strength,
        relative,
        _mean(nearest > 3.0, seen),
        _mean(nearest > 4.0, seen),
        _quantile(nearest, 0.5),
        _quantile(nearest, 0.25),
        peak,
        offset,
        peak / np.maximum(off, 1e-9),
        around[:, middle[1]] - np.abs(beside).mean(axis=1),
        _weaker_half(there, seen),
    ]
    return np.stack(columns, axis=1).astype(np.float32)


def geometry_columns(walk: HeardWalk, found: Hypotheses, *, cut: Strips) -> Array:
    """Return the columns `nouns.GEOMETRY` of K hypotheses, shape (K, columns), float32.

    Args:
        walk: what was heard, and where.
        found: the hypotheses.
        cut: their strips.
    """
    _, distance, seen = walk.seen(found.theta, found.rho)
    tangent = np.stack([-np.sin(found.theta), np.cos(found.theta)], axis=1)
    feet = tangent @ walk.poses[:, :2].T
    rows = [
        _geometry(away[here], along=along[here], known=known[here], behind=np.mean(away <= 0))
        for away, along, known, here in zip(distance, feet, cut.known, seen, strict=True)
    ]
    shares = seen.mean(axis=1, keepdims=True)
    counts = seen.sum(axis=1, keepdims=True)
    table = np.array(rows).reshape(len(found), len(GEOMETRY) - 2)
    return np.hstack([counts, shares, table]).astype(np.float32)


def _geometry(distance: Array, *, along: Array, known: Array, behind: float) -> list[float]:
    """Return what the places of some poses tell of one hypothesis, from `distance_mean` on.

    Args:
        distance: of the poses that have it in the window, shape (N,), in m.
        along: where each is along the line, shape (N,), in m.
        known: lags of its strip that are in the window, shape (N, lags).
        behind: share of all poses that are beyond the line.
    """
    if not len(distance):
        return [0.0] * 8 + [behind]
    gaps = np.diff(np.sort(along), prepend=along.min())
    step = np.abs(np.diff(along)).mean() if len(along) > 1 else 0.0
    about = [distance.mean(), distance.std(), distance.min(), distance.max(), 1.0 - known.mean()]
    return [*about, float(np.ptp(along)), float(gaps.max()), float(step), behind]


def _sum(z: Array, seen: Array) -> Array:
    """Return the sum of z (K, P) over the poses that have each in the window, over sqrt(N)."""
    return np.where(seen, z, 0.0).sum(axis=1) / np.sqrt(np.maximum(seen.sum(axis=1), 1))


def _mean(values: Array, known: Array) -> Array:
    """Return the mean over poses, axis 1, of what is known; 0 where nothing is."""
    return np.where(known, values, 0.0).sum(axis=1) / np.maximum(known.sum(axis=1), 1)


def _quantile(values: Array, share: float) -> Array:
    """Return quantiles (K,) of values (K, P) that are not NaN; 0 where there are none."""
    some = np.isfinite(values).any(axis=1, keepdims=True)
    return np.asarray(np.nanquantile(np.where(some, values, 0.0), share, axis=1))


def _weaker_half(z: Array, seen: Array) -> Array:
    """Return the smaller evidence (K,) of the first and the second half of the poses that see it.

    A wall is there all along; a chance meeting of noise is not.
    """
    order = np.cumsum(seen, axis=1)
    first = seen & (2 * order <= order[:, -1:])
    return np.minimum(_sum(z, first), _sum(z, seen & ~first))
