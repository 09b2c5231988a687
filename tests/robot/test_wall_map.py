"""From a survey and a bundle of walls to map files: walls that no single recording tells."""

import csv
import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from bundle_mutants import seal
from by_hand import edit
from echolearn.acoustics.geometry import circular_array, turned
from echolearn.acoustics.types import MicArray
from echolearn.checks import BadValue
from echolearn.comparison.bundled import opened_bundle
from echolearn.robot.bundle import read_bundle
from echolearn.robot.live.following import live_survey
from echolearn.robot.scorer import load
from echolearn.robot.shipped import FOLDER
from echolearn.robot.survey_map import map_survey
from echolearn.survey.reader import read_survey
from refusals import refused
from walled_rooms import arrivals, write_walk

WALK = FOLDER / "walk"
SCORER = load(WALK)
RING, PROBE = SCORER.bundle.array, SCORER.bundle.probe
NORMALS = {-np.pi / 2: 1.3, 0.0: 5.4, np.pi / 2: 4.3, -np.pi: 1.4}
"""The walls of the box: normals in rad, offsets in m."""


def table(folder, name):
    """Return the columns of a table."""
    with (folder / name).open(newline="") as file:
        rows = list(csv.DictReader(file))
    return {key: np.array([float(row[key]) for row in rows]) for key in rows[0]} if rows else {}


@pytest.fixture(scope="module")
def faint(tmp_path_factory):
    """Return a walk whose echoes are 26 dB below the noise, and its map."""
    runs = tmp_path_factory.mktemp("faint")
    walk = write_walk(runs / "walk", PROBE, RING, amplitude=0.05)
    return walk, map_survey(survey=walk, bundle=WALK, runs=runs)


def check_box(walls):
    """Expect the four walls of the box within 1 cm and half a degree."""
    assert len(walls["normal_rad"]) == len(NORMALS)
    for normal, offset in NORMALS.items():
        turn = np.abs(np.angle(np.exp(1j * (walls["normal_rad"] - normal))))
        assert turn.min() < np.deg2rad(0.5)
        assert abs(walls["offset_m"][turn.argmin()] - offset) < 0.01


def test_walls_are_found_that_no_recording_tells(faint):
    walk, folder = faint
    check_box(table(folder, "walls.csv"))
    about = json.loads((folder / "manifest.json").read_text())
    said = table(folder, "hypotheses.csv")
    assert (about["walls"], about["hypotheses"]) == (4, len(said["wall"]))
    assert about["hypotheses"] > 6 and about["scores"]["precision"] == 1.0
    # Most poses have nothing of their own to say: the strongest response of a pose is noise.
    assert about["points"] < about["poses"]


def test_believed_are_those_above_the_cut(faint):
    said = table(faint[1], "hypotheses.csv")
    believed = said["confidence"] >= SCORER.bundle.threshold
    assert np.array_equal(said["wall"] == 1, believed)
    assert (np.diff(said["strength"]) <= 0).all()


def test_points_that_are_kept_lie_on_walls_and_arrive_when_these_echo(faint):
    walk, folder = faint
    rows = table(folder, "map.csv")
    kept = rows["kept"] == 1
    assert 4 <= kept.sum() < len(kept) and (np.diff(rows["index"]) >= 0).all()
    poses = read_survey(walk).poses
    assert ((rows["confidence"] >= 0.0) & (rows["confidence"] <= 1.0)).all()
    for index, toa in zip(rows["index"][kept], rows["toa_s"][kept], strict=True):
        true = [each[0] for each in arrivals(poses[int(index)], RING)]
        # A foot may be 5 cm off its wall.
        assert np.abs(np.array(true) - toa).min() < 0.1 / 343.0
    sides = np.abs(rows["x_m"][:, None] - [-1.4, 5.4]), np.abs(rows["y_m"][:, None] - [-1.3, 4.3])
    assert np.hstack(sides).min(axis=1)[kept].max() < 0.06


def test_a_turned_array_hears_the_same_walls(tmp_path):
    mounted = MicArray(turned(RING.positions, 0.7))
    walk = write_walk(tmp_path / "walk", PROBE, mounted, amplitude=0.12, walls=False)
    check_box(table(map_survey(survey=walk, bundle=WALK, runs=tmp_path), "walls.csv"))


