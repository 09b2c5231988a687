"""Walls from the strongest echo of each pose: what a walk gives who does not sum over poses.

    J_p(tau, phi) --largest, `joint`--> one point a pose --RANSAC or Hough--> lines and their votes

*RANSAC* is what a map does (`mapping.walls`): each point proposes the line across its ray, the one
with most supporters is fitted, its points are taken away. *Hough* (Duda and Hart, 1972; Dokmanic
et al. and Antonacci, Filos et al., 2012, for echoes): a point votes for the lines through it whose
normals are within `SLANT` of its ray, and peaks of votes are lines. In both the score is the
share of the walk's poses that vote, which is cut as confidences are.
"""

import numpy as np
from scipy.ndimage import maximum_filter

from echolearn.acoustics.types import Array
from echolearn.evaluation.wall_scoring import BelievedLines
from echolearn.mapping.walls import SLANT, fit_lines

TURN = np.deg2rad(1.0)
"""rad of a cell of votes."""

STEP = 0.04
"""m of a cell of votes."""

APART = (3, 2)
"""Cells, of normals and of offsets, within which a peak is the same."""

FEWEST = 2
"""Votes of a line."""


def ransac_lines(points: Array, toward: Array) -> BelievedLines:
    """Return the lines that a map would draw through points (P, 2) with their rays (P, 2)."""
    found = fit_lines(points, toward)
    lines = np.array([[line.normal, line.offset] for line in found]).reshape(-1, 2)
    ends = np.array([[[line.start, line.end]] for line in found]).reshape(-1, 1, 2, 2)
    votes = np.array([line.points for line in found], dtype=float)
    return BelievedLines(lines, lines, ends, votes / max(len(points), 1))


def hough_lines(points: Array, toward: Array) -> BelievedLines:
    """Return the peaks of votes of points (P, 2) with their rays (P, 2), those of most first."""
    middle = points.mean(axis=0)
    theta = TURN * np.arange(round(2 * np.pi / TURN)) - np.pi
    normals = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    offsets = (points - middle) @ normals.T
    half = int(np.ceil(np.abs(offsets).max(initial=0.0) / STEP)) + 1
    cell = np.rint(offsets / STEP).astype(int) + half
    near = toward @ normals.T >= np.cos(SLANT)

    votes = np.zeros((len(theta), 2 * half + 1))
    pose, turn = np.nonzero(near)
    np.add.at(votes, (turn, cell[pose, turn]), 1.0)
    size = tuple(2 * each + 1 for each in APART)
    highest = maximum_filter(votes, size, mode=("wrap", "constant"))
    row, column = np.nonzero((votes == highest) & (votes >= FEWEST))
    order = np.argsort(-votes[row, column], kind="stable")
    row, column = _first_of_ties(row[order], column[order], count=len(theta))

    ends = []
    for turn_of, place in zip(row, column, strict=True):
        own = points[near[:, turn_of] & (cell[:, turn_of] == place)]
        along = own @ np.array([-normals[turn_of, 1], normals[turn_of, 0]])
        ends.append([own[along.argmin()], own[along.argmax()]])
    rho = STEP * (column - half) + normals[row] @ middle
    lines = np.stack([theta[row], rho], axis=1)
    stretches = np.array(ends).reshape(-1, 1, 2, 2)
    return BelievedLines(lines, lines, stretches, votes[row, column] / len(points))


def _first_of_ties(row: Array, column: Array, *, count: int) -> tuple[Array, Array]:
    """Return peaks without those that stand beside an equal one before them.

    Args:
        row, column: of the peaks, highest first, shape (K,).
        count: rows around the circle.
    """
    kept: list[int] = []
    for number in range(len(row)):
        turn = np.abs(row[kept] - row[number])
        beside = np.minimum(turn, count - turn) <= APART[0]
        if not (beside & (np.abs(column[kept] - column[number]) <= APART[1])).any():
            kept.append(number)
    return row[kept], column[kept]
