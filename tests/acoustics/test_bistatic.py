"""Echoes of walls beside an array whose loudspeaker stands anywhere, against mirrored sources."""

import doctest
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import reference
from echolearn.acoustics import bistatic
from echolearn.acoustics.geometry import SearchWindow, direction
from echolearn.acoustics.rooms import true_echoes
from echolearn.acoustics.types import MicArray, Pose, Room
from reference import RATE, RING

SIZE = (10.0, 8.0, 6.0)
ROOM = Room(SIZE, 0.6)
ANGLE = st.floats(-math.pi, math.pi)
PLACE = st.tuples(st.floats(1.2, 8.8), st.floats(1.2, 6.8), st.floats(1.2, 4.8)).map(np.array)
SEED = st.integers(0, 10**6)


def apart(seed, microphones=5):
    """Return microphones in a box of 0.3 m whose middle lies up to 0.6 m from the loudspeaker."""
    rng = np.random.default_rng(seed)
    return MicArray(rng.uniform(-0.35, 0.35, 3) + rng.uniform(-0.15, 0.15, (microphones, 3)))


def of_truth(place, heading, array):
    """Return times, azimuths and elevations of the mirror sources, by the room's coordinates."""
    microphones = reference.microphones(array.positions, place, heading)
    seen = np.array(reference.images(SIZE, place))
    toward = seen - microphones.mean(axis=0)
    azimuth = np.arctan2(toward[:, 1], toward[:, 0]) - heading
    elevation = np.arctan2(np.hypot(toward[:, 0], toward[:, 1]), toward[:, 2])
    return np.linalg.norm(seen - microphones[0], axis=1) / 343.0, azimuth, elevation


@given(PLACE, ANGLE, SEED)
def test_true_echoes_are_those_of_mirrored_sources_seen_from_the_centre(place, heading, seed):
    array = apart(seed)
    toa, azimuth, elevation = of_truth(place, heading, array)
    truth = true_echoes(ROOM, Pose(place, heading), array=array)
    assert np.allclose(truth.toa, toa, rtol=1e-12)
    assert np.allclose(reference.turn(truth.azimuth - azimuth), 0.0, atol=1e-9)
    assert np.allclose(truth.elevation, elevation, atol=1e-9)


@given(PLACE, ANGLE, SEED)
def test_distances_and_map_points_of_mirrored_sources_are_those_of_the_walls(place, heading, seed):
    array = apart(seed)
    toa, azimuth, elevation = of_truth(place, heading, array)
    x, y, z = place
    away = bistatic.wall_distance(toa, direction(azimuth, elevation), array=array)
    assert np.allclose(away, [x, 10 - x, y, 8 - y, z, 6 - z], atol=1e-9)
    points = bistatic.wall_points(
        toa, azimuth, elevation, position=place, heading=heading, array=array
    )
    assert np.allclose(points, [[0, y], [10, y], [x, 0], [x, 8], [x, y], [x, y]], atol=1e-9)


@given(st.floats(0.8, 9.0), ANGLE, st.floats(0.3, 2.8), SEED)
def test_walls_and_echoes_are_each_others_inverse(distance, azimuth, elevation, seed):
    array = apart(seed)
    normal = direction(azimuth, elevation)
    toward = bistatic.echo_direction(distance, normal, array=array)
    toa = bistatic.echo_path(distance, normal, array=array) / 343.0
    assert np.linalg.norm(toward) == pytest.approx(1.0)
    assert bistatic.wall_distance(toa, toward, array=array) == pytest.approx(distance, abs=1e-9)


def mirrored(distance, azimuth, array):
    """Return path and azimuth of the echo of a wall, of its mirrored loudspeaker's coordinates."""
    image = np.array([2 * distance * math.cos(azimuth), 2 * distance * math.sin(azimuth), 0.0])
    x, y, _ = image - array.positions.mean(axis=0)
    return np.array([math.dist(image, array.positions[0]), math.atan2(y, x)])


