"""Geometry of echoes against mirrors drawn by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echolearn.acoustics import bistatic, geometry, rooms, sides
from echolearn.acoustics.geometry import SearchWindow, circular_array, direction
from echolearn.acoustics.types import MicArray, Pose, Room
from reference import RATE, RING
from refusals import refused

ROOM = Room((10.0, 8.0, 6.0), 0.6)
HERE = np.array([1.0, 2.0, 3.0])
PLANE = math.pi / 2
ANGLE = st.floats(-math.pi, math.pi)
TILT = st.floats(0.0, math.pi)
PLACE = st.tuples(st.floats(0.3, 9.7), st.floats(0.3, 7.7), st.floats(0.3, 5.7)).map(np.array)


# ---------------------------------------------------------------- directions and delays


def test_a_ring_starts_at_its_offset_and_turns_anticlockwise():
    ring = circular_array(microphones=4, radius=0.5, offset=PLANE).positions
    assert np.allclose(ring, [[0, 0.5, 0], [-0.5, 0, 0], [0, -0.5, 0], [0.5, 0, 0]], atol=1e-15)


def test_directions_name_the_axes_ahead_left_and_up():
    found = direction(np.array([0.0, PLANE, 1.0]), np.array([PLANE, PLANE, 0.0]))
    assert np.allclose(found, np.eye(3), atol=1e-15)


@given(ANGLE, TILT)
def test_delays_are_those_of_a_source_far_away(azimuth, elevation):
    """Microphones anywhere, the source 100 km off: the sphere is a plane to 1 um, 3e-9 s."""
    array = MicArray(np.random.default_rng(0).uniform(-0.3, 0.3, (5, 3)))
    toward = direction(azimuth, elevation)
    late = (np.linalg.norm(1e5 * toward - array.positions, axis=1) - 1e5) / 343.0
    found = geometry.far_field_delays(array, toward, speed_of_sound=343.0)
    assert np.allclose(found, late, atol=4e-9)
    eta = geometry.relative_delays(array, np.tile(toward, (2, 1)), scale=1 / 343.0)
    assert np.allclose(eta, late - late[0], atol=8e-9)


def test_arrays_are_equal_by_their_positions_which_cannot_be_changed():
    assert circular_array() == RING != circular_array(radius=0.1)
    assert len({circular_array(), RING}) == 1
    with pytest.raises(ValueError, match="read-only"):
        RING.positions[0, 0] = 1.0


# ---------------------------------------------------------------- images and true echoes


def test_images_of_a_point_by_hand_but_for_walls_that_do_not_reflect():
    expected = [[-1, 2, 3], [19, 2, 3], [1, -2, 3], [1, 14, 3], [1, 2, -3], [1, 2, 9]]
    assert np.array_equal(rooms.first_order_images(ROOM, HERE), expected)
    planar = replace(ROOM, walls=(1.0, 0.5, 0.0, 1.0, 0.0, 0.0))
    assert np.array_equal(rooms.first_order_images(planar, HERE), np.array(expected)[[0, 1, 3]])


def test_true_echoes_by_hand():
    """The loudspeaker 1 m from x=0, 4 m from both y walls, 3 m from floor and ceiling; microphone 1
    looks along x."""
    truth = rooms.true_echoes(ROOM, Pose(np.array([1.0, 4.0, 3.0])), array=RING)
    side, above = math.hypot(8, 0.2), math.hypot(6, 0.2)
    assert np.allclose(truth.toa * 343.0, [2.2, 17.8, side, side, above, above])
    assert np.allclose(np.cos(truth.azimuth[:4]), [-1, 1, 0, 0], atol=1e-12)
    assert np.allclose(np.sin(truth.azimuth[:4]), [0, 0, -1, 1], atol=1e-12)
    assert np.allclose(truth.elevation, [PLANE] * 4 + [math.pi, 0.0])


def toa_of_wall(distance, azimuth):
    image = 2 * distance * direction(azimuth, PLANE)
    return float(np.linalg.norm(image - RING.positions[0])) / 343.0


@given(st.floats(1.0, 50.0), ANGLE)
def test_the_far_field_form_is_its_limit_and_the_authors_is_not(distance, azimuth):
    along = 0.2 * math.cos(azimuth)
    toa = toa_of_wall(distance, azimuth)
    exact = bistatic.wall_distance(np.array(toa), direction(azimuth, PLANE), array=RING)
    assert exact == pytest.approx(distance)
    assert abs((343.0 * toa + along) / 2 - exact) < 0.0051 / distance
    assert abs(343.0 * toa / 2 + along - exact) > abs(along) / 2 - 0.0051
    impossible = bistatic.wall_distance(np.zeros(1), direction(azimuth, PLANE), array=RING)
    assert np.isfinite(impossible).all()


def test_the_outline_runs_anticlockwise_and_distances_to_it_are_those_by_hand():
    walls = rooms.outline(ROOM)
    x, y = walls[:, 0].T
    assert 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) == 80.0
    points = [[1, 4], [9.75, 4], [5, 7], [0, 3], [-3, -4], [12, 4], [5, 4]]
    found = sides.distance_to_outline(np.array(points), walls)
    assert np.allclose(found, [1, 0.25, 1, 0, 5, 2, 4])
    triangle = sides.closed(np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]]))
    assert sides.distance_to_outline(np.array([4.0, 3.0]), triangle) == pytest.approx(2.4)


# ---------------------------------------------------------------- search window


def test_windows_by_hand():
    """A ring of 0.25 m: 1.75 m and 4.25 m of path at 64.286 samples per metre, 112.5 and 273.2. The
    authors' window clips a far wall behind microphone 1."""
    assert SearchWindow().lags(circular_array(radius=0.25), RATE) == (112, 274)
    assert SearchWindow(rule="authors").lags(RING, RATE) == (116, 244)
    assert (2 * 2.0 + 0.2) * RATE / 343 > 244


