"""A folder under `runs` is found by its path, its name, or a beginning that no other name has."""

import pytest

from echolearn.checks import BadValue
from echolearn.storage.named import all_named, folder_named


@pytest.fixture(autouse=True)
def runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("svm-a-s0-01", "svm-a-s1-02", "svm-b-s0-03", "unfinished"):
        (tmp_path / "runs" / "train" / name).mkdir(parents=True)
        if name != "unfinished":
            (tmp_path / "runs" / "train" / name / "metrics.json").touch()
    (tmp_path / "runs" / "bundles" / "svm-b-s0-03").mkdir(parents=True)
    (tmp_path / "svm-a-s1").mkdir()
    return tmp_path / "runs"


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ("svm-b-s0-03", "runs/train/svm-b-s0-03"),
        ("svm-b", "runs/train/svm-b-s0-03"),
        ("svm-a-s0", "runs/train/svm-a-s0-01"),
        # A folder here that is no run does not hide one.
        ("svm-a-s1", "runs/train/svm-a-s1-02"),
        ("runs/train/svm-a-s0-01/", "runs/train/svm-a-s0-01"),
        ("unfinished", "runs/train/unfinished"),
        ("svm", None),
        ("nothing", "nothing"),
        ("else/nothing", "else/nothing"),
        ("sv*", "sv*"),
    ],
)
def test_a_name_or_a_path(given, expected, runs):
    place = runs.relative_to(runs.parent)
    if expected is None:
        with pytest.raises(BadValue, match=r"^run=svm: must be the beginning of one name; there "):
            folder_named(given, "train", runs=place, key="run")
    else:
        assert f"{folder_named(given, 'train', runs=place, key='run')}" == expected


def test_what_is_here_is_nearer_than_what_has_its_name(runs):
    (runs.parent / "svm-a-s1" / "metrics.json").touch()
    assert f"{folder_named('svm-a-s1', 'train', runs=runs)}" == "svm-a-s1"


@pytest.mark.parametrize(
    ("given", "found"),
    [
        ("svm-b-s0-03", ["runs/bundles/svm-b-s0-03", "runs/train/svm-b-s0-03"]),
        ("svm-a-s1", ["svm-a-s1"]),
        ("nothing", ["nothing"]),
        ("", [""]),
    ],
)
def test_every_folder_of_a_name_is_found(given, found, runs):
    assert all_named(given, runs=runs.relative_to(runs.parent)) == found
