"""Tracks: the smooth path through a strip, and the wall that is fitted to it."""

from itertools import product

import numpy as np
import pytest

from echolearn.walls.nouns import Hypotheses
from echolearn.walls.strips import strips
from echolearn.walls.track import WANDER, follow, lag_track
from heard_walks import heard, wandering


def test_the_track_is_the_best_of_all_paths():
    rng = np.random.default_rng(0)
    for _ in range(5):
        strip = 2.0 * rng.standard_normal((4, 5))
        steps = rng.integers(1, 4, 3)

        def worth(path, strip=strip, steps=steps):
            cost = (np.diff(path) ** 2 / (2.0 * WANDER**2 * steps)).sum()
            return strip[np.arange(4), list(path)].sum() - cost

        best = max(product(range(5), repeat=4), key=worth)
        assert lag_track(strip, steps).tolist() == list(best)


def test_a_wall_is_found_where_it_is_as_far_as_it_reaches():
    """Tilted by 0.3 degrees and 1 cm off, the hypothesis is mended; the wall ends at y = 2."""
    poses = wandering(80, low=(3.0, -2.0), high=(3.6, 4.0))
    walk = heard([(0.0, 4.8, -9.0, 2.0)], poses, amplitude=3.0)
    lines = Hypotheses(np.array([np.deg2rad(0.3)]), np.array([4.81]), np.ones(1))
    found = follow(walk, lines, cut=strips(walk, lines), number=0)

    assert found.line.normal == pytest.approx(0.0, abs=np.deg2rad(0.15))
    assert found.line.offset == pytest.approx(4.8, abs=0.005)
    (ends,) = found.stretches
    assert ends[:, 0] == pytest.approx([4.8, 4.8], abs=0.01)
    inside = poses[poses[:, 1] <= 2.0]
    assert np.sort(ends[:, 1]) == pytest.approx([inside[:, 1].min(), inside[:, 1].max()], abs=0.05)
    assert found.heard.sum() > 0.9 * len(inside)
    assert np.abs(found.points[found.heard, 0] - 4.8).max() < 0.03


def test_the_track_follows_the_odometry():
    """Poses that are told 2 cm too near to the wall hear it 2 cm behind its line."""
    poses = wandering(40, low=(3.0, 0.0), high=(3.6, 3.0))
    told = poses + np.where(np.arange(40)[:, None] < 20, 0.0, [0.02, 0.0, 0.0])
    walk = heard([(0.0, 4.8, -9.0, 9.0)], poses, amplitude=5.0, told=told)
    lines = Hypotheses(np.zeros(1), np.array([4.8]), np.ones(1))
    found = follow(walk, lines, cut=strips(walk, lines), number=0)
    assert np.abs(found.lags[:18]).max() <= 1
    assert walk.step * np.median(found.lags[22:]) == pytest.approx(0.02, abs=walk.step)


def test_what_nobody_heard_keeps_its_line_and_is_not_called_certain():
    walk = heard([], wandering(30, low=(3.0, 0.0), high=(3.6, 3.0)))
    lines = Hypotheses(np.zeros(1), np.array([4.8]), np.ones(1))
    found = follow(walk, lines, cut=strips(walk, lines), number=0)
    assert found.heard.sum() < 4
    assert (found.line.normal, found.line.offset) == pytest.approx((0.0, 4.8), abs=1e-9)
    assert np.isnan([found.line.normal_sd, found.line.offset_sd]).all()
