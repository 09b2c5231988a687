"""Sets of recorded surveys: labels by geometry, places that stay together, training on them."""

import json
from dataclasses import replace

import numpy as np
import pytest

import world as small
from echolearn.acoustics.rooms import true_echoes
from echolearn.acoustics.types import Truth
from echolearn.checks import BadValue
from echolearn.cli.main import main
from echolearn.comparison.recorded_set import (
    label_survey,
    labelled_rows,
    place_groups,
    true_echoes_of,
)
from echolearn.dataset.labelled_set import Dataset
from echolearn.localization.methods.gated import Gated
from echolearn.robot.bundle import read_bundle
from echolearn.survey.reader import read_survey


@pytest.fixture(scope="module")
def walk(world):
    """Return the walk at 0 dB, whose room is known."""
    return read_survey(world.runs / "survey" / "hall_0dB")


def test_true_echoes_are_those_of_the_room(walk):
    """The oracle is the box's own image sources, in another order of walls."""
    for pose, found in zip(walk.poses, true_echoes_of(walk, small.HALL.size[2]), strict=True):
        wanted = true_echoes(small.HALL, pose, array=walk.array)
        order, same = np.argsort(found.toa), np.argsort(wanted.toa)
        for name in ("toa", "azimuth", "elevation"):
            assert np.allclose(getattr(found, name)[order], getattr(wanted, name)[same])
    # Without a height the walls alone are left.
    assert {len(each.toa) for each in true_echoes_of(walk)} == {4}


def test_what_nothing_tells_of_is_refused(walk):
    for lacking in (replace(walk, walls=None), replace(walk, mapped=False)):
        with pytest.raises(BadValue, match="walls=None: must be the floor plan, or there must be"):
            true_echoes_of(lacking)


def test_rows_are_labelled_by_time_direction_and_place(walk):
    table, _ = labelled_rows(walk, localizer=Gated(walk.window, 36), height=4.0, further=["level"])
    truths = true_echoes_of(walk, 4.0)
    assert len(table) == len(walk) and "level" in table.dtype.names
    for row, truth, pose in zip(table, truths, walk.poses, strict=True):
        late = np.abs(truth.toa - row["toa"]) * walk.probe.sample_rate
        assert row["reflector"] == (late.min() < 10)
        assert (row["position"] == pose.position).all()
        assert row["reflector"] or not row["time_and_direction"]
    assert 0 < table["on_map"].sum() < len(table)


def test_rows_on_the_edge_and_between_two_walls_are_doubtful(walk):
    alone = replace(walk, walls=None)
    table, _ = labelled_rows(walk, localizer=Gated(walk.window, 36), height=4.0, further=[])
    sample = 1 / walk.probe.sample_rate
    misses = [(0.0,), (9.5,), (25.0,), (3.0, -4.0), (1.0, -8.0)]
    truths = [
        Truth(toa + sample * np.array(miss), *np.full((2, len(miss)), np.nan))
        for toa, miss in zip(table["toa"], misses * 8, strict=False)
    ]
    told = replace(alone, truth=tuple(truths[: len(walk)]))
    found, doubtful = labelled_rows(told, localizer=Gated(walk.window, 36), height=None, further=[])
    assert [row for row, _, _ in doubtful if row < 5] == [1, 3]
    assert "edge" in doubtful[0][2] and "two walls" in doubtful[1][2]
    assert found["reflector"][:5].tolist() == [True, True, False, True, True]
    assert "on_map" not in found.dtype.names and "time_and_direction" not in found.dtype.names


