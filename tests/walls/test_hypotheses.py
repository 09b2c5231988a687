"""Hypotheses: true walls are among them, lines that the robot drove through are not."""

import numpy as np
import pytest

from echolearn.walls.evidence import Evidence, Grid
from echolearn.walls.hypotheses import highest_peaks, hypotheses, uncrossed
from echolearn.walls.nouns import Hypotheses
from heard_walks import heard, wandering

BOX = [
    (0.0, 6.0, -9.0, 9.0),
    (np.pi / 2, 5.0, -9.0, 9.0),
    (-np.pi, 0.0, -9.0, 9.0),
    (-np.pi / 2, 0.0, -9.0, 9.0),
]
"""Walls of a room of 6 x 5 m."""


def line(theta, rho):
    """Return a single hypothesis."""
    return Hypotheses(np.array([theta]), np.array([rho]), np.ones(1))


def off(found, theta, rho):
    """Return how far each hypothesis is from a line: in rad and in m."""
    turn = np.abs((found.theta - theta + np.pi) % (2 * np.pi) - np.pi)
    return turn, np.abs(found.rho - rho)


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_the_walls_of_a_room_come_first(error):
    poses = wandering(70, low=(1.2, 1.2), high=(4.8, 3.8))
    rng = np.random.default_rng(5)
    told = poses + rng.standard_normal(poses.shape) * (error, error, error / 2)
    found = hypotheses(heard(BOX, poses, amplitude=1.5, told=told))
    first = found.part(np.arange(4))
    for theta, rho, _, _ in BOX:
        turn, away = off(first, theta, rho)
        assert ((turn <= np.deg2rad(2.0)) & (away <= 0.05)).sum() == 1
    assert (np.diff(found.strength) <= 0).all() and len(found) <= 20
    # The fifth is noise, of which the unit is made.
    assert first.strength[3] > 1.5 * found.strength[4]


def test_a_line_that_the_path_crosses_where_it_is_heard_is_dropped():
    places = np.linspace([0.0, 0.0], [0.0, 4.0], 41)
    poses = np.column_stack([places, np.zeros(41)])
    walk = heard([(np.pi / 2, 2.0, -9.0, 9.0)], poses, amplitude=5.0)
    assert len(uncrossed(walk, line(np.pi / 2, 2.005))) == 0
    assert len(uncrossed(walk, line(np.pi / 2, 5.5))) == 1


def test_the_line_of_a_wall_may_be_crossed_beyond_its_end():
    """As in a room that is an L: the wall ends at x = 2, the robot passes it at x = 4."""
    along = np.column_stack([np.linspace(0.0, 4.0, 41), np.full(41, 0.6)])
    across = np.column_stack([np.full(31, 4.0), np.linspace(0.7, 3.7, 31)])
    poses = np.column_stack([np.vstack([along, across]), np.zeros(72)])
    # Its tangent points to -x.
    walk = heard([(np.pi / 2, 2.0, -2.0, 9.0)], poses, amplitude=5.0)
    assert len(uncrossed(walk, line(np.pi / 2, 2.0))) == 1


def test_each_map_counts_in_units_of_its_own_noise():
    """A map a thousand times as high says nothing more; what stands out in either comes first."""
    grid = Grid(120, -2.0, 0.02, 200, (0.0, 0.0))
    rng = np.random.default_rng(1)
    first, second = rng.uniform(0.5, 1.0, (2, 120, 200))
    first[30, 50] = 3.0
    second[90, 120] = 2.0
    maps = [Evidence(grid, each, np.full((120, 200), 9)) for each in (first, 1000.0 * second)]
    found = highest_peaks(maps, count=5)
    assert found.theta[:2] == pytest.approx(grid.theta[[30, 90]])
    assert found.rho[:2] == pytest.approx(grid.rho[[50, 120]])
    assert found.strength[:2] == pytest.approx([3.0, 2.0], rel=0.1)


def test_lines_that_few_poses_have_in_their_window_are_none():
    grid = Grid(120, -2.0, 0.02, 200, (0.0, 0.0))
    values = np.random.default_rng(1).uniform(0.5, 1.0, (120, 200))
    values[30, 50] = 9.0
    counts = np.full((120, 200), 9)
    counts[30, 50] = 3
    assert highest_peaks([Evidence(grid, values, counts)], count=1).strength[0] < 2.0


def test_silence_speaks_for_nothing():
    assert len(hypotheses(heard([], wandering(5), amplitude=0.0).__class__(**silence()))) == 0


def silence():
    """Return the fields of a walk on which nothing was recorded."""
    walk = heard([], wandering(5))
    names = ("poses", "window", "array", "sample_rate")
    return {name: vars(walk)[name] for name in names} | {"outputs": np.zeros_like(walk.outputs)}
