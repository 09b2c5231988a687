"""A folder of another kind, or a name that leads elsewhere, is told with the next step."""

import pytest

from echolearn.checks import BadValue
from echolearn.storage.kinds import KINDS, check_kind, elsewhere, folder_kind
from echolearn.storage.manifests import BUNDLE, MANIFEST, METRICS, finish

MADE = {
    "bundle": ("bundles/b", BUNDLE),
    "run": ("train/r-s0-01", METRICS),
    "survey": ("survey/walk", "survey.yaml"),
    "set": ("data/walk-0123456789ab", MANIFEST),
    "comparison": ("compare/paper", MANIFEST),
    "map": ("maps/m", MANIFEST),
}


@pytest.fixture(autouse=True)
def runs(tmp_path, monkeypatch):
    """Return a folder with one finished folder of each of `MADE`."""
    monkeypatch.chdir(tmp_path)
    for kind, (name, mark) in MADE.items():
        folder = tmp_path / "runs" / name
        folder.mkdir(parents=True)
        if mark == MANIFEST:
            finish(folder, {"kind": kind}, files=[])
        else:
            (folder / mark).touch()
    (tmp_path / "field" / "day" / "hall").mkdir(parents=True)
    (tmp_path / "field" / "day" / "hall" / "survey.yaml").touch()
    return (tmp_path / "runs").relative_to(tmp_path)


@pytest.mark.parametrize("kind", MADE)
def test_a_kind_is_known_by_what_is_in_a_folder(kind, runs):
    folder = runs / MADE[kind][0]
    assert folder_kind(folder) == kind
    check_kind("key", folder, wanted=kind, allowed="must be so")
    assert folder_kind(runs) == ""
    check_kind("key", runs, wanted=kind, allowed="what says nothing is refused by its reader")


@pytest.mark.parametrize(
    ("found", "wanted", "said"),
    [
        ("run", "bundle", "a trained run; export makes a bundle of it: echolearn export run={}"),
        ("comparison", "bundle", "a comparison; export makes a bundle of its best: echolearn "),
        ("comparison", "run", "a comparison; did you mean best={}?"),
        ("survey", "set", "a recorded survey; label makes a set of it: echolearn label survey={}"),
        ("bundle", "survey", "a bundle; did you swap survey and bundle?"),
        ("map", "run", "a map"),
    ],
)
def test_another_kind_is_told_with_the_step_that_leads_on(found, wanted, said, runs):
    folder = runs / MADE[found][0]
    with pytest.raises(BadValue) as error:
        check_kind("key", folder, wanted=wanted, allowed="must be so")
    assert str(error.value).startswith(f"key={folder}: must be so; it is {said.format(folder)}")


@pytest.mark.parametrize(
    ("name", "wanted", "said"),
    [
        ("hall", "survey", "is it field/day/hall?"),
        ("r-s0", "bundle", "runs/train/r-s0-01: it is a trained run; export makes"),
        ("walk", "set", "runs/survey/walk: it is a recorded survey; label makes"),
        # What has a plan's name by chance leads to no set.
        ("paper", "set", ""),
        ("paper", "run", "runs/compare/paper: it is a comparison; did you mean best="),
        ("day", "survey", ""),
        ("field/day", "survey", ""),
        ("", "survey", ""),
    ],
)
def test_a_name_that_is_not_there_may_lead_elsewhere(name, wanted, said, runs):
    found = elsewhere(name, wanted=wanted, runs=runs)
    assert found.startswith(said) and bool(found) == bool(said)


def test_every_kind_has_a_place_of_its_own_but_sets():
    places = [kind.place for name, kind in KINDS.items() if name != "walks"]
    assert len({*places}) == len(places)