def test_poses_of_one_place_stay_together(walk):
    steps = np.array([0.0, 0.05, 0.12, 1.0, 1.2])
    poses = [replace(walk.poses[0], position=np.array([x, 0.0, 1.0])) for x in steps]
    moved = replace(walk, poses=tuple(poses))
    assert place_groups(moved).tolist() == [0, 0, 0, 1, 2]
    # A loudspeaker that moves on its own is what counts.
    beside = np.zeros((5, 3))
    beside[:, 0] = -steps
    turned = replace(moved, loudspeakers=beside)
    assert len(set(place_groups(replace(turned, poses=(poses[0],) * 5)))) == 3
    named = replace(moved, further={"place": ("b", "a", "b", "a", "c")})
    assert place_groups(named).tolist() == [1, 0, 1, 0, 2]


def test_surveys_of_one_robot_become_one_set_and_share_their_places(world, walk):
    """Rows follow each other; a pose of the second walk is at the place of the first's."""
    quiet = read_survey(world.runs / "survey" / "hall_-10dB")
    about = {"localizer": Gated(walk.window, 36), "height": 4.0, "further": []}
    both, doubtful = labelled_rows(walk, replace(quiet, truth=true_echoes_of(quiet)), **about)
    first, told = labelled_rows(walk, **about)
    assert len(both) == 2 * len(walk)
    for name in ("toa", "reflector", "position"):
        assert (both[name][: len(walk)] == first[name]).all()
    # The second survey has no floor and ceiling among its true echoes.
    assert both["truth_toa"].shape == (72, 6) and np.isnan(both["truth_toa"][36:, 4:]).all()
    assert both["snr_db"].tolist() == [0.0] * 36 + [-10.0] * 36
    same = (walk.poses[3].position == quiet.poses[3].position).all()
    assert (both["group"][3] == both["group"][39]) == same
    assert doubtful[0] == (told[0][0], told[0][1], f"hall_0dB: {told[0][2]}")
    assert max(row for row, _, _ in doubtful) >= 36
    timed = replace(quiet, walls=None, truth=true_echoes_of(quiet))
    with pytest.raises(
        BadValue, match="beside=.*must be surveys that tell their truth in the same"
    ):
        labelled_rows(walk, timed, **about)
    assert (both["group"][36:] == place_groups(walk, quiet)[36:]).all()


def test_a_labelled_survey_is_trained_on_like_any_set(world, walk, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    words = [f"survey={walk.folder}", "height=4", "localizer.azimuths=36"]
    assert main(["label", *words]) == 0
    said = capsys.readouterr().out
    place = tmp_path / "runs" / "data"
    [folder] = place.iterdir()
    assert f"{folder.name}: 36 rows, " in said and said.endswith(f"runs/data/{folder.name}\n")
    dataset = Dataset(folder)
    assert dataset.array == walk.array and len(dataset["level"]) == 36
    before = (folder / "manifest.json").stat()
    assert (
        label_survey(
            walk.folder,
            localizer=Gated(walk.window, 36),
            runs=tmp_path / "runs",
            height=4.0,
            further=json.loads((folder / "manifest.json").read_text())["plan"]["further"],
        )
        == tmp_path / "runs" / "data" / folder.name
    )
    assert (folder / "manifest.json").stat() == before
    for given in (f"plan={folder}", "plan=hall_0dB"):
        line = ["train", given, "classifier=threshold_peak", "target=on_map", "aim=balanced"]
        assert main(line) == 0
    beside = f"beside=[{world.runs / 'survey' / 'hall_-10dB'}]"
    assert main(["label", *words, "name=both", beside]) == 0
    [both] = place.glob("both-*")
    assert len(Dataset(both)) == 72
    [run] = (tmp_path / "runs" / "train").iterdir()
    metrics = json.loads((run / "metrics.json").read_text())
    assert metrics["data"] == dataset.digest and metrics["plan"] == "hall_0dB"
    # Array and burst of the bundle are those of the survey, without a word about the scene.
    assert main(["export", f"run={run.name}", "name=mine"]) == 0
    bundle = read_bundle(tmp_path / "runs" / "bundles" / "mine")
    assert bundle.array == walk.array
    assert np.allclose(bundle.probe.samples, walk.probe.samples, atol=1e-7)
