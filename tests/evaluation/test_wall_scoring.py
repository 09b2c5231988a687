"""Walls found, by hand: a room of 6 x 4 m and a walk along its long walls."""

import numpy as np
import pytest

from echolearn.evaluation.wall_scoring import (
    AUDIBLE,
    PIECE,
    BelievedLines,
    count_walk,
    evaluate_walks,
    found_shares,
    heard_walls,
)

CORNERS = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 4.0], [0.0, 4.0]])
SIDES = np.stack([CORNERS, np.roll(CORNERS, -1, axis=0)], axis=1)
POSES = np.stack([np.linspace(2.2, 3.8, 33), np.full(33, 1.5)], axis=1)
"""33 poses, 1.5 m from the lower wall; the upper one is 2.5 m away, the ends 2.2 m."""


def heard(*, angle=0.0, shift=(0.0, 0.0), farthest=2.0):
    cos, sin = np.cos(angle), np.sin(angle)
    told = POSES @ np.array([[cos, sin], [-sin, cos]]) + shift
    return heard_walls(SIDES, poses=POSES, told=told, nearest=1.0, farthest=farthest)


def believe(*lines, told=None, ends=None):
    """Return lines (theta in degrees, rho); a stretch of the lower wall where nothing is said."""
    table = np.array(lines, dtype=float).reshape(-1, 2) * [np.pi / 180.0, 1.0]
    other = table if told is None else np.array(told, dtype=float) * [np.pi / 180.0, 1.0]
    given = [[2.2, 0.0], [3.8, 0.0]] if ends is None else ends
    stretches = np.tile(np.array(given, dtype=float), (len(table), 1, 1, 1))
    return BelievedLines(table, other, stretches, np.ones(len(table)))


def test_only_the_wall_within_the_window_can_be_found():
    walls = heard()
    assert walls.heard.tolist() == [33, 0, 0, 0] and AUDIBLE == 20
    # From 2.2 to 3.8 m, both pieces included.
    assert len(walls.pieces[0]) == pytest.approx(1.6 / PIECE + 1, abs=1)
    assert heard(farthest=2.6).heard.tolist() == [33, 9, 33, 9]


def test_a_right_line_a_second_one_a_wrong_one_and_an_inaudible_wall():
    # The lower wall faces down; the upper one is right, but nobody could hear it.
    count = count_walk(heard(), believe((-90, 0), (-90.5, 0.02), (45, 1), (90, 4)))
    assert (count.found, count.audible, count.right, count.believed) == (1, 1, 2, 4)
    assert count.offset_error.tolist() == pytest.approx([0.0, 0.0])
    assert count.overlap[0] == 1.0


def test_errors_are_those_of_the_fitted_line_at_the_middle_of_the_path():
    # By 1 degree about the middle of the path, 1.5 m above the wall: nearer by 1.5 (1 - cos 1).
    told = [(-89.0, 0.03 + np.cos(np.deg2rad(-89)) * 3 + np.sin(np.deg2rad(-89)) * 1.5 + 1.5)]
    ends = [[3.0, 0.0], [5.4, 0.0]]
    count = count_walk(heard(), believe((-90, 0), told=told, ends=ends))
    assert count.offset_error[0] == pytest.approx(0.03)
    assert np.rad2deg(count.angle_error[0]) == pytest.approx(1.0)
    # 0.8 m of the 3.2 m that are told or heard.
    assert count.overlap[0] == pytest.approx(0.25, abs=0.02)


def test_the_frame_of_the_odometry_is_no_error():
    turn, shift = np.deg2rad(30.0), np.array([1.0, -2.0])
    walls = heard(angle=turn, shift=shift)
    theta = -60.0
    normal = np.array([np.cos(np.deg2rad(theta)), np.sin(np.deg2rad(theta))])
    cos, sin = np.cos(turn), np.sin(turn)
    ends = np.array([[2.2, 0.0], [3.8, 0.0]]) @ np.array([[cos, sin], [-sin, cos]]) + shift
    count = count_walk(walls, believe((theta, normal @ shift), ends=ends))
    assert (count.found, count.right) == (1, 1)
    assert count.offset_error[0] == pytest.approx(0.0, abs=1e-9)
    assert count.overlap[0] > 0.9


def test_figures_are_of_all_walks_together_and_weights_count_them():
    walls = heard()
    counts = [
        count_walk(walls, believe((-90, 0), (45, 1))),
        count_walk(walls, believe((-90, 0.04))),
        count_walk(walls, believe()),
    ]
    every = evaluate_walks(counts)
    assert every["found"] == pytest.approx(2 / 3) and every["precision"] == pytest.approx(2 / 3)
    weighted = evaluate_walks(counts, np.array([[0.0, 2.0, 1.0], [0.0, 0.0, 3.0]]))
    assert weighted["found"] == pytest.approx([2 / 3, 0.0])
    assert weighted["precision"][0] == 1.0 and np.isnan(weighted["precision"][1])
    assert weighted["offset_error"][0] == pytest.approx(0.04)
    assert found_shares(counts[:1], counts[2:]).tolist() == [1.0]
