"""A filter for a robot from its own recordings: one command, resumed, refused where it must be."""

import json
import shutil

import pytest
import yaml

from echolearn.cli.main import main
from echolearn.storage import manifests

QUICK = ["plan.rows=192", "walks=0", "engine=serial", "classifier.iterations=20", "aim=balanced"]


def line(*words):
    """Run a command line that must do."""
    assert main(list(words)) == 0


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """Return a folder in which a robot of four microphones has recorded a walk, and its filter."""
    place = tmp_path_factory.mktemp("robot")
    robot = ["scene=respeaker", "scene.probe.length=6000"]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        line("survey", "name=walk", "poses=8", "snr_db=30", *robot)
        line("fit", "survey=runs/survey/walk", *QUICK)
        yield place


def parts_of(place):
    """Return the folders of a fit's steps by what they are."""
    runs = place / "runs"
    parts = manifests.verify(runs / "fit" / "walk")["parts"]
    kinds = {"set": "data", "run": "train", "bundle": "bundles", "map": "maps"}
    return {what: runs / kinds[what] / name for what, name in parts.items()}


def test_set_and_bundle_are_of_this_robot(walked):
    parts = parts_of(walked)
    about = yaml.safe_load((walked / "runs" / "survey" / "walk" / "survey.yaml").read_text())
    bundle = json.loads((parts["bundle"] / "bundle.json").read_text())
    assert bundle["array"] == about["microphones"]
    assert bundle["label"]["name"] == "on_map"
    plan = manifests.load_manifest(parts["set"])["plan"]
    assert plan["scene"]["probe"]["length"] == 6000 and plan["rows"] == 192
    assert plan["realism"]["suffix"] == "_measured"


def test_the_page_says_what_was_heard_and_shows_the_map(walked):
    page = (walked / "runs" / "fit" / "walk" / "fit.html").read_text()
    about = manifests.load_manifest(parts_of(walked)["map"])
    assert f"{about['kept']} of the echoes at 8 poses are believed" in page
    assert "4 microphones, a burst of 68 ms at 22050 Hz" in page and "$" not in page
    assert page.count("<svg") == bool(about["points"])
    assert "<b>window</b> walls are sought from 1 to 2 m (within=)" in page
    assert "<b>domain</b> no reference, not checked" in page
    for what, part in parts_of(walked).items():
        assert f'<b>{what}</b> <a href="../../{part.parent.name}/{part.name}/">' in page


def test_the_same_command_makes_nothing_anew(walked, monkeypatch, capsys):
    monkeypatch.chdir(walked)
    before = {
        part: (part / "manifest.json").stat()
        for part in parts_of(walked).values()
        if (part / "manifest.json").exists()
    }
    line("fit", "survey=runs/survey/walk", *QUICK)
    assert "shards" not in capsys.readouterr().err
    assert all((part / "manifest.json").stat() == found for part, found in before.items())


def test_each_step_is_that_of_a_command(walked, monkeypatch, capsys):
    """The set that `generate` makes for the survey's scene is the one that is there."""
    monkeypatch.chdir(walked)
    plan = manifests.load_manifest(parts_of(walked)["set"])["plan"]
    low, high = plan["t60"]
    words = [f"plan.t60=[{low},{high}]", "plan.name=walk", "plan=varied", QUICK[0], QUICK[2]]
    line("generate", "scene=survey", "scene.folder=runs/survey/walk", *words)
    assert capsys.readouterr().out.strip().endswith(parts_of(walked)["set"].name)


@pytest.fixture
def robot(walked, tmp_path, monkeypatch):
    """Return the keys of a robot.yaml for that robot, in a folder with what was made of it."""
    shutil.copytree(walked / "runs", tmp_path / "runs")
    survey = tmp_path / "runs" / "survey" / "walk"
    shutil.copy(survey / "probe.wav", tmp_path)
    monkeypatch.chdir(tmp_path)
    about = yaml.safe_load((survey / "survey.yaml").read_text())
    return {key: about[key] for key in ("sample_rate", "microphones", "loudspeaker")}


def test_a_robot_file_makes_the_filter_that_its_survey_makes(robot, tmp_path):
    """With the decay that was heard, set, run and bundle are those that are there."""
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
    before = parts_of(tmp_path)
    low, high = manifests.load_manifest(before.pop("set"))["plan"]["t60"]
    line("fit", "robot=robot.yaml", "name=walk", f"plan.t60=[{low},{high}]", *QUICK)
    after = parts_of(tmp_path)
    assert after.pop("set") and after == {key: before[key] for key in ("run", "bundle")}
    assert len([*(tmp_path / "runs" / "data").iterdir()]) == 1
    page = (tmp_path / "runs" / "fit" / "walk" / "fit.html").read_text()
    assert "Nothing was heard yet" in page and "<svg" not in page and "$" not in page
    assert "at each pose 6000 samples at 22050 Hz of 4 microphones" in page.replace("</b>", "")
    assert f'href="../../bundles/{after["bundle"].name}/"' in page


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"loudspeaker": None}, "must be 3 finite numbers in m"),
        ({"microfones": []}, "key=microfones: must be one of sample_rate, speed_of_sound, micro"),
        ({"direct_path": "removed"}, "has what survey.yaml says of the robot, and probe"),
        ({"sample_rate": 44100}, "probe.wav sample_rate=22050 Hz: must be 44100 Hz"),
        ({"probe": "none.wav"}, "none.wav: cannot be read as WAV"),
        ({"microphones": [[0.1, 0, 0], [0.1, 0, 0]]}, "microphones 1 and 2 at one place"),
        ({"speed_of_sound": 20}, "is it the temperature?"),
    ],
)
def test_what_is_wrong_with_a_robot_file_is_told_in_one_line(
    robot, changed, said, tmp_path, capsys
):
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot | changed))
    assert main(["fit", "robot=robot.yaml"]) == 1
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1, error


def test_what_cannot_be_fitted_is_refused_in_one_line(walked, monkeypatch, capsys):
    monkeypatch.chdir(walked)
    (walked / "runs" / "fit" / "other").mkdir(parents=True)
    (walked / "runs" / "fit" / "other" / "notes.txt").write_text("mine")
    for words, said in (
        (["survey=nowhere"], "survey=nowhere: must be a folder"),
        ([], "name it: echolearn fit survey=<folder>, or robot=<robot.yaml> before there is"),
        (["robot=nowhere.yaml"], "robot=nowhere.yaml: must be a file that describes a robot"),
        (["robot=runs"], "a folder of recordings is survey="),
        (["robot=a.yaml", "survey=runs/survey/walk"], "robot=a.yaml: must be null where survey="),
        (["survey=runs/survey/walk", "within=2"], "within=2: must be two numbers, lowest first"),
        (
            ["survey=runs/survey/walk", "within=[2,1]"],
            "within=[2, 1]: must be two numbers, lowest first",
        ),
        (["survey=runs/survey/walk", "name=other"], "name=other: must be a new name"),
        (["survey=runs/survey/walk", "aim=precision 2"], "aim=precision 2: must name a share"),
    ):
        assert main(["fit", *words]) == 1
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1, error
