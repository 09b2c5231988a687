"""Paths that are drawn before any wall: where they go, how far, which way the robot looks."""

import numpy as np
import pytest

from echolearn.simulation.paths import PATHS, WEAVE, corridor, stop_and_go, wandering

EXTENT = np.array([5.0, 3.0])


def drawn(draw, poses=300, seed=0):
    return draw(poses, extent=EXTENT, stride=0.2, rng=np.random.default_rng(seed))


@pytest.mark.parametrize("name", PATHS)
def test_a_path_keeps_to_its_rectangle_and_is_drawn_alike(name):
    path = drawn(PATHS[name])
    assert path.shape == (300, 3) and np.isfinite(path).all()
    assert (path[:, :2] >= -1e-9).all() and (path[:, :2] <= EXTENT + 1e-9).all()
    assert np.array_equal(path, drawn(PATHS[name]))
    assert not np.allclose(path, drawn(PATHS[name], seed=1))


def test_who_wanders_goes_on_by_a_stride_in_the_direction_he_looks():
    path = drawn(wandering)
    steps = np.diff(path[:, :2], axis=0)
    length = np.linalg.norm(steps, axis=1)
    assert length.max() <= 0.2 + 1e-9 and (np.abs(length - 0.2) < 1e-9).mean() > 0.95
    ahead = np.stack([np.cos(path[1:, 2]), np.sin(path[1:, 2])], axis=1)
    assert np.allclose(steps, length[:, None] * ahead)


def test_who_wanders_comes_everywhere():
    path = drawn(wandering, poses=3000)
    hits, _, _ = np.histogram2d(*path[:, :2].T, bins=4, range=[(0, 5), (0, 3)])
    assert hits.min() > 0.2 * hits.mean()


def test_a_corridor_is_walked_up_and_down_looking_ahead():
    path = drawn(corridor)
    assert np.ptp(path[:, 0]) == pytest.approx(5.0, abs=0.2)
    assert path[:, 1].max() <= 2.0 * WEAVE + 1e-9
    steps = np.diff(path[:, :2], axis=0)
    turned = np.sign(steps[1:, 0]) != np.sign(steps[:-1, 0])
    assert 8 <= turned.sum() <= 12  # 60 m in a passage of 5 m
    looking = np.cos(path[:-1, 2] - np.arctan2(steps[:, 1], steps[:, 0]))
    assert np.median(looking) > 0.99


def test_who_stops_turns_on_the_spot_and_then_goes_farther():
    path = drawn(stop_and_go)
    length = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)
    stops = length == 0
    assert 0.25 < stops.mean() < 0.5 and length.max() > 0.4
    turns = np.angle(np.exp(1j * np.diff(path[:, 2])))[stops]
    assert np.std(turns) == pytest.approx(np.pi / np.sqrt(3), rel=0.15)
