"""From a run to a bundle: the same bytes each time, the run that the report chose, and what cannot
be exported."""

import json
import shutil
from collections import defaultdict
from dataclasses import replace
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
from echolearn.training.predictions import load_scorer
from echolearn.training.runs import Run
from world import World, coming_second, pack, plans


def content(folder: Path) -> dict[str, bytes]:
    """Return the bytes of every file."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def run_of(world: World, name: str) -> Run:
    """Return a run on the scattered set, seed 0."""
    [folder] = (world.runs / "train").glob(f"{name}-scattered-s0-*")
    return Run(folder, manifests.verify(folder))


def test_a_bundle_is_four_files_with_the_keys_of_the_documentation(packed: Path) -> None:
    assert sorted(content(packed)) == ["bundle.json", "golden.npz", "model.onnx", "probe.wav"]
    about = json.loads((packed / "bundle.json").read_text())
    assert {*about} >= {*schema.TABLE} - {"command"}
    documented = (
        (Path(__file__).parents[2] / "docs" / "formats.md").read_text().split("## A bundle")[1]
    )
    assert all(f"`{key}`" in documented for key in about)
    assert [entry["name"] for entry in about["columns"]] == [
        "peak_to_rms",
        "second_to_first",
        "joint",
        "coherence",
    ]


def test_the_model_is_the_runs_byte_for_byte(world: World, packed: Path) -> None:
    run = run_of(world, "trees_features")
    about = json.loads((packed / "bundle.json").read_text())
    assert (packed / "model.onnx").read_bytes() == (run.folder / "model.onnx").read_bytes()
    assert about["threshold"]["value"] == run.threshold
    assert about["data"]["digest"] == world.sets["scattered"].digest


def test_figures_are_those_of_the_runs_test_rows_with_intervals_around_them(
    world: World, packed: Path
) -> None:
    held_out = json.loads((packed / "bundle.json").read_text())["metrics"]["held_out"]
    tested = run_of(world, "trees_features").metrics
    assert held_out["rows"] == tested["rows"]["test"]
    assert set(held_out["figures"]) == set(tested["test"])
    for name, figure in held_out["figures"].items():
        assert figure["value"] == pytest.approx(tested["test"][name], abs=1e-6)
        assert figure["ci_low"] - 1e-9 <= figure["ci_high"]
    assert held_out["figures"]["auc"]["ci_low"] < held_out["figures"]["auc"]["value"]


def test_golden_inputs_span_the_confidences_and_end_with_extremes(
    world: World, packed: Path
) -> None:
    x, confidence = bundle.read_bundle(packed).golden
    assert x.shape == (32, 4) and np.array_equal(
        confidence, load_scorer(run_of(world, "trees_features").folder)(x)
    )
    assert (np.diff(confidence[:29]) >= 0).all() and confidence[28] - confidence[0] > 0.2
    assert (
        (x[29] == 0).all() and (x[30] == np.finfo(np.float32).max).all() and (x[31] == -x[30]).all()
    )


def test_the_same_run_gives_the_same_bytes(world: World, packed: Path, tmp_path: Path) -> None:
    assert content(pack(world, "trees_features", tmp_path)) == content(packed)


def test_a_finished_bundle_is_left_alone_and_a_damaged_one_mended(
    world: World, packed: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(packed, tmp_path / "bundles" / "small")
    before = {path.name: path.stat().st_ino for path in folder.iterdir()}
    pack(world, "trees_features", tmp_path)
    assert {path.name: path.stat().st_ino for path in folder.iterdir()} == before
    (folder / "model.onnx").write_bytes(b"torn")
    (folder / ".model.onnx.0123.tmp").write_bytes(b"left by a killed writer")
    pack(world, "trees_features", tmp_path)
    assert content(folder) == content(packed)
    (folder / "bundle.json").unlink()  # interrupted before the end
    with pytest.raises(BadValue, match="not finished"):
        manifests.verify(folder)
    pack(world, "trees_features", tmp_path)
    assert content(folder) == content(packed)


@pytest.mark.parametrize("classifier", ["svm_pair", "threshold_peak"])
def test_every_kind_of_classifier_travels(classifier: str, world: World, tmp_path: Path) -> None:
    folder = pack(world, classifier, tmp_path, name=None)
    assert folder.name == run_of(world, classifier).identity
    assert bundle.read_bundle(folder).inputs == run_of(world, classifier).inputs


def test_the_best_is_the_learned_classifier_with_the_best_validation(
    world: World, compared: Path, tmp_path: Path
) -> None:
    scores = defaultdict(list)
    for path in (world.runs / "train").glob("*-scattered-*/metrics.json"):
        result = json.loads(path.read_text())
        scores[result["name"]].append(
            (result["validation"]["balanced_accuracy"], -result["seed"], result["run"])
        )
    learned = {
        name: mean(score[0] for score in found)
        for name, found in scores.items()
        if "threshold" not in name
    }
    best = max(sorted(learned), key=lambda name: learned[name])
    folder = pack(world, "-", tmp_path, run=None, best=compared)
    about = bundle.read_bundle(folder).about
    assert about["run"] == max(scores[best])[2]
    maps = {(row["tested_on"], row["metric"]) for row in about["metrics"]["maps"]}
    assert ("hall_0dB/gated", "precision") in maps and len(maps) == 12
    assert all(
        0 <= row["value"] <= 1 for row in about["metrics"]["maps"] if row["value"] is not None
    )


def test_what_cannot_be_exported_says_why_and_leaves_nothing(
    world: World, compared: Path, tmp_path: Path
) -> None:
    scene = plans()[0].scene
    [folder] = (world.runs / "train").glob("svm_pair-scattered-s0-*")
    away = shutil.copytree(folder, tmp_path / "far" / "train" / folder.name)
    longer = replace(scene.probe, length=scene.probe.length + 1)
    cases = {
        "scene.array=another: must be the array of the run's set; give the scene": {
            "array": circular_array(radius=0.1)
        },
        "scene.probe=another: must be the probe of the run's set": {
            "probe": noise_probe(seed=9, length=6000)
        },
        "scene.probe=another": {"probe": longer},
        "not both": {"best": compared},
        "run=None: must be a run's folder, or give best=": {"run": None},
        "run=.*: must be a folder that echolearn train wrote": {"run": world.sets["grid"].folder},
        "best=.*: must be a folder that echolearn compare wrote": {"run": None, "best": folder},
        "run=.*: must be a folder that echolearn train wrote; there is no such folder": {
            "run": tmp_path / "nowhere"
        },
        "make it: echolearn generate plan=scattered": {"run": away},
        "name=../up": {"name": "../up"},
    }
    for said, changes in cases.items():
        with pytest.raises(BadValue, match=said):
            pack(world, "svm_pair", tmp_path / "out", **changes)
    assert not (tmp_path / "out").exists()


def test_a_name_in_use_is_refused(world: World, packed: Path, tmp_path: Path) -> None:
    shutil.copytree(packed, tmp_path / "bundles" / "small")
    with pytest.raises(BadValue, match="holds the bundle of trees_features-"):
        pack(world, "svm_pair", tmp_path)
    (tmp_path / "bundles" / "mine").mkdir()
    (tmp_path / "bundles" / "mine" / "thesis.txt").write_text("all of it")
    with pytest.raises(BadValue, match="holds something else"):
        pack(world, "svm_pair", tmp_path, name="mine")


def test_of_two_exports_at_once_the_second_is_refused(
    world: World, packed: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "bundles" / "small"
    with pytest.raises(BadValue, match="holds the bundle of trees_features-"):
        coming_second(
            lambda: pack(world, "svm_pair", tmp_path),
            folder,
            lambda: shutil.copytree(packed, folder),
            lambda: capfd.readouterr().err,
        )
    assert content(folder) == content(packed)


def test_a_bundle_that_does_not_load_is_not_finished(
    world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(schema.LIMITS, "model.onnx", 100)
    with pytest.raises(BadValue, match="at most 100 bytes"):
        pack(world, "svm_pair", tmp_path)
    assert not (tmp_path / "bundles" / "small" / "bundle.json").exists()


def test_the_commands_export_and_verify(
    world: World,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
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
    assert (
        f"{folder}/probe.wav=damaged" in said
        and f"run again: echolearn export run={run.folder} name=mine" in said
    )
    assert main(words) == 0
    assert main(["verify", str(folder)]) == 0
    assert main([*words[:2], "name=other"]) == 1
    assert (
        "scene.probe=another: must be the probe of the run's set; give the scene.* overrides"
        in capsys.readouterr().err
    )
