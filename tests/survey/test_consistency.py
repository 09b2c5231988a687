"""Walks that are not meant as they are written: told by echoes that do not move as poses do."""

import numpy as np
import pytest

import recorded_walks
from echolearn.simulation.walk import trajectory
from echolearn.survey.consistency import Heard, inconsistency
from echolearn.survey.examining import examine
from echolearn.survey.mending import taken_off
from echolearn.survey.reader import read_survey

SIZE = np.array([7.0, 5.0])
"""m of a room whose corner is the origin."""


def walk(seed, *, count=40):
    """Return what is heard on a way that bends: three walls of four, a third of it wrong."""
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.normal(0.0, 0.4, count))
    steps = 0.25 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    # Folded back at the walls, as a robot turns there.
    inner = SIZE - 1.4
    places = 0.7 + np.abs((np.cumsum(steps, axis=0) + inner) % (2 * inner) - inner)
    distance = np.concatenate([places, SIZE - places], axis=1)
    normals = np.array([np.pi, -np.pi / 2, 0.0, np.pi / 2])
    azimuth = normals - turn[:, None] + rng.normal(0.0, 0.1, distance.shape)
    distance = distance + rng.normal(0.0, 0.01, distance.shape)
    wrong = rng.random(distance.shape) < 0.35
    distance[wrong] = rng.uniform(0.5, 5.0, wrong.sum())
    distance[:, rng.integers(4)] = np.nan
    return Heard(places, turn, distance, azimuth)


FAULTS = {
    "feet": (lambda x: x._replace(places=x.places / 0.3048), "x_m and y_m were in feet: are they?"),
    "turns": (
        lambda x: x._replace(headings=x.headings / (2 * np.pi)),
        "would if heading_rad were in turns: is it?",
    ),
    "centimetres": (lambda x: x._replace(places=100 * x.places), "were in cm: are they?"),
    "a compass": (
        lambda x: x._replace(headings=np.pi / 2 - x.headings),
        "if headings counted clockwise, turned by about 90 degrees: are they of a compass?",
    ),
    "headings from y": (
        lambda x: x._replace(headings=x.headings + np.pi / 2),
        "would, turned by about -90 degrees: is heading_rad counted from x",
    ),
    "a ring turned by one of six": (
        lambda x: x._replace(azimuth=x.azimuth + np.pi / 3),
        "would, turned by about -60 degrees: is heading_rad counted from x, and microphone 1",
    ),
    "a ring mirrored": (
        lambda x: x._replace(azimuth=-x.azimuth),
        "would if microphones counted the other way round: do they?",
    ),
    "x and y exchanged": (
        lambda x: x._replace(places=x.places[:, ::-1]),
        "in the mirror, turned by about 90 degrees: are x and y exchanged?",
    ),
    "files one row off": (
        lambda x: x._replace(places=np.roll(x.places, 1, 0), headings=np.roll(x.headings, 1)),
        "with the pose of the row after each: are files one row off?",
    ),
    "headings that are not filled in": (
        lambda x: x._replace(headings=np.full(len(x.headings), np.pi / 6)),
        "heading_rad=0.524 at every pose, where",
    ),
    "feet of a robot that does not turn": (
        lambda x: x._replace(
            places=x.places / 0.3048,
            headings=0 * x.headings,
            azimuth=x.azimuth + x.headings[:, None],
        ),
        "x_m and y_m were in feet: are they?",
    ),
    "files one row off, up": (
        lambda x: x._replace(places=np.roll(x.places, -1, 0), headings=np.roll(x.headings, -1)),
        "with the pose of the row before each",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_wrong_with_the_poses_is_told(fault):
    change, said = FAULTS[fault]
    line = inconsistency(change(walk(1)))
    assert said in line, line


@pytest.mark.parametrize("seed", range(20))
def test_of_sound_walks_nothing_is_said(seed):
    assert inconsistency(walk(seed)) == ""


@pytest.mark.parametrize("seed", range(20))
def test_of_robots_that_do_not_turn_nothing_is_said(seed):
    heard = walk(seed)
    azimuth = heard.azimuth + heard.headings[:, None]
    assert inconsistency(heard._replace(azimuth=azimuth, headings=0 * heard.headings)) == ""


def still(heard):
    return heard._replace(places=np.zeros_like(heard.places))


@pytest.mark.parametrize("change", [still, lambda x: x._replace(distance=np.nan * x.distance)])
def test_nothing_is_said_where_nothing_tells(change):
    """A robot that stands still, or hears no wall."""
    assert inconsistency(change(walk(2))) == ""


def test_a_single_pose_says_nothing():
    alone = [each[:1] for each in walk(3)]
    assert inconsistency(Heard(*alone)) == ""


def test_recordings_late_each_by_its_own_count_as_mended(tmp_path):
    """What is told of poses is told of echoes as they are once time zero is mended."""
    recorded = recorded_walks.walk(direct=True, poses=48)
    lags = 7 + 31 * np.arange(48) % 220
    late = np.stack([taken_off(each, -lag) for each, lag in zip(recorded, lags, strict=True)])
    poses = trajectory(recorded_walks.ROOM, poses=48)
    recorded_walks.write(
        tmp_path / "late", 0.2 * late / np.abs(late).max(), direct=True, poses=poses
    )
    health = examine(read_survey(tmp_path / "late"))
    assert "later than geometry says" in health.mended[0]
    assert health.noticed == ()
