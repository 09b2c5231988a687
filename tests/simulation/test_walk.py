"""The walk's geometry: clearance, even steps, headings, and what of the room is in reach."""

import numpy as np
import pytest

from echolearn.acoustics.polygon_room import PolygonRoom
from echolearn.acoustics.rooms import inside, outline
from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.types import Room
from echolearn.evaluation.coverage import attainable, feet
from echolearn.simulation.walk import trajectory
from refusals import refused

SIZES = [(8.0, 6.0, 5.0), (13.0, 11.0, 5.0), (10.0, 8.0, 5.0), (5.0, 5.0, 3.0), (14.0, 5.0, 4.0)]
rooms = pytest.mark.parametrize("size", SIZES)
large = pytest.mark.parametrize("size", SIZES[:2])


def walk(size, **changes):
    """Return positions (P, 3), headings (P,), and distances from the four walls (P, 4)."""
    poses = trajectory(Room(size, 0.6), **changes)
    places = np.array([pose.position for pose in poses])
    margins = np.hstack([places, size - places])[:, [0, 3, 1, 4]]
    return places, np.array([pose.heading for pose in poses]), margins


@rooms
def test_the_walk_keeps_its_clearance_at_mid_height_and_repeats_none(size):
    """No distance from the nearest wall is that of many poses, as on a grid."""
    places, _, margins = walk(size)
    nearest = margins.min(axis=1)
    assert len(places) == 160
    assert nearest.min() >= 1.05 - 1e-9
    assert (places[:, 2] == size[2] / 2).all()
    in_reach = nearest[nearest <= 2]
    assert np.histogram(in_reach, bins=np.arange(1, 2.05, 0.1))[0].max() < 0.4 * len(in_reach)
    on_grid = np.abs(places[:, :2] * 2 - np.round(places[:, :2] * 2)) < 0.004
    assert not on_grid.all(axis=1).any()


@rooms
def test_steps_are_even_and_the_heading_is_the_tangent(size):
    places, heading, _ = walk(size, poses=2000)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    # Chords are a little shorter than arcs where the path bends.
    assert steps.max() <= steps.mean() * 1.02
    assert np.median(steps) == pytest.approx(steps.max(), rel=0.01)

    x, y, _ = (places[2:] - places[:-2]).T
    turned = np.exp(-1j * heading[1:-1]) * (x + 1j * y)
    assert (turned.real > 0).all()
    # The heading is that of the path, not of the chord; they part where a narrow room's path bends.
    assert np.median(np.abs(turned.imag / turned.real)) < 1e-3
    assert np.abs(turned.imag / turned.real).max() < 0.15


@pytest.mark.parametrize("start", [0.0, 0.6, 2.0, 4.5])
@large
def test_a_wall_is_in_reach_from_most_poses_but_not_all(size, start):
    places, _, _ = walk(size, start=start)
    share = attainable(outline(Room(size, 0.6)), places[:, :2])
    assert 0.55 <= share <= 0.8


@large
def test_every_wall_and_the_middle_are_visited(size):
    places, _, margins = walk(size)
    assert (((margins >= 1) & (margins <= 2)).sum(axis=0) >= 12).all()
    assert (margins.min(axis=1) > 2.2).sum() >= 15
    assert np.linalg.norm((places - np.array(size) / 2)[:, :2], axis=1).min() < 1.0


def test_another_start_gives_another_walk_and_the_same_one_the_same():
    first, again, other = (walk(SIZES[0], start=start)[0] for start in (0.6, 0.6, 2.0))
    assert (first == again).all()
    assert np.linalg.norm(first[:, None] - other, axis=-1).min() > 1e-6


@pytest.mark.parametrize(
    ("size", "changes", "message"),
    [
        (SIZES[0], {"poses": 1}, "poses=1: "),
        (SIZES[0], {"start": "west"}, "start=west rad: "),
        (
            (8.0, 3.09, 2.5),
            {},
            "room.size=8 x 3.09 x 2.5 m: must have two sides of at least 3.1 m, "
            "for a walk 1.05 to 1.45 m from the walls",
        ),
    ],
)
def test_impossible_walks_are_refused(size, changes, message):
    with refused(message):
        walk(size, **changes)


def test_the_smallest_room_holds_the_walk():
    assert len(trajectory(Room((3.1, 8.0, 2.5), 0.4))) == 160


L = ((0.0, 0.0), (7.0, 0.0), (7.0, 3.2), (4.0, 3.2), (4.0, 7.0), (0.0, 7.0))
PILLAR = ((4.0, 3.0), (4.4, 3.0), (4.4, 3.4), (4.0, 3.4))
WIDE = ((0.0, 0.0), (9.0, 0.0), (9.0, 7.0), (0.0, 7.0))


@pytest.mark.parametrize("start", [0.6, 3.0])
@pytest.mark.parametrize(
    "room",
    [
        PolygonRoom(L, 2.6, 0.6),
        PolygonRoom(L[::-1], 2.6, 0.6, doors=((0, 1.0, 1.9),)),
        PolygonRoom(WIDE, 3.0, 0.6, pillars=(PILLAR,)),
        PolygonRoom(((0.0, 0.0), (6.0, 0.5), (7.0, 4.0), (3.0, 6.0), (-0.5, 3.5)), 3.0, 0.6),
    ],
    ids=["L", "clockwise, with a door", "pillar", "five corners"],
)
def test_in_any_room_the_walk_keeps_off_all_walls_and_passes_each(room, start):
    """No two poses are far apart, and from most a wall sends an echo back within the window."""
    poses = trajectory(room, poses=150, start=start)
    places = np.array([pose.position for pose in poses])
    assert inside(room, places).all() and (places[:, 2] == room.height / 2).all()
    away = distance_to_outline(places[:, :2], room.faces[0])
    assert away.min() > 1.02 and away.max() > 1.4
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).max() < 0.6
    assert attainable(outline(room), places[:, :2]) > 0.8
    _, echoes = feet(outline(room)[: len(room.corners)], places[:, :2])
    assert (echoes.sum(axis=0) > 3).all()
    other = trajectory(room, poses=150, start=start + 1.0)
    assert not np.allclose(other[0].position, poses[0].position, atol=0.1)


def test_a_room_without_a_place_off_all_walls_is_refused():
    corridor = PolygonRoom(((0.0, 0.0), (9.0, 0.0), (9.0, 2.0), (0.0, 2.0)), 2.6, 0.6)
    with refused("room.corners=0.99 m: must leave a place at least 1.25 m from all walls, for a"):
        trajectory(corridor)
