"""Rooms of any outline: what they are, what is refused, what their sides send back."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echolearn.acoustics import rooms, sides
from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.polygon_room import DOOR, PolygonRoom
from echolearn.acoustics.types import Pose, Room
from refusals import refused

SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0))
L = ((0.0, 0.0), (4.0, 0.0), (4.0, 2.0), (2.0, 2.0), (2.0, 4.0), (0.0, 4.0))
PILLAR = ((1.0, 1.0), (1.0, 1.5), (1.5, 1.5), (1.5, 1.0))
FURNISHED = PolygonRoom(L, 2.5, 0.6, pillars=(PILLAR,), doors=((0, 0.5, 1.5), (0, 3.0, 4.0)))


def test_size_and_sabine_by_hand():
    """The L has 12 m^2, its pillar takes 0.25; around them are 16 and 2 m of wall."""
    assert FURNISHED.area == pytest.approx(11.75)
    assert FURNISHED.volume == pytest.approx(29.375)
    assert FURNISHED.surface == pytest.approx(23.5 + 45.0)
    absorbed = 24 * math.log(10) * 29.375 / (343.0 * 68.5 * 0.6)
    assert np.allclose(FURNISHED.reflection(), [math.sqrt(1 - absorbed)] * 9)
    assert rooms.size_of(FURNISHED) == (4.0, 4.0, 2.5)
    assert FURNISHED.dimensions == "6-cornered 11.75 m^2 x 2.5 m"


@pytest.mark.parametrize("turn", [1, -1])
def test_faces_have_the_room_to_their_left(turn):
    """However corners are given; doors cut sides, and belong to no wall."""
    doors = ((0, 0.5, 1.5), (0, 3.0, 4.0)) if turn == 1 else ((4, 0.0, 1.0), (4, 2.5, 3.5))
    corners = L[::turn]
    room = PolygonRoom(corners, 2.5, 0.6, pillars=(PILLAR[::turn],), doors=doors)
    faces, walls = room.faces
    along = np.diff(faces, axis=1)[:, 0]
    left = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.linalg.norm(along, axis=1)[:, None]
    beside = faces.mean(axis=1) + 0.01 * left
    assert sides.encloses(faces, beside).all()
    assert not sides.encloses(faces, beside - 0.02 * left).any()
    assert (walls == DOOR).sum() == 2 and (walls == 8).sum() == 4 and len(walls) == 13
    lengths = np.linalg.norm(along, axis=1)
    assert lengths[walls == DOOR].tolist() == pytest.approx([1.0, 1.0])
    assert lengths[walls == (0 if turn == 1 else 4)].sum() == pytest.approx(2.0)
    assert np.linalg.norm(np.diff(rooms.outline(room), axis=1)) > 0
    assert len(rooms.outline(room)) == 11 and rooms.most_echoes(room) == 13


@given(
    st.tuples(st.floats(0.3, 7.7), st.floats(0.3, 5.7), st.floats(0.3, 4.7)).map(np.array),
    st.floats(-math.pi, math.pi),
)
def test_a_box_drawn_as_a_polygon_has_the_echoes_of_a_box(place, heading):
    factors = (1.0, 0.5, 0.0, 1.0, 0.9, 1.0)
    box = Room((8.0, 6.0, 5.0), 0.6, factors)
    drawn = PolygonRoom(
        ((0, 0), (8, 0), (8, 6), (0, 6)), 5.0, 0.6, tuple(factors[k] for k in (2, 1, 3, 0, 4, 5))
    )
    array = circular_array(microphones=2, radius=0.05)
    expected = rooms.true_echoes(box, Pose(place, heading), array=array)
    found = rooms.true_echoes(drawn, Pose(place, heading), array=array)
    # Of a box the walls are x = 0, x = max, y = max; on the way round x = max, y = max, x = 0.
    order = [1, 2, 0, 3, 4]
    assert np.allclose(found.toa, expected.toa[order])
    assert np.allclose(found.elevation, expected.elevation[order])
    assert np.allclose(np.exp(1j * found.azimuth), np.exp(1j * expected.azimuth[order]), atol=1e-6)
    assert rooms.most_echoes(box) == rooms.most_echoes(drawn) == 6


def test_echoes_are_those_that_nothing_hides():
    """In the upper leg of the L the pillar hides the wall at y = 0."""
    array = circular_array(microphones=2, radius=0.01)
    above = Pose(np.array([1.25, 3.0, 1.25]), 0.0)
    toward = rooms.true_echoes(FURNISHED, above, array=array)
    distances = np.sort(toward.toa[:-2] * 343.0 / 2)
    # The wall at x = 2, the one above, the one behind, the pillar's top; not the wall at y = 0.
    assert np.allclose(distances, [0.75, 1.0, 1.25, 1.5], atol=0.01)
    # In the other leg: before a door there is no wall, and the pillar hides the one at x = 0.
    beside = Pose(np.array([3.5, 1.2, 1.25]), 0.0)
    found = np.sort(rooms.true_echoes(FURNISHED, beside, array=array).toa[:-2] * 343.0 / 2)
    assert np.allclose(found, [0.5, 0.8, 2.0], atol=0.01)


def test_inside_is_off_walls_and_pillars():
    points = np.array([[3, 1, 1], [3, 3, 1], [1.2, 1.2, 1], [1, 3, 3], [-1, 1, 1], [1, 3, 1.0]])
    assert rooms.inside(FURNISHED, points).tolist() == [True, False, False, False, False, True]
    array = circular_array(radius=0.2)
    rooms.check_inside(FURNISHED, Pose(np.array([3.0, 1.0, 1.0])), array=array)
    with refused("pose.position=(1, 0.9, 1) m: the array of radius 0.2 m must be inside the 6-c"):
        rooms.check_inside(FURNISHED, Pose(np.array([1.0, 0.9, 1.0])), array=array)


def test_lines_are_joined_and_closed_where_they_meet():
    lines = sides.polylines(rooms.outline(FURNISHED))
    closed = [bool((line[0] == line[-1]).all()) for line in lines]
    # The wall up to the first door, the one between both, the rest of the outline, the pillar.
    assert [len(line) for line in lines] == [2, 2, 6, 5] and closed == [False, False, False, True]
    assert sides.polylines(np.empty((0, 2, 2))) == []


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"corners": SQUARE[:2]}, "room.corners=2 corners: must be 3 to 100 distinct corners"),
        ({"corners": (*SQUARE, SQUARE[0])}, "room.corners=1 corners twice: must be 3 to 100"),
        ({"corners": "round"}, "room.corners=words: must be many x 2 finite numbers in m"),
        ({"corners": ((0, 0), (4, 0), (0, 3), (4, 3))}, "room.corners=[[4.0, 0.0], [0.0, 3.0]] m"),
        ({"corners": ((0, 0), (4, 0), (8, 0.001))}, "room.corners=[4.0, 0.0] m: must be at least"),
        ({"corners": ((0, 0), (300, 0), (0, 300))}, "room.corners=300 m: must span at most 200 m"),
        ({"height": 0.1}, "room.height=0.1 m: must be a number from 0.5 to 200 m"),
        ({"t60": 0.05}, "room.t60=0.05 s: must be over 0.082 s, Sabine's formula, in a 4-cornered"),
        ({"walls": (1.0,) * 5}, "room.walls=[1.0, 1.0, 1.0, 1.0, 1.0]: must be none, or 6 factors"),
        ({"walls": (2.0,) * 6}, "room.walls=2.0: must be a number from 0 to 1"),
        ({"pillars": (L,)}, "room.corners and room.pillars=[0.0, 0.0] m: must be at least 0.01 m"),
        ({"pillars": (((5, 1), (6, 1), (6, 2)),)}, "room.pillars=[5.0, 1.0] m: must lie inside"),
        ({"pillars": (((3, 1), (6, 1), (6, 2)),)}, "room.corners and room.pillars=[[4.0, 0.0], ["),
        ({"pillars": 3}, "room.pillars=3: must be a list"),
        ({"doors": ((4, 0, 1),)}, "room.doors=4: must be a whole number from 0 to 3; which side?"),
        ({"doors": ((1, 1, 3.5),)}, "room.doors=3.5 m: must be a number from 1.01 to 3 m"),
        ({"doors": ((1, 0, 2), (1, 1, 3))}, "room.doors=1 m: must begin 0.01 m after the one"),
        ({"doors": (1, 0, 2)}, "room.doors=1: must be (side, from, to) each; are brackets"),
    ],
)
def test_what_is_no_room_is_refused_in_one_line(change, message):
    with refused(message):
        PolygonRoom(**{"corners": SQUARE, "height": 2.5, "t60": 0.6} | change)
