"""From a run to a bundle: the same bytes each time, the run that the report chose, and what cannot
be exported."""

import json
import shutil
from collections import defaultdict
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import mean

import numpy as np
import pytest

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.checks import BadValue
from echolearn.cli.main import main
from echolearn.robot import bundle, schema
from echolearn.storage import manifests
from echolearn.training.predictions import load_scorer, validation_rows
from echolearn.training.runs import Run
from world import CLASSIFIERS, coming_second, pack, plans


def content(folder):
    """Return the bytes of every file."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def described(folder):
    """Return what a bundle says about itself."""
    return json.loads((folder / "bundle.json").read_text())


def run_of(world, name):
    """Return a run on the scattered set, seed 0."""
    [folder] = (world.runs / "train").glob(f"{name}-scattered-s0-*")
    return Run(folder, manifests.verify(folder))


def test_a_bundle_is_four_files_with_the_keys_of_the_documentation(packed):
    assert sorted(content(packed)) == ["bundle.json", "golden.npz", "model.onnx", "probe.wav"]
    about = described(packed)
    assert {*about} >= {*schema.TABLE} - {"command"}
    formats = (Path(__file__).parents[2] / "docs" / "formats.md").read_text()
    documented = formats.split("## A bundle")[1]
    assert all(f"`{key}`" in documented for key in about)
    names = [entry["name"] for entry in about["columns"]]
    assert names == CLASSIFIERS["trees_features"]["inputs"]


def test_the_model_is_the_runs_byte_for_byte(world, packed):
    run = run_of(world, "trees_features")
    about = described(packed)
    assert (packed / "model.onnx").read_bytes() == (run.folder / "model.onnx").read_bytes()
    assert about["threshold"]["value"] == run.threshold
    assert about["data"]["digest"] == world.sets["scattered"].digest


def test_figures_are_those_of_the_runs_test_rows_with_intervals_around_them(world, packed):
    held_out = described(packed)["metrics"]["held_out"]
    tested = run_of(world, "trees_features").metrics
    assert held_out["rows"] == tested["rows"]["test"]
    assert set(held_out["figures"]) == set(tested["test"])
    for name, figure in held_out["figures"].items():
        assert figure["value"] == pytest.approx(tested["test"][name], abs=1e-6)
        # What is expected by chance has no interval.
        bare = name == "calibration_error_perfect"
        assert bare == (figure["ci_low"] is None)
        assert bare or figure["ci_low"] - 1e-9 <= figure["ci_high"]
    assert held_out["figures"]["auc"]["ci_low"] < held_out["figures"]["auc"]["value"]


def test_golden_inputs_span_the_confidences_and_end_with_extremes(world, packed):
    x, confidence = bundle.read_bundle(packed).golden
    score = load_scorer(run_of(world, "trees_features").folder)
    assert x.shape == (32, 4) and np.array_equal(confidence, score(x))
    assert (np.diff(confidence[:29]) >= 0).all() and confidence[28] - confidence[0] > 0.2
    largest = np.finfo(np.float32).max
    assert np.array_equal(x[29:], np.outer([0, largest, -largest], np.ones(4)))


def test_the_same_run_gives_the_same_bytes_once_and_a_damaged_bundle_is_mended(
    world, packed, tmp_path
):
    again = partial(pack, world, "trees_features", tmp_path)
    folder = again()
    assert content(folder) == content(packed)
    before = {path.name: path.stat().st_ino for path in folder.iterdir()}
    again()
    assert {path.name: path.stat().st_ino for path in folder.iterdir()} == before
    (folder / "model.onnx").write_bytes(b"torn")
    (folder / ".model.onnx.0123456789ab.tmp").write_bytes(b"left by a killed writer")
    again()
    assert content(folder) == content(packed)
    (folder / "bundle.json").unlink()  # interrupted before the end
    with pytest.raises(BadValue, match="not finished"):
        manifests.verify(folder)
    again()
    assert content(folder) == content(packed)


@pytest.mark.parametrize("classifier", ["svm_pair", "threshold_peak"])
def test_every_kind_of_classifier_travels(classifier, world, tmp_path):
    run = run_of(world, classifier)
    folder = pack(world, classifier, tmp_path, name=None)
    assert folder.name == run.identity and bundle.read_bundle(folder).inputs == run.inputs


def test_the_best_is_the_learned_classifier_with_the_best_validation(world, compared, tmp_path):
    scores = defaultdict(list)
    for path in (world.runs / "train").glob("*-scattered-*/metrics.json"):
        result = json.loads(path.read_text())
        if result["role"] == "learned":
            figure = result["validation"]["balanced_accuracy"]
            scores[result["name"]].append((figure, -result["seed"], result["run"]))
    best = max(sorted(scores), key=lambda name: mean(score[0] for score in scores[name]))
    folder = pack(world, "-", tmp_path, run=None, best=compared)
    about = bundle.read_bundle(folder).about
    assert about["run"] == max(scores[best])[2]
    maps = {(row["tested_on"], row["metric"]) for row in about["metrics"]["maps"]}
    assert ("hall_0dB/gated", "precision") in maps and len(maps) == 12
    assert all(0 <= (row["value"] or 0) <= 1 for row in about["metrics"]["maps"])


def test_what_cannot_be_exported_says_why_and_leaves_nothing(world, compared, tmp_path):
    scene = plans()[0].scene
    folder = run_of(world, "svm_pair").folder
    away = shutil.copytree(folder, tmp_path / "far" / "train" / folder.name)
    grid = world.sets["grid"].folder
    wrote = "must be a folder that echolearn"
    cases = {
        "scene.array=another: must be the array of the run's set; give the scene": {
            "array": circular_array(radius=0.1)
        },
        "scene.probe=another: must be the probe of the run's set": {
            "probe": noise_probe(seed=9, length=6000)
        },
        "scene.probe=another": {"probe": replace(scene.probe, length=scene.probe.length + 1)},
        "not both": {"best": compared},
        "run=None: must be a run's folder, or give best=": {"run": None},
        f"run=.*: {wrote} train wrote": {"run": grid},
        f"best=.*: {wrote} compare wrote": {"run": None, "best": folder},
        f"run=.*: {wrote} train wrote; there is no such folder": {"run": tmp_path / "nowhere"},
        "make it: echolearn generate plan=scattered": {"run": away},
        "name=../up": {"name": "../up"},
    }
    for said, changes in cases.items():
        with pytest.raises(BadValue, match=said):
            pack(world, "svm_pair", tmp_path / "out", **changes)
    assert not (tmp_path / "out").exists()


def test_a_name_in_use_is_refused(world, packed, tmp_path):
    shutil.copytree(packed, tmp_path / "bundles" / "small")
    with pytest.raises(BadValue, match="holds the bundle of trees_features-"):
        pack(world, "svm_pair", tmp_path)
    (tmp_path / "bundles" / "mine").mkdir()
    (tmp_path / "bundles" / "mine" / "thesis.txt").write_text("all of it")
    with pytest.raises(BadValue, match="holds something else"):
        pack(world, "svm_pair", tmp_path, name="mine")


def test_of_two_exports_at_once_the_second_is_refused(world, packed, tmp_path, capfd):
    folder = tmp_path / "bundles" / "small"
    with pytest.raises(BadValue, match="holds the bundle of trees_features-"):
        coming_second(
            lambda: pack(world, "svm_pair", tmp_path),
            folder,
            lambda: shutil.copytree(packed, folder),
            lambda: capfd.readouterr().err,
        )
    assert content(folder) == content(packed)


def test_a_bundle_that_does_not_load_is_not_finished(world, tmp_path, monkeypatch):
    monkeypatch.setitem(schema.LIMITS, "model.onnx", 100)
    with pytest.raises(BadValue, match="at most 100 bytes"):
        pack(world, "svm_pair", tmp_path)
    assert not (tmp_path / "bundles" / "small" / "bundle.json").exists()


def test_the_commands_export_and_verify(world, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    run = run_of(world, "svm_pair")
    words = ["export", f"run={run.folder}", "name=mine", "scene.probe.length=6000", "resamples=30"]
    assert main(words) == 0
    folder = Path("runs/bundles/mine")
    assert capsys.readouterr().out == f"{folder}\n"
    assert main(["verify", str(folder)]) == 0
    assert "whole, 3 files; svm_pair, 32 golden confidences reproduced" in capsys.readouterr().out
    (folder / "probe.wav").write_bytes(b"")
    assert main(["verify", str(folder)]) == 1
    said = capsys.readouterr().err
    assert f"{folder}/probe.wav=damaged" in said
    assert f"run again: echolearn export run={run.folder} name=mine" in said
    assert main(words) == main(["verify", str(folder)]) == 0
    assert main([*words[:2], "name=other"]) == 1
    said = "scene.probe=another: must be the probe of the run's set; give the scene.* overrides"
    assert said in capsys.readouterr().err


def test_a_cut_may_be_chosen_when_a_bundle_is_made(world, packed, tmp_path):
    own = described(packed)
    assert own["threshold"]["chosen"].startswith("largest balanced accuracy on")
    folder = pack(world, "trees_features", tmp_path, aim="retention 0.9")
    about = described(folder)
    assert "retention 0.9 on" in about["threshold"]["chosen"]
    assert about["threshold"]["value"] < own["threshold"]["value"]
    assert (folder / "model.onnx").read_bytes() == (packed / "model.onnx").read_bytes()

    run = run_of(world, "trees_features")
    confidence, y = validation_rows(run, world.sets["scattered"])
    assert len(y) == run.metrics["rows"]["validation"]
    assert (confidence[y] >= about["threshold"]["value"]).mean() >= 0.9
    held_out = [each["metrics"]["held_out"]["figures"] for each in (about, own)]
    assert held_out[0]["auc"] == held_out[1]["auc"]
    assert held_out[0]["recall"]["value"] > held_out[1]["recall"]["value"]

    for aim, said in {"precision 1.2": "must name a share", "more": "must be balanced"}.items():
        with pytest.raises(BadValue, match=f"aim={aim}: {said}"):
            pack(world, "trees_features", tmp_path / "no", aim=aim)
    assert not (tmp_path / "no").exists()


def test_figures_of_maps_are_those_of_the_runs_own_cut_alone(world, compared, tmp_path):
    folder = pack(world, "-", tmp_path, run=None, best=compared, aim="retention 0.99")
    assert described(folder)["metrics"]["maps"] == []
    again = pack(world, "-", tmp_path, run=None, best=compared, aim="balanced")
    assert len(described(again)["metrics"]["maps"]) == 12
