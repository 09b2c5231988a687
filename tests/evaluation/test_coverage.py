"""Feet, reach, coverage and symmetric distance by hand."""

import numpy as np
import pytest

from echolearn.acoustics.sides import closed
from echolearn.evaluation import coverage

WALLS = closed(np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]]))
# Near the south wall; the east wall; none; the west wall (the south is nearer than 1 m).
POSES = np.array([[4.0, 1.5], [6.5, 3.0], [4.0, 3.0], [1.2, 0.8]])
FEET = np.array([[4.0, 0.0], [8.0, 3.0], [0.0, 0.8]])


def covered(points, poses=POSES):
    return coverage.of_walls(WALLS, points, poses=poses)["wall_coverage"]


def distance(points, poses=POSES):
    return coverage.of_walls(WALLS, points, poses=poses)["nearest_neighbour_error"]


def test_samples_divide_every_wall():
    samples, lengths = coverage.wall_samples(WALLS)
    assert lengths.sum() == pytest.approx(28.0)
    assert lengths.max() <= 0.05 + 1e-12
    assert len(samples) == 560
    np.testing.assert_allclose(samples[0], [0.025, 0.0])


def test_feet_of_walls_one_to_two_metres_away():
    foot, echoes = coverage.feet(WALLS, POSES)
    np.testing.assert_allclose(foot[echoes], FEET, atol=1e-12)
    assert echoes.sum(axis=1).tolist() == [1, 1, 0, 1]


def test_a_foot_beyond_the_end_of_a_wall_gives_no_echo():
    step = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [2.0, 3.0], [2.0, 6.0], [0.0, 6.0]])
    _, echoes = coverage.feet(closed(step), np.array([[0.5, 4.5]]))
    assert echoes[0].tolist() == [False, False, False, True, True, False]


def test_attainable_is_a_share_of_poses():
    assert coverage.attainable(WALLS, POSES) == 3 / 4
    assert np.isnan(coverage.attainable(WALLS, np.empty((0, 2))))


def test_coverage_by_hand():
    """Each foot reaches 0.5 m of wall, ten pieces; a point 0.2 m aside covers six of its ten."""
    assert covered(FEET) == 1.0
    assert covered(FEET[:2]) == pytest.approx(2 / 3)
    aside = FEET + [[0.2, 0], [0, 0], [0, 0]]
    assert covered(aside[:2]) == pytest.approx((0.6 + 1) / 3)
    assert covered(FEET + 2.0) == 0.0
    assert covered(FEET[:0]) == 0.0


def test_nearest_neighbour_error_by_hand():
    """From the point 0.3 m, and 0.025 m along to the nearest sample; from the wall ten samples."""
    along = np.array([0.025, 0.075, 0.125, 0.175, 0.225])
    forward = np.hypot(0.3, 0.025)
    backward = np.hypot(0.3, along).mean()
    found = distance(np.array([[4.0, 0.3]]), POSES[:1])
    assert found == pytest.approx((forward + backward) / 2)


def test_both_directions_count():
    """A wall that is lost counts, and so does a point that is spurious."""
    assert distance(FEET[:2], POSES[:2]) < 0.1
    assert distance(FEET[:1], POSES[:2]) > 1.0
    assert distance(FEET[:2] * [[1, 1], [0, 1]], POSES[:2]) > 1.0


def test_what_is_undefined_is_nan():
    assert np.isnan(distance(FEET[:0]))
    for nowhere in (POSES[2:3], POSES[:0]):
        assert np.isnan(covered(FEET, nowhere))
        assert np.isnan(distance(FEET, nowhere))


def test_the_back_of_a_pillar_is_not_in_reach():
    """From 1.1 m before its front, which hides its back 1.5 m away; what is shown covers all."""
    pillar = closed(np.array([[3.0, 3.0], [3.0, 3.4], [3.4, 3.4], [3.4, 3.0]]))
    walls = np.concatenate([WALLS, pillar])
    place = np.array([[3.2, 1.9]])
    foot, echoes = coverage.feet(walls, place)
    assert np.flatnonzero(echoes[0]).tolist() == [0, 7]
    assert foot[0, 7].tolist() == pytest.approx([3.2, 3.0])
    shown = coverage.of_walls(walls, foot[echoes], poses=place)
    assert shown["wall_coverage"] == 1.0
