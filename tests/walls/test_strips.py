"""Strips, their masks and columns: what of them is sound, and what is not."""

import numpy as np
import pytest

from echolearn.walls.nouns import GEOMETRY, SOUND, Hypotheses
from echolearn.walls.strips import (
    filled,
    geometry_columns,
    sound_columns,
    strips,
)
from echolearn.walls.walk import HeardWalk
from heard_walks import RATE, heard, wandering

WALL = (0.0, 4.8, -9.0, 9.0)
LINES = Hypotheses(np.array([0.0, 2.0]), np.array([4.8, 3.0]), np.array([2.0, 1.0]))
"""A true wall, and a line where nothing is."""


@pytest.fixture(scope="module")
def walk():
    """Return 30 poses that all have the true wall in their window."""
    return heard([WALL], wandering(30, low=(3.0, 0.0), high=(3.6, 3.0)), amplitude=1.5)


def test_a_true_wall_is_a_bright_line_in_the_middle(walk):
    cut = strips(walk, LINES, reach=10)
    mean = cut.values[0].mean(axis=0)
    assert cut.values.shape == (2, 30, 21, 7)
    assert np.unravel_index(mean.argmax(), mean.shape) == (10, 3)
    assert mean[10, 3] > 4 * np.abs(np.delete(mean[:, 3], [9, 10, 11])).max()


def test_strips_hold_what_poses_have_there_and_say_where_they_have_nothing(walk):
    cut = strips(walk, LINES, reach=30)
    azimuth, distance, inside = walk.seen(LINES.theta, LINES.rho)
    away = distance[..., None] + walk.step * np.arange(-30, 31)
    known = inside[..., None] & (away >= 1.0) & (away <= 2.0)
    assert np.array_equal(cut.known, known) and not known.all()
    assert not cut.values[~known].any()
    pose = int(np.flatnonzero(inside[0])[0])
    turned = azimuth[0, pose] + np.deg2rad(6.0)
    direct = walk.at(pose=np.full(61, pose), azimuth=turned, distance=away[0, pose])
    assert np.allclose(cut.values[0, pose, :, 5], np.where(known[0, pose], direct, 0.0))


def test_noise_fills_what_is_unknown_with_values_of_the_same_pose(walk):
    cut = strips(walk, LINES, reach=30)
    whole = filled(walk, cut, rng=np.random.default_rng(0))
    again = filled(walk, cut, rng=np.random.default_rng(0))
    assert np.array_equal(whole, again)
    assert np.array_equal(whole[cut.known], cut.values[cut.known])
    _, poses, _ = np.nonzero(~cut.known & cut.seen[..., None])
    blank = ~cut.known[0, poses[0]]
    assert np.isin(whole[0, poses[0]][blank], walk.responses[poses[0]]).all()


def test_columns_of_sound_tell_a_wall_from_nothing(walk):
    table = sound_columns(walk, LINES, cut=strips(walk, LINES))
    assert table.shape == (2, len(SOUND)) and np.isfinite(table).all()
    wall, nothing = (dict(zip(SOUND, row, strict=True)) for row in table)
    lower = {"profile_offset"}
    for name in SOUND:
        assert (wall[name] < nothing[name]) == (name in lower), name
    assert (wall["strength"], wall["profile_offset"], wall["relative"]) == (2.0, 0.0, 1.0)
    each = walk.at(pose=np.arange(30), azimuth=-walk.poses[:, 2], distance=4.8 - walk.poses[:, 0])
    assert wall["evidence_exact"] == pytest.approx(each.sum() / np.sqrt(30), rel=1e-5)


def test_columns_of_geometry_hear_nothing(walk):
    noise = np.random.default_rng(9).standard_normal(walk.outputs.shape)
    other = HeardWalk(noise, walk.poses, walk.window, walk.array, RATE)
    tables = [geometry_columns(each, LINES, cut=strips(each, LINES)) for each in (walk, other)]
    assert np.array_equal(*tables)


def test_columns_of_geometry_by_hand():
    poses = np.array([[0.0, 0.0, 0.1], [0.0, 0.4, 0.2], [0.5, 1.0, 0.3], [9.0, 2.0, 0.4]])
    walk = heard([], poses)
    lines = Hypotheses(np.zeros(1), np.array([1.7]), np.ones(1))
    row = geometry_columns(walk, lines, cut=strips(walk, lines, reach=0))[0]
    found = dict(zip(GEOMETRY, row.tolist(), strict=True))
    mean = 4.6 / 3
    deviation = np.sqrt((2 * (1.7 - mean) ** 2 + (1.2 - mean) ** 2) / 3)
    expected = {"poses": 3, "share_of_walk": 0.75, "distance_mean": mean, "blank": 0.0}
    expected |= {"distance_sd": deviation, "distance_least": 1.2, "distance_most": 1.7}
    expected |= {"length": 1.0, "gap": 0.6, "step_mean": 0.5, "beyond": 0.25}
    assert found == pytest.approx(expected, abs=1e-6)