# ---------------------------------------------------------------- rooms, and what is refused


def inside(x, y, z):
    rooms.check_inside(ROOM, Pose(np.array([x, y, z])), array=RING)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: circular_array(microphones=1), "array.microphones=1: must be a whole number from"),
        (lambda: circular_array(microphones=6.5), "array.microphones=6.5: must be a whole number"),
        (lambda: circular_array(radius="wide"), "array.radius=wide m: must be a number from 0.01"),
        (lambda: SearchWindow(nearest=2.0, farthest=1.0), "window.nearest=2.0 m: must be below"),
        (lambda: SearchWindow(rule="paper"), "window.rule=paper: must be general or authors"),
        (lambda: SearchWindow(nearest=0.1).lags(RING, RATE), "window.nearest=0.1 m: must be more"),
        (lambda: MicArray(np.zeros((6, 2))), "array.positions=shape (6, 2): must be many x 3"),
        (lambda: MicArray(np.full((6, 3), np.nan)), "array.positions=NaN"),
        (lambda: MicArray("ring"), "array.positions=words: must be many x 3 finite numbers"),
        (lambda: Pose(np.zeros(2)), "pose.position=shape (2,): must be three finite coordinates"),
        (
            lambda: Pose([1.0, [2.0], 3.0]),
            "pose.position=rows of several lengths, or no numbers: must be three",
        ),
        (lambda: Pose(np.array([0, np.nan, 0])), "pose.position=NaN or infinity: must be three"),
        (lambda: Pose(HERE, math.nan), "pose.heading=nan rad: must be a number that is finite"),
        (lambda: inside(0.1, 4, 3), "pose.position=(0.1, 4, 3) m: the array of radius 0.2 m must"),
        (lambda: Room((10.0, 8.0, 6.0), 0.2), "room.t60=0.2 s: must be over 0.206 s, Sabine's"),
        (lambda: Room((10.0, 8.0), 0.6), "room.size=[10.0, 8.0]: must be three lengths in m"),
        (lambda: Room((10.0, 8.0, 6.0), 0.6, (1.0,) * 5 + (1.5,)), "room.walls=1.5"),
    ],
)
def test_bad_values_are_refused_in_one_line(make, message):
    with refused(message):
        make()


def test_sabine_by_hand():
    """10 x 8 x 6 m: V = 480, S = 376; a = 55.262 V / (c S T60) = 0.34281, reflection sqrt(1 - a) =
    0.81067. The paper's short reverberation is possible in its study room only."""
    assert ROOM.sabine_absorption() == pytest.approx(0.34281, abs=2e-5)
    factors = (1, 1, 0.5, 1, 1, 0)
    found = replace(ROOM, walls=factors).reflection()
    assert np.allclose(found, np.array(factors) * 0.81067, atol=2e-5)
    assert 0.9 < Room((10.0, 8.0, 5.0), 0.2).sabine_absorption() < 1.0
