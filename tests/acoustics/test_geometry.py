"""Geometry of echoes against mirrors drawn by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import reference
from echolearn.acoustics import geometry
from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.types import MicArray, Pose, Room
from echolearn.bench import equations
from echolearn.checks import BadValue

RING = circular_array()
ROOM = Room((10.0, 8.0, 6.0), 0.6)
ANGLE = st.floats(-math.pi, math.pi)
TILT = st.floats(0.0, math.pi)
PLACE = st.tuples(st.floats(0.3, 9.7), st.floats(0.3, 7.7), st.floats(0.3, 5.7)).map(np.array)


# ---------------------------------------------------------------- directions and delays


def test_a_ring_starts_at_its_offset_and_turns_anticlockwise() -> None:
    ring = circular_array(microphones=4, radius=0.5, offset=math.pi / 2).positions
    assert np.allclose(ring, [[0, 0.5, 0], [-0.5, 0, 0], [0, -0.5, 0], [0.5, 0, 0]], atol=1e-15)


def test_directions_name_the_axes_ahead_left_and_up() -> None:
    found = geometry.direction(
        np.array([0.0, math.pi / 2, 1.0]), np.array([math.pi / 2, math.pi / 2, 0.0])
    )
    assert np.allclose(found, np.eye(3), atol=1e-15)


@given(ANGLE, TILT)
def test_delays_are_the_closed_form_of_the_ring(azimuth: float, elevation: float) -> None:
    expected = equations.delays(RING.positions, azimuth, elevation)
    assert np.allclose(
        geometry.far_field_delays(RING, geometry.direction(azimuth, elevation), speed_of_sound=343.0), expected, atol=1e-15
    )
    relative = geometry.relative_delays(RING, geometry.direction(azimuth, elevation), speed_of_sound=343.0)
    assert relative[0] == 0.0
    assert np.allclose(relative, expected - expected[0], atol=1e-15)


@given(ANGLE, TILT)
def test_delays_are_those_of_a_source_far_away(azimuth: float, elevation: float) -> None:
    """Microphones anywhere, the source 100 km off: the sphere is a plane to 1 um, 3e-9 s."""
    array = MicArray(np.random.default_rng(0).uniform(-0.3, 0.3, (5, 3)))
    source = 1e5 * geometry.direction(azimuth, elevation)
    late = (np.linalg.norm(source - array.positions, axis=1) - 1e5) / 343.0
    assert np.allclose(geometry.far_field_delays(array, azimuth, elevation, 343.0), late, atol=4e-9)


def test_an_echo_from_ahead_reaches_the_front_first() -> None:
    delays = geometry.far_field_delays(RING, 0.0, math.pi / 2, 343.0)
    assert delays[0] == pytest.approx(-0.2 / 343.0)
    assert delays.argmin() == 0
    assert delays.argmax() == 3


def test_delays_broadcast_over_directions() -> None:
    delays = geometry.far_field_delays(RING, np.zeros((2, 1)), np.linspace(0.1, 1.5, 3), 343.0)
    assert delays.shape == (2, 3, 6)


# ---------------------------------------------------------------- images and true echoes


def test_images_of_a_point_by_hand() -> None:
    expected = [[-1, 2, 3], [19, 2, 3], [1, -2, 3], [1, 14, 3], [1, 2, -3], [1, 2, 9]]
    assert np.array_equal(geometry.first_order_images(ROOM, np.array([1.0, 2.0, 3.0])), expected)


def test_walls_that_do_not_reflect_have_no_image() -> None:
    planar = replace(ROOM, walls=(1.0, 0.5, 0.0, 1.0, 0.0, 0.0))
    images = geometry.first_order_images(planar, np.array([1.0, 2.0, 3.0]))
    assert np.array_equal(images, [[-1, 2, 3], [19, 2, 3], [1, 14, 3]])


def test_true_echoes_by_hand() -> None:
    """The loudspeaker 1 m from x=0, 4 m from both y walls, 3 m from floor and ceiling; microphone 1
    looks along x."""
    truth = geometry.true_echoes(ROOM, Pose(np.array([1.0, 4.0, 3.0])), RING)
    paths = [
        2.2,
        17.8,
        math.hypot(8, 0.2),
        math.hypot(8, 0.2),
        math.hypot(6, 0.2),
        math.hypot(6, 0.2),
    ]
    assert np.allclose(truth.toa * 343.0, paths)
    assert np.allclose(np.cos(truth.azimuth[:4]), [-1, 1, 0, 0], atol=1e-12)
    assert np.allclose(np.sin(truth.azimuth[:4]), [0, 0, -1, 1], atol=1e-12)
    assert np.allclose(truth.elevation, [math.pi / 2] * 4 + [math.pi, 0.0])


@given(PLACE, ANGLE)
def test_true_echoes_are_those_of_the_images(place: np.ndarray, heading: float) -> None:
    truth = geometry.true_echoes(ROOM, Pose(place, heading), RING)
    microphone = reference.microphones(RING.positions, place, heading)[0]
    paths = [np.linalg.norm(image - microphone) for image in reference.images(ROOM.size, place)]
    assert np.allclose(truth.toa * 343.0, paths, rtol=1e-12)


@given(PLACE, ANGLE, ANGLE)
def test_turning_the_robot_turns_the_azimuths_back_and_leaves_the_map(
    place: np.ndarray, heading: float, turn: float
) -> None:
    before = geometry.true_echoes(ROOM, Pose(place, heading), RING)
    after = geometry.true_echoes(ROOM, Pose(place, heading + turn), RING)
    moved = np.exp(1j * (before.azimuth - after.azimuth - turn))[:4]
    assert np.allclose(moved, 1.0, atol=1e-9)
    assert np.allclose(before.elevation, after.elevation)
    points = [
        geometry.wall_points(
            t.toa, t.azimuth, t.elevation, position=place, heading=angle, array=RING
        )
        for t, angle in ((before, heading), (after, heading + turn))
    ]
    assert np.allclose(*points, atol=1e-9)


# ---------------------------------------------------------------- map points


@given(PLACE, ANGLE, st.floats(0, 2 * math.pi))
def test_the_map_point_of_a_true_echo_is_the_foot_of_the_wall(
    place: np.ndarray, heading: float, offset: float
) -> None:
    """Exact, whatever the distance, the heading and the place of microphone 1: not a far-field
    approximation."""
    array = circular_array(offset=offset)
    truth = geometry.true_echoes(ROOM, Pose(place, heading), array)
    distances = geometry.wall_distance(truth.toa, truth.azimuth, truth.elevation, array)
    x, y, z = place
    assert np.allclose(distances, [x, 10 - x, y, 8 - y, z, 6 - z], atol=1e-9)
    points = geometry.wall_points(
        truth.toa, truth.azimuth, truth.elevation, position=place, heading=heading, array=array
    )
    assert np.allclose(points, [[0, y], [10, y], [x, 0], [x, 8], [x, y], [x, y]], atol=1e-9)


@given(st.floats(1.0, 50.0), ANGLE)
def test_the_far_field_form_is_its_limit_and_the_authors_is_not(
    distance: float, azimuth: float
) -> None:
    along = 0.2 * math.cos(azimuth)
    toa = (
        np.linalg.norm(2 * distance * geometry.direction(azimuth, math.pi / 2) - RING.positions[0])
        / 343.0
    )
    exact = geometry.wall_distance(toa, azimuth, math.pi / 2, RING)
    assert exact == pytest.approx(distance)
    assert abs((343.0 * toa + along) / 2 - exact) < 0.0051 / distance
    assert abs(343.0 * toa / 2 + along - exact) > abs(along) / 2 - 0.0051


def test_wall_distance_of_an_impossible_echo_is_finite() -> None:
    assert np.isfinite(
        geometry.wall_distance(np.zeros(8), np.linspace(-3, 3, 8), np.full(8, math.pi / 2), RING)
    ).all()


def test_the_outline_runs_anticlockwise() -> None:
    corners = geometry.outline(ROOM)
    x, y = corners.T
    assert 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) == 80.0


def test_distances_to_the_outline_by_hand() -> None:
    points = np.array(
        [[1.0, 4.0], [9.75, 4.0], [5.0, 7.0], [0.0, 3.0], [-3.0, -4.0], [12.0, 4.0], [5.0, 4.0]]
    )
    assert np.allclose(
        geometry.distance_to_outline(points, geometry.outline(ROOM)), [1, 0.25, 1, 0, 5, 2, 4]
    )


def test_the_outline_need_not_be_a_rectangle() -> None:
    corner = np.array([[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]])
    assert geometry.distance_to_outline(np.array([4.0, 3.0]), corner) == pytest.approx(2.4)


# ---------------------------------------------------------------- search window


def test_the_authors_window_is_116_to_244() -> None:
    assert SearchWindow(rule="authors").lags(RING, 22050.0) == (116, 244)


def test_the_general_window_by_hand() -> None:
    """A ring of 0.25 m: 1.75 m and 4.25 m of path at 64.286 samples per metre, 112.5 and 273.2."""
    assert SearchWindow().lags(circular_array(radius=0.25), 22050.0) == (112, 274)


@given(st.floats(1.0, 2.0), ANGLE)
def test_the_general_window_holds_every_wall_in_range(distance: float, azimuth: float) -> None:
    toa = (
        np.linalg.norm(2 * distance * geometry.direction(azimuth, math.pi / 2) - RING.positions[0])
        / 343.0
    )
    first, last = SearchWindow().lags(RING, 22050.0)
    assert first <= toa * 22050.0 <= last


def test_the_authors_window_clips_a_far_wall_behind_microphone_1() -> None:
    assert SearchWindow(rule="authors").lags(RING, 22050.0)[1] < (2 * 2.0 + 0.2) * 22050 / 343


# ---------------------------------------------------------------- what is refused


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: circular_array(microphones=1), "array.microphones=1"),
        (lambda: circular_array(microphones=6.5), "array.microphones=6.5"),
        (lambda: circular_array(radius=20.0), "array.radius=20.0 m"),
        (lambda: circular_array(radius="wide"), "array.radius=wide m"),
        (lambda: circular_array(offset=math.nan), "array.offset=nan rad"),
        (lambda: SearchWindow(nearest=2.0, farthest=1.0), "window.nearest=2.0 m"),
        (lambda: SearchWindow(nearest=-1.0), "window.nearest=-1.0 m"),
        (lambda: SearchWindow(rule="paper"), "window.rule=paper"),
        (lambda: SearchWindow(nearest=0.1).lags(RING, 22050.0), "window.nearest=0.1 m"),
        (lambda: MicArray(np.zeros((6, 2))), "array.positions=(6, 2)"),
        (lambda: MicArray(np.full((6, 3), np.nan)), "array.positions=NaN"),
        (lambda: MicArray("ring"), "array.positions=dtype <U4: shape (M, 3)"),
        (lambda: Pose(np.zeros(2)), "pose.position=shape (2,): three finite coordinates in m"),
        (lambda: Pose([1.0, [2.0], 3.0]), "pose.position=dtype object: three"),
        (lambda: Pose(np.array([0, np.nan, 0])), "pose.position=NaN or infinity: three"),
        (lambda: Pose(np.zeros(3), math.nan), "pose.heading=nan rad: a finite number in rad"),
        (lambda: Pose(np.zeros(3), None), "pose.heading=None rad"),
        (
            lambda: geometry.check_inside(ROOM, RING, Pose(np.array([0.1, 4.0, 3.0]))),
            "pose.position=(0.1, 4, 3) m",
        ),
        (
            lambda: geometry.check_inside(ROOM, RING, Pose(np.array([5.0, 4.0, 6.0]))),
            "pose.position=(5, 4, 6) m",
        ),
        (lambda: Room((10.0, 8.0, 6.0), 0.2), "room.t60=0.2 s"),
        (lambda: Room((10.0, 8.0, 7.0), 0.2), "room.t60=0.2 s"),
        (lambda: Room((13.0, 11.0, 5.0), 0.2), "room.t60=0.2 s"),
        (lambda: Room((10.0, 8.0), 0.6), "room.size=[10.0, 8.0]"),
        (lambda: Room((10.0, 8.0, 6.0), 0.6, (1.0,) * 5 + (1.5,)), "room.walls=1.5"),
    ],
)
def test_bad_values_are_refused_in_one_line(make: object, name: str) -> None:
    with pytest.raises(BadValue) as refused:
        make()
    assert str(refused.value).startswith(name)
    assert "\n" not in str(refused.value)


def test_the_papers_short_reverberation_is_possible_in_its_study_room_only() -> None:
    assert 0.9 < Room((10.0, 8.0, 5.0), 0.2).sabine_absorption() < 1.0


@given(PLACE, ANGLE)
def test_a_place_is_inside_when_every_microphone_is(place: np.ndarray, heading: float) -> None:
    """All places drawn here keep 0.3 m from the walls, more than the ring's 0.2 m."""
    geometry.check_inside(ROOM, RING, Pose(place, heading))


def test_sabine_by_hand() -> None:
    """10 x 8 x 6 m: V = 480, S = 376; a = 55.262 V / (c S T60) = 0.34281, reflection sqrt(1 - a) =
    0.81067."""
    assert ROOM.sabine_absorption() == pytest.approx(0.34281, abs=2e-5)
    assert np.allclose(
        replace(ROOM, walls=(1, 1, 0.5, 1, 1, 0)).reflection(),
        np.array([1, 1, 0.5, 1, 1, 0]) * 0.81067,
        atol=2e-5,
    )


def test_positions_of_an_array_cannot_be_changed() -> None:
    with pytest.raises(ValueError, match="read-only"):
        RING.positions[0, 0] = 1.0
