"""Odometry: errors of the size and kind that each model is asked for, in a frame of its own."""

import numpy as np
import pytest

from echolearn.simulation.odometry import MODELS, in_own_frame, told_poses, turned_path
from echolearn.simulation.paths import wandering

PATH = wandering(400, extent=np.array([9.0, 7.0]), stride=0.2, rng=np.random.default_rng(0))


def errors(model, seed=0, sigma=0.04):
    return told_poses(PATH, model=model, sigma=sigma, rng=np.random.default_rng(seed)) - PATH


def test_an_exact_odometry_tells_the_truth():
    assert not errors("exact").any()


def test_a_white_odometry_errs_at_each_pose_anew():
    off = errors("white")
    assert off.std(axis=0) == pytest.approx([0.04, 0.04, 0.02], rel=0.15)
    assert np.abs(np.corrcoef(off[1:, 0], off[:-1, 0])[0, 1]) < 0.15


def test_a_drifting_odometry_errs_by_an_eighth_at_each_pose_and_keeps_it():
    many = np.array([errors("drift", seed=seed) for seed in range(200)])
    first, last = many[:, 0].std(axis=0), many[:, -1].std(axis=0)
    assert first == pytest.approx([0.005, 0.005, 0.0025], rel=0.2)
    assert last == pytest.approx(20.0 * first, rel=0.3)


@pytest.mark.parametrize("seed", range(4))
def test_a_biased_heading_turns_away_evenly_and_takes_places_along(seed):
    off = errors("bias", seed=seed)
    rms = np.sqrt(np.mean(np.sum(off[:, :2] ** 2, axis=1)))
    assert rms == pytest.approx(0.04, rel=0.01)
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(PATH[:, :2], axis=0), axis=1)))
    rate = off[-1, 2] / way[-1]
    assert rate != 0 and np.allclose(off[:, 2], rate * way)
    # Lengths of steps are what wheels tell; only their direction is wrong.
    steps = [np.linalg.norm(np.diff(each[:, :2], axis=0), axis=1) for each in (PATH, PATH + off)]
    assert np.allclose(*steps)


@pytest.mark.parametrize("model", MODELS)
def test_a_path_that_stands_still_has_an_odometry(model):
    still = np.zeros((5, 3))
    poses = told_poses(still, model=model, sigma=0.1, rng=np.random.default_rng(0))
    assert np.isfinite(poses).all()


def test_a_frame_of_its_own_keeps_all_shapes():
    own = in_own_frame(PATH, rng=np.random.default_rng(3))
    lengths = [np.linalg.norm(each[:, :2] - each[9, :2], axis=1) for each in (own, PATH)]
    assert np.allclose(*lengths)
    turn = own[0, 2] - PATH[0, 2]
    assert abs(turn) > 0.1
    back = turned_path(own, angle=-turn, shift=np.zeros(2))
    assert np.allclose(back - back[0], PATH - PATH[0])
