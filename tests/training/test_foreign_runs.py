"""Runs from elsewhere: models are examined like those of bundles before anything is computed."""

import json
from shutil import copytree

import numpy as np
import pytest

from bundle_mutants import BUNDLES
from echolearn.checks import BadValue
from echolearn.comparison.compare import compare
from echolearn.robot.model import try_run
from echolearn.storage import manifests
from echolearn.storage.files import json_bytes, sha256
from echolearn.training.predictions import load_scorer
from echolearn.training.runs import finished_runs, read_run

REFUSED = (
    "model external",
    "model of a custom domain",
    "model of many nodes",
    "model of text",
    "model of an unknown operator",
    "model with a function",
    "model with a loop",
    "model with a text",
    "model of NaN",
    "model without output",
)


@pytest.fixture
def foreign(world, packed, tmp_path, monkeypatch):
    """Return a function that gives a run as another machine has made it, with another model."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    [made] = (world.runs / "train").glob("trees_features-scattered-s0-*")

    def copied(mutation="", runs=tmp_path):
        folder = copytree(made, runs / "train" / made.name)
        if mutation:
            bundle = copytree(packed, tmp_path / "bundle")
            BUNDLES[mutation][0](bundle)
            (folder / "model.onnx").write_bytes((bundle / "model.onnx").read_bytes())
        about = json.loads((folder / "metrics.json").read_text())
        model = folder / "model.onnx"
        about["files"]["model.onnx"] = {"bytes": model.stat().st_size, "sha256": sha256(model)}
        (folder / "metrics.json").write_bytes(json_bytes(manifests.with_checksum(about)))
        return folder

    return copied


def test_a_run_from_elsewhere_is_examined_once_and_predicts_the_same(
    world, foreign, capsys, monkeypatch, shared
):
    folder = foreign()
    x = np.random.default_rng(0).standard_normal((2000, 4))
    found = load_scorer(folder)(x)
    said = capsys.readouterr().err
    assert said.startswith(f"run {folder.name}: from elsewhere; examined in ")
    assert said.count("\n") == 1
    load_scorer(folder)
    assert capsys.readouterr().err == ""
    # The same run, as one that was made here.
    monkeypatch.setenv("XDG_STATE_HOME", str(shared / "state"))
    assert np.array_equal(load_scorer(folder)(x), found)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("mutation", REFUSED)
def test_a_hostile_model_of_a_run_is_refused(mutation, foreign):
    folder = foreign(mutation)
    with pytest.raises(BadValue, match=f"^{folder}/model.onnx"):
        try_run(folder)


def test_a_model_that_never_ends_stops_a_comparison_before_any_work(world, foreign, tmp_path):
    folder = foreign("model that never ends")
    for part in ("data", "survey"):
        (tmp_path / part).symlink_to(world.runs / part)
    with pytest.raises(BadValue, match=f"^{folder}.*cannot be computed"):
        compare(name="bad", **world.arguments | {"runs": tmp_path})
    assert not (tmp_path / "compare").exists()


def test_a_run_whose_metrics_name_no_model_is_refused(foreign):
    folder = foreign()
    about = json.loads((folder / "metrics.json").read_text())
    about["files"].pop("model.onnx")
    (folder / "metrics.json").write_bytes(json_bytes(manifests.with_checksum(about)))
    with pytest.raises(BadValue, match="model.onnx=no operators: must be an ONNX model"):
        load_scorer(folder)


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("name", ..., "name=missing: must be a mapping with run, name, plan"),
        ("name", "\x1b[2J", "name=\\x1b[2J: must be a name"),
        ("plan", [1], "plan=[1]: must be a name"),
        ("role", "os.system", "role=os.system: must be baseline or learned"),
        ("seed", "0", "seed=0: must be a whole number"),
        ("seed", 10**300, "seed=1000"),
        ("inputs", "power", "inputs=power: must be a list"),
        ("inputs", [], "inputs=[]: must be some of toa, "),
        ("inputs", [["power"]], "inputs=[['power']]: must be some of toa, "),
        ("inputs", ["power"] * 99_999, "inputs=['power', 'power'"),
        ("threshold", None, "threshold=None: must be a number"),
        ("target", "nope", "target=nope: must be reflector or on_map"),
        ("test_share", 5, "test_share=5: must be a number"),
        ("model", None, "model=None: must be a mapping"),
        ("data", {"a": 1}, "data="),
    ],
)
def test_metrics_that_no_run_has_are_refused(key, value, said, foreign, tmp_path):
    folder = foreign()
    about = json.loads((folder / "metrics.json").read_text())
    about = {k: v for k, v in (about | {key: value}).items() if v is not ...}
    (folder / "metrics.json").write_bytes(json_bytes(manifests.with_checksum(about)))
    for read in (lambda: read_run(folder), lambda: list(finished_runs(tmp_path))):
        with pytest.raises(BadValue) as refused:
            read()
        assert str(refused.value).startswith(f"{folder}/metrics.json {said}")
        assert len(str(refused.value).removeprefix(str(folder))) < 1000
