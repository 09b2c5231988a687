"""Bundles by name: the user's own before those that come along."""

import pytest

from echolearn.checks import BadValue
from echolearn.robot import shipped
from echolearn.robot.shipped import find_bundle


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
    with pytest.raises(BadValue, match=f"{said}known are mine, theirs"):
        find_bundle("thiers", runs)
