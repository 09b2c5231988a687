"""Bundles by name: the user's own before those that come along."""

import json
from pathlib import Path

import pytest

from echolearn.acoustics.geometry import circular_array
from echolearn.checks import BadValue
from echolearn.cli.main import main
from echolearn.robot import shipped
from echolearn.robot.compatibility import mount_angle
from echolearn.robot.scorer import load
from echolearn.robot.shipped import find_bundle

ROOT = Path(__file__).parents[2]
SHORT = ROOT / "examples" / "survey" / "short"
POINT = shipped.FOLDER / "point"


@pytest.fixture
def runs(tmp_path, monkeypatch):
    """Return a folder of everything generated with a bundle `mine`, beside one called `theirs`."""
    for place in ("runs/bundles/mine", "along/theirs", "along/mine", "here"):
        (tmp_path / place).mkdir(parents=True)
        (tmp_path / place / "bundle.json").write_text('{"sha256": "0"}')
    (tmp_path / "torn").mkdir()
    monkeypatch.setattr(shipped, "FOLDER", tmp_path / "along")
    monkeypatch.chdir(tmp_path)
    shipped.digests.cache_clear()
    yield tmp_path / "runs"
    shipped.digests.cache_clear()


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ("mine", "runs/bundles/mine"),
        ("theirs", "along/theirs"),
        ("here", "here"),
        ("along/mine", "along/mine"),
        ("./nothing", "nothing"),
        ("torn", "torn"),
    ],
)
def test_a_name_is_of_ones_own_bundle_then_of_one_that_comes_along(runs, given, found):
    assert find_bundle(given, runs).resolve() == (runs.parent / found).resolve()


def test_a_name_that_no_bundle_has_is_told_with_those_there_are(runs):
    said = "bundle=thiers: must be a folder that echolearn export wrote, or the name of a bundle; "
    with pytest.raises(BadValue, match=f"{said}did you mean theirs"):
        find_bundle("thiers", runs)
    with pytest.raises(BadValue, match="known are mine, theirs"):
        find_bundle("x", runs)


@pytest.mark.parametrize(("name", "label"), [("point", "on_map"), ("walk", "is_wall")])
class TestBoth:
    """The bundles that come along."""

    def test_is_small_and_needs_no_examination(self, name, label, capfd):
        folder = find_bundle(name, Path("runs"))
        assert sum(path.stat().st_size for path in folder.iterdir()) < 1 << 20
        scorer = load(folder)
        assert capfd.readouterr().err == ""
        about = scorer.bundle.about
        assert (about["name"], about["label"]["name"]) == (name, label)
        # Of nobody's machine.
        assert "=/" not in about["command"]

    def test_its_card_is_about_it(self, name, label):
        about = json.loads((shipped.FOLDER / name / "bundle.json").read_text())
        page = (ROOT / "docs" / "cards" / f"{name}.md").read_text()
        told = about["data"]["digest"], about["files"]["model.onnx"]["sha256"]
        assert all(each in page for each in (*told, about["threshold"]["chosen"]))


class TestPoint:
    """The one that judges echoes."""

    def test_maps_a_walk_from_anywhere_and_is_what_map_takes(self, tmp_path, monkeypatch, capfd):
        monkeypatch.chdir(tmp_path)
        assert main(["map", f"survey={SHORT}"]) == 0
        said = capfd.readouterr()
        assert "examined" not in said.err and "maps/short-point" in said.out
        told = json.loads(Path("runs/maps/short-point/manifest.json").read_text())
        assert told["inputs"]["bundle"] == shipped.digests()["point"]

    def test_another_array_is_told_for_which_it_was_made_and_what_to_do(self):
        bundle = load(POINT).bundle
        for array in (circular_array(microphones=4), circular_array(radius=0.1)):
            with pytest.raises(BadValue, match="^microphones=") as refused:
                mount_angle(bundle, array=array, probe=bundle.probe)
            said = str(refused.value)
            made = "point was made for 6 microphones, the farthest 200 mm from the loudspeaker: "
            assert f"{made}for this array train one (docs/arrays.md)" in said
            assert "\n" not in said
