"""Feet, reach, coverage and symmetric distance by hand."""

import numpy as np
import pytest

from echolearn.evaluation import coverage

CORNERS = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 6.0], [0.0, 6.0]])
POSES = np.array(
    [[4.0, 1.5], [6.5, 3.0], [4.0, 3.0], [1.2, 0.8]]
)  # south; east; none; west (south is nearer than 1 m)
FEET = np.array([[4.0, 0.0], [8.0, 3.0], [0.0, 0.8]])
ALL = np.full(3, True)


def test_samples_divide_every_wall():
    samples, lengths = coverage.wall_samples(CORNERS)
    assert lengths.sum() == pytest.approx(28.0)
    assert lengths.max() <= 0.05 + 1e-12
    assert len(samples) == 560
    np.testing.assert_allclose(samples[0], [0.025, 0.0])


def test_feet_of_walls_one_to_two_metres_away():
    foot, heard = coverage.feet(CORNERS, POSES)
    np.testing.assert_allclose(foot[heard], FEET, atol=1e-12)
    assert heard.sum(axis=1).tolist() == [1, 1, 0, 1]


def test_a_foot_beyond_the_end_of_a_wall_gives_no_echo():
    step = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [2.0, 3.0], [2.0, 6.0], [0.0, 6.0]])
    _, heard = coverage.feet(step, np.array([[0.5, 4.5]]))
    assert heard[0].tolist() == [False, False, False, True, True, False]


def test_attainable_is_a_share_of_poses():
    assert coverage.attainable(CORNERS, POSES) == 3 / 4
    assert np.isnan(coverage.attainable(CORNERS, np.empty((0, 2))))


def test_a_perfect_map_covers_everything():
    assert coverage.wall_coverage(CORNERS, FEET, kept=ALL, poses=POSES) == 1.0


def test_coverage_by_hand():
    # Each foot reaches 0.5 m of wall, ten pieces of 0.05 m; a point 0.2 m along the wall covers six of its ten.
    kept = np.array([True, True, False])
    assert coverage.wall_coverage(CORNERS, FEET, kept=kept, poses=POSES) == pytest.approx(2 / 3)
    moved = FEET + np.array([[0.2, 0.0], [0.0, 0.0], [0.0, 0.0]])
    assert coverage.wall_coverage(CORNERS, moved, kept=kept, poses=POSES) == pytest.approx(
        (0.6 + 1) / 3
    )


def test_points_in_the_room_cover_nothing():
    assert coverage.wall_coverage(CORNERS, FEET + 2.0, kept=ALL, poses=POSES) == 0.0


def test_nearest_neighbour_error_by_hand():
    # From the points: 0.3 and the nearest sample, 0.025 m along. From the wall: samples at +-0.025 ... 0.225 m.
    poses, points = POSES[:1], np.array([[4.0, 0.3]])
    along = np.array([0.025, 0.075, 0.125, 0.175, 0.225])
    forward, backward = np.hypot(0.3, 0.025), np.hypot(0.3, along).mean()
    found = coverage.nearest_neighbour_error(CORNERS, points, kept=ALL[:1], poses=poses)
    assert found == pytest.approx((forward + backward) / 2)


def test_both_directions_count():
    poses, both = POSES[:2], np.full(2, True)
    whole = coverage.nearest_neighbour_error(CORNERS, FEET[:2], kept=both, poses=poses)
    lost = coverage.nearest_neighbour_error(
        CORNERS, FEET[:2], kept=np.array([True, False]), poses=poses
    )
    spurious = coverage.nearest_neighbour_error(
        CORNERS, FEET[:2] * [[1, 1], [0, 1]], kept=both, poses=poses
    )
    assert whole < 0.1
    assert lost > 1.0 and spurious > 1.0


def test_nothing_kept_or_nothing_reachable():
    nothing = np.full(3, False)
    assert coverage.wall_coverage(CORNERS, FEET, kept=nothing, poses=POSES) == 0.0
    assert np.isnan(coverage.nearest_neighbour_error(CORNERS, FEET, kept=nothing, poses=POSES))
    assert np.isnan(coverage.wall_coverage(CORNERS, FEET, kept=ALL, poses=POSES[2:3]))
    assert np.isnan(coverage.nearest_neighbour_error(CORNERS, FEET, kept=ALL, poses=POSES[2:3]))
    assert np.isnan(coverage.wall_coverage(CORNERS, FEET, kept=ALL, poses=np.empty((0, 2))))