@given(st.floats(0.8, 5.0), ANGLE, SEED)
def test_slopes_are_those_of_finite_differences_of_mirrored_sources(distance, azimuth, seed):
    array = apart(seed)
    found = bistatic.echo_slopes(np.array(distance), np.array(azimuth), array=array)
    step = 1e-5
    for column, move in enumerate(([step, 0.0], [0.0, step])):
        change = mirrored(distance + move[0], azimuth + move[1], array)
        change -= mirrored(distance - move[0], azimuth - move[1], array)
        change[1] = reference.turn(change[1])
        assert np.allclose(found[:, column], change / (2 * step), atol=1e-8)


@given(st.floats(1.0, 2.0), ANGLE, SEED)
def test_the_general_window_holds_every_wall_in_range_whatever_the_array(distance, azimuth, seed):
    """Not a lag more: walls straight behind and before microphone 1 come within one of its ends."""
    array = apart(seed)
    first, last = SearchWindow().lags(array, RATE)
    normal = direction(azimuth, math.pi / 2)
    assert first <= bistatic.echo_path(distance, normal, array=array) * RATE / 343.0 <= last
    ahead = array.positions[0] / np.linalg.norm(array.positions[0])
    near = bistatic.echo_path(1.0, ahead, array=array) * RATE / 343.0
    far = bistatic.echo_path(2.0, -ahead, array=array) * RATE / 343.0
    assert first > near - 1
    assert last < far + 1


def test_a_wall_by_hand():
    """The loudspeaker 1 m from a wall ahead, microphones 0.6 m to its left: the sound comes from
    2 m ahead and 0.6 m to the right, past the wall's point 1 m ahead."""
    array = MicArray(np.array([[0.0, 0.6, 0.0], [0.1, 0.6, 0.0], [-0.1, 0.6, 0.0]]))
    ahead = np.array([1.0, 0.0, 0.0])
    toward = bistatic.echo_direction(1.0, ahead, array=array)
    assert np.allclose(toward, np.array([2.0, -0.6, 0.0]) / math.hypot(2.0, 0.6))
    path = bistatic.echo_path(1.0, ahead, array=array)
    assert path == pytest.approx(math.hypot(2.0, 0.6))
    # As if the loudspeaker were in the middle, the same echo is 8 cm and 17 degrees off.
    alone = MicArray(array.positions - array.centre)
    wrong = bistatic.wall_distance(path / 343.0, toward, array=alone) * toward
    assert np.linalg.norm(wrong - ahead) == pytest.approx(0.3, abs=0.01)


def test_a_ring_around_its_loudspeaker_has_it_as_its_centre():
    assert np.array_equal(RING.centre, np.zeros(3))
    assert RING.reach == RING.radius
    aside = MicArray(RING.positions + [0.3, 0.0, 0.1])
    assert np.allclose(aside.centre, [0.3, 0.0, 0.1])
    assert aside.reach == pytest.approx(0.2)


@given(st.floats(0.004, 0.02), ANGLE, st.floats(0.0, math.pi), ANGLE)
def test_around_the_loudspeaker_map_points_are_bit_by_bit_the_papers(toa, azimuth, tilt, heading):
    """D = (p . u + sqrt((p . u)^2 - |p|^2 + (c toa)^2)) / 2, and no digit beside it."""
    place = np.array([[3.7, 2.9]])
    toa, azimuth, tilt = np.array([[toa], [azimuth], [tilt]])
    along = direction(azimuth, tilt) @ RING.positions[0]
    square = along**2 - RING.positions[0] @ RING.positions[0] + (343.0 * toa) ** 2
    distance = (along + np.sqrt(np.maximum(square, 0.0))) / 2.0
    expected = place + distance[..., None] * direction(azimuth + heading, tilt)[..., :2]
    found = bistatic.wall_points(toa, azimuth, tilt, position=place, heading=heading, array=RING)
    assert np.array_equal(found, expected)


def test_what_the_page_says_of_a_lag_and_a_degree_is_so():
    page = Path(__file__).parents[2] / "docs" / "arrays.md"
    ran = doctest.testfile(str(page), module_relative=False)
    assert ran.attempted > 5 and ran.failed == 0