def test_noise_alone_has_no_walls_and_says_what_may_be_why(tmp_path, capsys):
    walk = write_walk(tmp_path / "walk", PROBE, RING, poses=24, amplitude=0.0)
    folder = map_survey(survey=walk, bundle=WALK, runs=tmp_path)
    assert table(folder, "walls.csv") == {} and set(table(folder, "map.csv")["kept"]) == {0.0}
    said = capsys.readouterr().out
    assert "24 poses, 0 echoes kept: 0 walls in 0 stretches, of" in said
    assert "the most likely cause first:" in said


def test_a_walk_of_three_poses_speaks_for_no_line(tmp_path):
    walk = write_walk(tmp_path / "walk", PROBE, RING, poses=3)
    folder = map_survey(survey=walk, bundle=WALK, runs=tmp_path)
    assert [table(folder, name) for name in ("map.csv", "walls.csv", "hypotheses.csv")] == [{}] * 3


MADE = "walk was made for 6 microphones, the farthest 200 mm from the loudspeaker: for this array"
OTHERS = {
    "another array": ({"array": circular_array(radius=0.1)}, "microphones=one is off", MADE),
    "fewer microphones": ({"array": circular_array(microphones=4)}, "microphones=4", MADE),
    "another rate": (
        {"probe": replace(PROBE, sample_rate=44100.0)},
        "bundle expects sample_rate=22050 Hz, survey has 44100 Hz",
        "resample=true",
    ),
    "another probe": (
        {"probe": replace(PROBE, samples=PROBE.samples[::-1].copy())},
        "probe=correlates",
        "play the bundle's probe.wav, or train with yours",
    ),
}


@pytest.mark.parametrize(("other", "said", "advice"), OTHERS.values(), ids=OTHERS)
def test_another_robot_is_told_for_which_it_was_made_and_what_to_do(other, said, advice, tmp_path):
    given: dict = {"probe": PROBE, "array": RING} | other
    walk = write_walk(tmp_path / "walk", given["probe"], given["array"], poses=2)
    with pytest.raises(BadValue) as error:
        map_survey(survey=walk, bundle=WALK, runs=tmp_path)
    assert said in str(error.value) and advice in str(error.value)
    assert "\n" not in str(error.value) and not (tmp_path / "maps").exists()


def test_what_cannot_be_judged_as_a_walk_is_refused_in_a_line(tmp_path):
    walk = write_walk(tmp_path / "walk", PROBE, RING, poses=2)
    again = partial(map_survey, survey=walk, bundle=WALK, runs=tmp_path)
    with refused("localizer.sign=either: must be null; walk judges walls"):
        again(localizer={"sign": "either"})
    with refused("bundle="):
        live_survey(survey=walk, bundle=WALK, runs=tmp_path, until=1)
    with refused("bundles=walk: must judge echoes"):
        opened_bundle(["walk"], tmp_path, finished=[])
    with refused("bundle=walk: must judge single echoes"):
        SCORER.score(read_survey(walk).observe([0]), [])
    edit(walk, map=False)
    with refused(f"survey={walk}: must have poses to sum over"):
        again()


WRONG = {
    "a column that no line has": ({"columns": [{"name": "toa", "unit": "1"}]}, "columns=toa: must"),
    "a unit": ({"columns": [{"name": "strength", "unit": "m"}]}, "columns=['m']: must"),
    "too few inputs": ({"input_shape": [3]}, "input_shape=[3]: must be [15]"),
    "no hypotheses": ({"hypotheses": ...}, "hypotheses=missing"),
    "too many": ({"hypotheses__count": 10**6}, "hypotheses.count=1000000"),
    "echoes": ({"label": {"name": "on_map", "true": "x"}}, "label"),
    "another format": ({"schema": 3}, "hypotheses"),
    "another tensor": ({"view": "covariance"}, "view=covariance"),
}


@pytest.mark.parametrize(("changes", "said"), WRONG.values(), ids=WRONG)
def test_a_bundle_of_walls_from_a_stranger_is_believed_nothing(changes, said, tmp_path):
    folder = Path(shutil.copytree(WALK, tmp_path / "bundle"))
    seal(folder, **changes)
    with refused(f"{folder}/bundle.json ") as error:
        read_bundle(folder)
    assert said in str(error.value)
