"""Echoes to map points: true echoes land on their wall, and a turned robot turns its map."""

import numpy as np
import pytest

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.rooms import outline, true_echoes
from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.types import Echoes, Pose, Room
from echolearn.checks import BadValue
from echolearn.mapping.echo_map import echo_map
from echolearn.simulation.walk import trajectory

ARRAY = circular_array()
ROOM = Room((8.0, 6.0, 5.0), 0.6)


@pytest.mark.parametrize("wall", range(4))
def test_true_echoes_land_on_their_wall(wall):
    poses = trajectory(ROOM)
    truths = [true_echoes(ROOM, pose, array=ARRAY) for pose in poses]
    toa, azimuth, elevation = np.array(
        [[t.toa[wall], t.azimuth[wall], t.elevation[wall]] for t in truths]
    ).T
    found = echo_map(Echoes(toa, toa, toa, azimuth, elevation, toa), poses, array=ARRAY)
    axis, place = wall // 2, ROOM.size[wall // 2] * (wall % 2)
    np.testing.assert_allclose(found.points[:, axis], place, atol=1e-9)
    np.testing.assert_allclose(found.points[:, 1 - axis], found.poses[:, 1 - axis], atol=1e-9)
    assert distance_to_outline(found.points, outline(ROOM)).max() < 1e-9
    assert found.kept.all() and (found.confidence == 1).all()


def some_echoes(*shape):
    fields = np.random.default_rng(0).uniform(0.5, 1.5, size=(6, *shape))
    fields[0] /= 100
    return Echoes(*fields)


def test_a_turned_and_shifted_robot_turns_and_shifts_its_map():
    angle, shift = 1.1, np.array([2.0, -1.0, 0.5])
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    poses = [Pose(place[:3], float(place[3])) for place in np.random.default_rng(1).random((20, 4))]
    moved = [Pose(turn @ pose.position + shift, pose.heading + angle) for pose in poses]
    here, there = (echo_map(some_echoes(20), at, array=ARRAY) for at in (poses, moved))

    def follows(before, after):
        np.testing.assert_allclose(after, before @ turn[:2, :2].T + shift[:2], atol=1e-12)

    follows(here.points, there.points)
    follows(here.poses, there.poses)


def test_several_echoes_of_a_pose_stay_with_it():
    echoes = some_echoes(4, 3)
    poses = [Pose(np.array([i, 2.0 * i, 1.0]), 0.1 * i) for i in range(4)]
    confidence = np.linspace(0, 1, 12).reshape(4, 3)
    found = echo_map(echoes, poses, array=ARRAY, confidence=confidence)
    assert found.points.shape == found.poses.shape == (12, 2)
    np.testing.assert_allclose(found.poses[:, 0], np.repeat(np.arange(4), 3))
    np.testing.assert_allclose(found.confidence, confidence.ravel())
    second = Echoes(*(field[:, 1] for field in vars(echoes).values()))
    np.testing.assert_allclose(found.points[1::3], echo_map(second, poses, array=ARRAY).points)


def test_no_pose_gives_an_empty_map():
    found = echo_map(some_echoes(0), [], array=ARRAY)
    assert found.points.shape == found.poses.shape == (0, 2)
    assert found.kept.shape == (0,)


@pytest.mark.parametrize(
    ("poses", "confidence", "message"),
    [
        (1, None, r"^echoes.toa=shape \(2,\): must have one row for each of 1 poses"),
        (2, [0.5, 2.0], "from 0 to 1; was a logit given"),
        (2, [0.5, float("nan")], "from 0 to 1; was a logit given"),
        (2, [0.5], "^confidence=1 values: must have one value for each of 2 echoes"),
    ],
)
def test_columns_that_do_not_belong_together_are_refused(poses, confidence, message):
    with pytest.raises(BadValue, match=message):
        echo_map(some_echoes(2), [Pose(np.zeros(3))] * poses, array=ARRAY, confidence=confidence)
