"""Wall hypotheses: the lines that evidence speaks for, less those that the robot drove through.

Several maps of evidence, each right for another odometry, are told in one unit, the height of their
own `REFERENCE`-th peak, which is noise in every walk, and the largest of them counts. Its highest
peaks are the hypotheses: no other cell within `TURN` and `APART` is higher, and `SUPPORT` poses at
least have the line in their window.

A wall cannot stand where the robot drove. The path may cross the *line* of a wall beyond the wall's
end, as in a room that is an L, so what counts is the stretch that poses heard: a hypothesis is
dropped if the path crosses it between the feet of the poses whose evidence is above `HEARD`. That
is knowledge, not learned, and the same for all classifiers.
"""

from collections.abc import Sequence

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import check_whole
from echolearn.walls.evidence import (
    Evidence,
    Grid,
    blurred,
    exact_evidence,
    forgiving,
    grid_of,
    likelihood,
    read_table,
    summed,
)
from echolearn.walls.neighbourhood import largest_near
from echolearn.walls.nouns import Hypotheses
from echolearn.walls.walk import HeardWalk

REFERENCE = 25
"""Number of the peak that is the unit of a map; no room has as many walls in the window."""

TURN = np.deg2rad(3.0)
"""rad within which a normal counts as the same."""

APART = 0.08
"""m within which an offset counts as the same."""

SUPPORT = 4
"""Poses that must have a line in their window."""

HEARD = 2.5
"""Evidence, in standard deviations of a pose's window, above which a pose heard a wall."""

SLACK = 0.25
"""m beyond the outermost feet that a wall surely still stands."""

WIDTH = 4
"""Lags within which a pose is asked whether it heard a wall: 3 cm."""

BLURS = (0.5, 1.5, 4.0)
"""Blurs of soft evidence in lags: exact poses, 1 cm, 3 cm."""


def hypotheses(walk: HeardWalk, *, count: int = 20, grid: Grid | None = None) -> Hypotheses:
    """Return the lines that a walk speaks for most.

    Args:
        walk: what was heard, and where.
        count: most hypotheses wanted, before those that the path crosses are dropped.
        grid: lines to choose from; None for 0.5 degrees and 1 cm.
    """
    check_whole("hypotheses.count", count, low=1, high=1000)
    grid = grid or grid_of(walk)
    maps = [exact_evidence(walk, grid)]
    likely = likelihood(walk.responses)
    maps += [summed(walk, grid, z=blurred(likely, blur=blur)) for blur in BLURS]
    return uncrossed(walk, highest_peaks(maps, count=count))


def highest_peaks(maps: Sequence[Evidence], *, count: int) -> Hypotheses:
    """Return the highest peaks of several maps of one grid, each in units of its own noise.

    Args:
        maps: evidence of one walk.
        count: most peaks wanted.
    """
    grid = maps[0].grid
    enough = maps[0].counts >= SUPPORT
    scaled = [_scaled(np.where(enough, each.values, 0.0), grid) for each in maps]
    together = np.max(scaled, axis=0)
    row, column = _peaks(together, grid)
    row, column = row[:count], column[:count]

    # Offsets of a grid count from the middle of the path, those of hypotheses from the origin.
    theta = grid.theta[row]
    along = np.cos(theta) * grid.origin[0] + np.sin(theta) * grid.origin[1]
    return Hypotheses(theta, grid.rho[column] + along, together[row, column])


def uncrossed(walk: HeardWalk, found: Hypotheses) -> Hypotheses:
    """Return the hypotheses that the path does not cross where poses heard them."""
    azimuth, distance, inside = walk.seen(found.theta, found.rho)
    z = read_table(walk, forgiving(walk.responses, width=WIDTH), azimuth=azimuth, distance=distance)
    # Feet of the perpendiculars: where along the line each pose would hear it.
    tangent = np.stack([-np.sin(found.theta), np.cos(found.theta)], axis=1)
    feet = tangent @ walk.poses[:, :2].T
    heard = inside & (z > HEARD)
    # Where nobody heard it, all that have it in the window speak for it.
    heard = np.where(heard.sum(axis=1, keepdims=True) >= 2, heard, inside)
    low = np.where(heard, feet, np.inf).min(axis=1) - SLACK
    high = np.where(heard, feet, -np.inf).max(axis=1) + SLACK

    # Between two poses on either side of the line the path meets it in proportion.
    before, after = distance[:, :-1], distance[:, 1:]
    crossing = (before > 0) != (after > 0)
    share = before / np.where(crossing, before - after, 1.0)
    place = feet[:, :-1] + share * np.diff(feet, axis=1)
    through = crossing & (place > low[:, None]) & (place < high[:, None])
    return found.part(~through.any(axis=1))


def _scaled(values: Array, grid: Grid) -> Array:
    """Return a map in units of its `REFERENCE`-th peak, or its last one."""
    row, column = _peaks(values, grid)
    heights = values[row, column][:REFERENCE]
    return values / heights[-1] if len(heights) else values


def _peaks(values: Array, grid: Grid) -> tuple[Array, Array]:
    """Return rows and columns of the cells that no cell nearby exceeds, highest first."""
    turn = round(TURN * grid.normals / (2.0 * np.pi))
    apart = round(APART / grid.step)
    around = largest_near(largest_near(values, turn, axis=0, circular=True), apart, axis=1)
    row, column = np.nonzero((values == around) & (values > 0))
    order = np.argsort(-values[row, column], kind="stable")
    return row[order], column[order]
