"""Mirror images of a line of microphones: of a room that is known, the wall stays and its image
goes, as soon as the walk turns."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest

from echolearn.acoustics.bistatic import echo_direction, echo_path
from echolearn.acoustics.types import Echoes, Pose
from echolearn.cli.main import main
from echolearn.localization.localize import localize
from echolearn.localization.methods.gated import Gated
from echolearn.mapping.echo_map import echo_map
from echolearn.mapping.files import svg, table
from echolearn.mapping.mapped_walk import MappedWalk
from echolearn.mapping.mirrors import chosen_sides, one_each, with_mirror_images
from echolearn.survey.examining import examine
from echolearn.survey.reader import read_survey

ALONG = "[[0.15,0.05,0.0],[0.05,0.05,0.0],[-0.05,0.05,0.0],[-0.15,0.05,0.0]]"
"""A line along the heading: it hears the wall that the robot follows on both of its sides."""


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Return a walk around a room of 8 by 6 m, and the echoes that were localized."""
    place = tmp_path_factory.mktemp("line")
    words = ["scene=line", f"scene.array.positions={ALONG}", "scene.array.loudspeaker=[0,0,0]"]
    words += ["scene.probe.length=4000", "poses=40", "snr_db=30", "name=walk", f"runs={place}"]
    assert main(["survey", "room=8x6x5", *words]) == 0
    survey = read_survey(place / "survey" / "walk")
    echoes, _ = localize(survey.observe(range(len(survey))), Gated(), names=())
    return survey, echoes


def mapped(walk, chosen, *, mirrored=True):
    """Return the map of some poses of a walk by all their echoes."""
    survey, echoes = walk
    poses = [survey.poses[pose] for pose in chosen]
    # On either side, as a localizer may have it.
    side = np.arange(len(survey)) % 2 == 1
    azimuth = np.where(side[:, None], -echoes.azimuth, echoes.azimuth)
    heard = replace(echoes, azimuth=azimuth)
    heard = Echoes(*(column[chosen] for column in vars(heard).values()))
    found = echo_map(heard, poses, array=survey.array)
    about = MappedWalk(heard, found, poses, range(len(poses)), survey.walls)
    return with_mirror_images(about, survey.array, speed_of_sound=343.0) if mirrored else about


def on_walls(points):
    """Tell which points (..., 2) are within 0.1 m of the room's walls."""
    x, y = points[..., 0], points[..., 1]
    return np.abs([x, 8.0 - x, y, 6.0 - y]).min(axis=0) <= 0.1


def test_on_a_walk_that_turns_the_mirror_image_goes(walk):
    every = range(len(walk[0]))
    before, after = mapped(walk, every, mirrored=False), mapped(walk, every)
    assert on_walls(before.map.points).mean() < 0.75
    pairs = on_walls(after.map.points.reshape(-1, 2, 2))
    kept = after.map.kept.reshape(-1, 2)
    assert not kept.all(axis=1).any()
    assert on_walls(after.map.points[after.map.kept]).mean() >= 0.95
    assert kept.any(axis=1).sum() >= 0.9 * pairs.any(axis=1).sum()
    assert len(after.lines) == 4
    scored = one_each(after, after.outline)
    assert (on_walls(scored.points) == pairs.any(axis=1)).all()


def test_on_a_straight_walk_neither_side_is_believed(walk):
    """Past a wall 1.5 m to the right, at one heading, all that is heard is heard from both."""
    survey, echoes = walk
    count = 12
    poses = [Pose(np.array([2.0 + 0.2 * step, 1.5, 1.5]), 0.0) for step in range(count)]
    right = np.array([[0.0, -1.0, 0.0]])
    toward = echo_direction(np.array([1.5]), right, array=survey.array)[0]
    late = float(echo_path(1.5, right, array=survey.array)[0]) / 343.0
    azimuth = np.arctan2(toward[1], toward[0]) * np.resize([1.0, -1.0], (count, 1))
    heard = Echoes(*(column[:count] for column in vars(echoes).values()))
    heard = replace(heard, toa=np.full((count, 1), late), azimuth=azimuth)
    found = echo_map(heard, poses, array=survey.array)
    found = MappedWalk(heard, found, poses, range(count))
    found = with_mirror_images(found, survey.array, speed_of_sound=343.0)
    assert on_walls(found.map.points.reshape(-1, 2, 2)).any(axis=1).all()
    assert found.undecided.all() and not found.shown.any() and not found.lines


def test_both_points_stand_in_the_table_and_undecided_ones_have_a_colour(walk):
    found = mapped(walk, range(len(walk[0])))
    rows = [*csv.DictReader(io.StringIO(table.write(found)["map.csv"].decode()))]
    assert [*rows[0]][-1] == "mirror_of" and len(rows) == 2 * len(walk[0])
    for number, row in enumerate(rows):
        twin = rows[int(row["mirror_of"])]
        assert int(twin["mirror_of"]) == number and twin["toa_s"] == row["toa_s"]
        assert float(twin["azimuth_rad"]) == pytest.approx(-float(row["azimuth_rad"]))
    drawing = svg.write(found)["map.svg"].decode()
    assert drawing.count('class="undecided"') == found.undecided.sum()
    plain = mapped(walk, range(len(walk[0])), mirrored=False)
    assert "mirror_of" not in table.write(plain)["map.csv"].decode()
    assert "undecided" not in svg.write(plain)["map.svg"].decode()


def test_a_sound_walk_is_accused_of_nothing(walk):
    """Echoes on the wrong side move otherwise than the poses, which are right all the same."""
    assert examine(walk[0]).noticed == ()


def test_an_echo_from_above_is_kept_once(walk):
    survey, echoes = walk
    pose = Pose(np.array([4.0, 3.0, 1.5]))
    above = Echoes(*(column[:1] for column in vars(echoes).values()))
    above = replace(above, elevation=np.zeros((1, 1)))
    found = MappedWalk(above, echo_map(above, [pose], array=survey.array), [pose], range(1))
    found = with_mirror_images(found, survey.array, speed_of_sound=343.0)
    assert found.map.kept.tolist() == [True, False] and found.upright.sum() == 1


def test_three_poses_more_decide_and_two_do_not():
    """A wall at y = 2 heard from below; images of the last echoes are scattered, of others not."""
    for scattered, decided in ((2, False), (3, True)):
        count = 8
        poses = np.stack([np.linspace(0.0, 2.0, count), np.zeros(count)], axis=1)
        wall = poses + [0.0, 2.0]
        image = poses - [0.0, 2.0]
        image[count - scattered :, 1] -= np.arange(1, scattered + 1)
        points = np.stack([wall, image], axis=1)
        everything = np.ones(count, dtype=bool)
        found = chosen_sides(points, poses, index=np.arange(count), among=everything)
        assert (found == 0).all() == decided and (found != 1).all()
