"""The walk's geometry: clearance, even steps, headings, and what of the room is in reach."""

import numpy as np
import pytest

from echolearn.acoustics.geometry import outline
from echolearn.acoustics.types import Room
from echolearn.checks import BadValue
from echolearn.evaluation.coverage import attainable
from echolearn.simulation.walk import trajectory

SIZES = [(8.0, 6.0, 5.0), (13.0, 11.0, 5.0), (10.0, 8.0, 5.0), (5.0, 5.0, 3.0), (14.0, 5.0, 4.0)]


def walk(size, **changes):
    poses = trajectory(Room(size, 0.6), **changes)
    return np.array([pose.position for pose in poses]), np.array([pose.heading for pose in poses])


@pytest.mark.parametrize("size", SIZES)
def test_the_walk_keeps_its_clearance_at_mid_height(size):
    places, _ = walk(size)
    assert len(places) >= 150
    margin = np.minimum(places, np.array(size) - places)[:, :2]
    assert margin.min() >= 1.05 - 1e-9
    assert (places[:, 2] == size[2] / 2).all()


@pytest.mark.parametrize("size", SIZES)
def test_steps_are_even(size):
    places, _ = walk(size, poses=400)
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    # Chords are a little shorter than arcs where the path bends.
    assert steps.max() <= steps.mean() * 1.02
    assert np.median(steps) == pytest.approx(steps.max(), rel=0.01)


@pytest.mark.parametrize("size", SIZES)
def test_heading_is_the_tangent(size):
    places, heading = walk(size, poses=2000)
    chord = places[2:, :2] - places[:-2, :2]
    across = np.cos(heading[1:-1]) * chord[:, 1] - np.sin(heading[1:-1]) * chord[:, 0]
    ahead = np.cos(heading[1:-1]) * chord[:, 0] + np.sin(heading[1:-1]) * chord[:, 1]
    assert (ahead > 0).all()
    # The heading is that of the path, not of the chord; they part where a narrow room's path bends.
    assert np.median(np.abs(across / ahead)) < 1e-3
    assert np.abs(across / ahead).max() < 0.15


@pytest.mark.parametrize("start", [0.0, 0.6, 2.0, 4.5])
@pytest.mark.parametrize("size", SIZES[:2])
def test_a_wall_is_in_reach_from_most_poses_but_not_all(size, start):
    places, _ = walk(size, start=start)
    share = attainable(outline(Room(size, 0.6)), places[:, :2])
    assert 0.55 <= share <= 0.8


@pytest.mark.parametrize("size", SIZES[:2])
def test_every_wall_and_the_middle_are_visited(size):
    places, _ = walk(size)
    margins = np.stack([places[:, 0], size[0] - places[:, 0], places[:, 1], size[1] - places[:, 1]])
    assert (((margins >= 1) & (margins <= 2)).sum(axis=1) >= 12).all()
    assert (margins.min(axis=0) > 2.2).sum() >= 15
    assert np.linalg.norm(places[:, :2] - np.array(size[:2]) / 2, axis=1).min() < 1.0


@pytest.mark.parametrize("size", SIZES)
def test_no_wall_distance_repeats_as_on_a_grid(size):
    places, _ = walk(size)
    nearest = np.minimum(places, np.array(size) - places)[:, :2].min(axis=1)
    in_reach = nearest[nearest <= 2]
    assert np.histogram(in_reach, bins=np.arange(1, 2.05, 0.1))[0].max() < 0.4 * len(in_reach)
    on_grid = np.abs(places[:, :2] * 2 - np.round(places[:, :2] * 2)) < 0.004
    assert not on_grid.all(axis=1).any()


def test_another_start_gives_another_walk_and_the_same_one_the_same():
    first, second = walk(SIZES[0])[0], walk(SIZES[0], start=2.0)[0]
    assert (walk(SIZES[0])[0] == first).all()
    assert np.linalg.norm(first[:, None] - second, axis=-1).min() > 1e-6


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"poses": 1}, "^poses=1: "),
        ({"start": "west"}, "^start=west rad: "),
    ],
)
def test_impossible_walks_are_refused(changes, words):
    with pytest.raises(BadValue, match=words):
        walk(SIZES[0], **changes)


def test_the_smallest_room_holds_the_walk_and_a_smaller_one_is_named():
    assert len(trajectory(Room((3.1, 8.0, 2.5), 0.4))) == 160
    with pytest.raises(
        BadValue, match="^room.size=8 x 3.09 x 2.5 m: must have two sides of at least 3.1 m"
    ):
        trajectory(Room((8.0, 3.09, 2.5), 0.4))
