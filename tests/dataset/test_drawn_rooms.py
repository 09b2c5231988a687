"""Plans that draw rooms of several outlines: what they draw, and that boxes alone are as before."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.path import Path as Outline

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.polygon_room import PolygonRoom
from echolearn.acoustics.rooms import true_echoes
from echolearn.acoustics.types import Pose, Room
from echolearn.dataset.drawn_rooms import ECHOES, ROOMY, drawn_place, drawn_room
from echolearn.dataset.plans import ScatteredPlan
from echolearn.dataset.records import records
from echolearn.localization.methods.gated import Gated
from echolearn.simulation.rir.images import Images
from echolearn.storage.identity import plain
from refusals import refused

WINDOW = SearchWindow()
SIZE = np.array([5.0, 6.5, 3.2])


@pytest.fixture(scope="module")
def plan(brief):
    """Return loud rows in boxes."""
    return ScatteredPlan(
        "rooms",
        4,
        12,
        (5.0, 5.0, 3.0),
        (8.0, 7.0, 4.0),
        (0.2, 0.3),
        1.0,
        WINDOW,
        replace(brief, rir=Images()),
        Gated(WINDOW, 36),
        (0.7, 1.0),
        (30.0, 40.0),
    )


def way(place, start, end):
    """Return the distance from a place to a wall, looked for along it."""
    along = np.linspace(0.0, 1.0, 4001)[:, None]
    return float(np.linalg.norm(start + along * (end - start) - place, axis=1).min())


@given(seed=st.integers(0, 10**6), outline=st.sampled_from(sorted(ECHOES)))
def test_a_place_is_in_the_room_and_off_every_wall(seed, outline):
    """With the widest margin that a plan may have, by another package's polygons."""
    rng = np.random.default_rng(seed)
    room = drawn_room(outline, SIZE, t60=0.4, wall_factor=(0.7, 1.0), rng=rng)
    margin = ROOMY * 5.0
    place = drawn_place(room, margin, rng=rng)
    assert margin <= place[2] <= SIZE[2] - margin
    if isinstance(room, Room):
        assert np.array_equal(room.size, SIZE) and outline == "box"
        corners = SIZE[:2] * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    else:
        corners = np.array(room.corners)
        assert len(corners) + 2 == len(room.walls) == ECHOES[outline]
        assert min(room.walls) >= 0.7 and max(room.walls) <= 1.0
        assert (corners >= -1e-9).all() and (corners <= SIZE[:2] + 1e-9).all()
    assert Outline(corners).contains_point(place[:2])
    after = np.roll(corners, -1, axis=0)
    away = [way(place[:2], *side) for side in zip(corners, after, strict=True)]
    assert min(away) >= margin - 1e-9


@given(seed=st.integers(0, 10**6))
def test_of_five_corners_no_two_walls_are_parallel(seed):
    rng = np.random.default_rng(seed)
    room = drawn_room("five_corners", SIZE, t60=0.4, wall_factor=(1.0, 1.0), rng=rng)
    assert isinstance(room, PolygonRoom)
    sides = np.roll(room.corners, -1, axis=0) - np.array(room.corners)
    turn = np.arctan2(sides[:, 1], sides[:, 0])
    between = np.abs(np.sin(turn[:, None] - turn))[~np.eye(5, dtype=bool)]
    assert between.min() > 0.01


def test_every_l_lacks_one_corner_of_its_box_and_each_may_be_it():
    missing = set()
    for seed in range(40):
        rng = np.random.default_rng(seed)
        room = drawn_room("l_shape", SIZE, t60=0.4, wall_factor=(1.0, 1.0), rng=rng)
        assert isinstance(room, PolygonRoom)
        there = {tuple(corner) for corner in np.round(room.corners, 9).tolist()}
        [corner] = {(x, y) for x in (0.0, 5.0) for y in (0.0, 6.5)} - there
        missing.add(corner)
        assert 0.75 * 5.0 * 6.5 <= room.area <= 0.91 * 5.0 * 6.5
    assert len(missing) == 4


def test_boxes_alone_are_drawn_as_before(plan):
    """Number by number as the first version drew them, and with no trace in the identity."""
    for row in range(5):
        rng = np.random.default_rng(row)
        size = rng.uniform(plan.size_low, plan.size_high)
        t60 = rng.uniform(*plan.t60)
        walls = rng.uniform(*plan.wall_factor, 6)
        position = rng.uniform(plan.margin, size - plan.margin)
        heading = rng.uniform(-np.pi, np.pi)
        spot = plan.spot(row, np.random.default_rng(row))
        assert spot.room == Room(tuple(size), t60, tuple(walls))
        assert np.array_equal(spot.pose.position, position) and spot.pose.heading == heading
    assert "rooms" not in plain(plan)
    listed = replace(plan, rooms=["box"])
    assert plain(listed) == plain(plan) != plain(replace(plan, rooms=("l_shape",)))


def test_rows_of_all_outlines_stand_in_one_set_with_their_truth(plan):
    mixed = replace(plan, rooms=("box", "l_shape", "five_corners"))
    spots = [mixed.spot(row, np.random.default_rng(row)) for row in range(60)]
    corners = [len(getattr(spot.room, "corners", "four")) for spot in spots]
    assert {4, 5, 6} == set(corners) and min(map(corners.count, (4, 5, 6))) > 10

    table = records(mixed, range(len(mixed)))
    assert table["truth_toa"].shape == (len(mixed), 8)
    assert "time_and_direction" in (table.dtype.names or ())
    again = records(mixed, range(3, 5))
    for name in ("toa", "position", "room", "truth_toa"):
        assert np.array_equal(again[name], table[name][3:5], equal_nan=True), name
    right = 0
    for number, row in enumerate(table):
        true = table["truth_toa"][number]
        late = np.abs(true - row["toa"])
        assert row["reflector"] == bool(np.nanmin(late) * 22050 < 10)
        right += int(row["time_and_direction"])
    assert right > len(table) / 2


def test_the_truth_of_a_row_is_that_of_its_room(plan):
    from echolearn.acoustics.streams import stream

    drawn = replace(plan, rooms=("l_shape", "five_corners"))
    table = records(drawn, range(4))
    for number in range(4):
        spot = drawn.spot(number, stream(drawn.seed, "observation", number))
        there = Pose(table["position"][number], float(table["heading"][number]))
        known = true_echoes(spot.room, there, array=drawn.scene.array).toa
        assert np.array_equal(table["truth_toa"][number][: len(known)], known)
        assert np.isnan(table["truth_toa"][number][len(known) :]).all()


def test_what_is_no_outline_or_leaves_no_place_is_refused(plan):
    allowed = "must be some of box, l_shape, five_corners, each once"
    for rooms in ((), ("box", "box"), ("round",)):
        with refused(f"plan.rooms=[{', '.join(rooms)}]: {allowed}"):
            replace(plan, rooms=rooms)
    with refused("plan.rooms=l_shape: must be some of box, l_shape, five_corners; are brackets"):
        replace(plan, rooms="l_shape")
    with refused("plan.margin=1.4 m: must be a number from 0 to 1.25 m; of rooms box, l_shape"):
        replace(plan, rooms=("box", "l_shape"), margin=1.4)
