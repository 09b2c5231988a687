"""Right and wrong wall hypotheses, by hand."""

import numpy as np
import pytest

from echolearn.acoustics.polygon_room import PolygonRoom
from echolearn.acoustics.rooms import outline
from echolearn.acoustics.types import Room
from echolearn.evaluation.wall_matching import alignment, carried, match_walls, wall_lines

BOX = np.array([[-np.pi / 2, 0.0], [0.0, 8.0], [np.pi / 2, 6.0], [np.pi, 0.0]])
"""Walls of a room of 8 x 6 m: below, to the right, above, to the left."""

MIDDLE = np.array([4.0, 3.0])


def close(found, expected):
    turn = np.exp(1j * np.asarray(found)[:, 0]) - np.exp(1j * np.asarray(expected)[:, 0])
    return np.allclose(turn, 0) and np.allclose(np.asarray(found)[:, 1], np.array(expected)[:, 1])


def test_the_walls_of_a_box_face_the_robot():
    assert close(wall_lines(outline(Room((8.0, 6.0, 5.0), 0.6))), BOX)


def test_both_hands_of_a_door_are_one_wall_and_a_pillar_has_four():
    corners = ((0.0, 0.0), (8.0, 0.0), (8.0, 6.0), (0.0, 6.0))
    pillar = ((3.0, 3.0), (3.5, 3.0), (3.5, 3.5), (3.0, 3.5))
    room = PolygonRoom(corners, 3.0, 0.6, pillars=(pillar,), doors=((0, 2.0, 2.9),))
    lines = wall_lines(outline(room))
    assert close(lines[:4], BOX)
    # Its left side, at x = 3, is seen from the left: its normal points to the right.
    assert len(lines) == 8
    assert any(close([line], [[0.0, 3.0]]) for line in lines[4:])


def test_a_frame_is_found_from_places_and_carries_walls_along():
    rng = np.random.default_rng(0)
    true = rng.uniform(0.0, 6.0, (50, 2))
    angle, shift = 2.0, np.array([3.0, -1.0])
    cos, sin = np.cos(angle), np.sin(angle)
    told = true @ np.array([[cos, sin], [-sin, cos]]) + shift
    found = alignment(true, told)
    assert found[0] == pytest.approx(angle) and found[1] == pytest.approx(shift)
    # A place on a wall stays on it.
    lines = carried(BOX, angle=angle, shift=shift)
    corner = np.array([cos * 8.0 - sin * 6.0, sin * 8.0 + cos * 6.0]) + shift
    for theta, rho in lines[1:3]:
        assert np.cos(theta) * corner[0] + np.sin(theta) * corner[1] == pytest.approx(rho)


@pytest.mark.parametrize(
    ("line", "wall"),
    [
        ([0.0, 8.04], 1),
        ([0.0, 8.06], -1),
        ([np.deg2rad(1.9), 8.0 + 3.0 * np.sin(np.deg2rad(1.9))], 1),
        ([np.deg2rad(2.1), 8.0 + 3.0 * np.sin(np.deg2rad(2.1))], -1),
        ([np.pi, -8.0], -1),  # the same line from its other side
        ([-np.pi, 0.01], 3),  # an angle is the same a whole turn on
    ],
)
def test_a_hypothesis_is_right_within_2_degrees_and_5_cm(line, wall):
    assert match_walls(BOX, np.array([line]), middle=MIDDLE).tolist() == [wall]


def test_a_second_one_on_the_same_wall_is_wrong():
    twice = np.array([[0.0, 8.03], [0.0, 8.01], [np.pi / 2, 6.0]])
    assert match_walls(BOX, twice, middle=MIDDLE).tolist() == [-1, 1, 2]


def test_where_there_is_nothing_nothing_is_right():
    none = np.empty((0, 2))
    assert match_walls(BOX, none, middle=MIDDLE).tolist() == []
    assert match_walls(none, BOX, middle=MIDDLE).tolist() == [-1] * 4
