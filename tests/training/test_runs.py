"""Finished runs read back: which of them count, and what they predict about whom."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from echolearn.checks import BadValue
from echolearn.classifiers.operating_point import best_threshold
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation import metrics
from echolearn.evaluation.rows import Recordings
from echolearn.storage import manifests
from echolearn.training.predictions import (
    held_out_rows,
    label_rows,
    predict,
    predict_echoes,
    predict_rows,
)
from echolearn.training.runs import Run, load_runs, read_run
from echolearn.training.split import LearningProblem
from world import TRAINED


@pytest.fixture(scope="module")
def runs(world):
    return load_runs(world.runs)


@pytest.fixture(scope="module")
def pick(runs):
    """Return the one run of a classifier, set and seed."""

    known = {(run.model.classifier, run.model.trained_on, run.seed): run for run in runs}
    return lambda classifier, plan, seed=0: known[classifier, plan, seed]


def copied(run, runs, *, name="", **changes):
    """Copy a run into another folder of runs, with other metrics; None takes one away."""
    folder = Path(shutil.copytree(run.folder, runs / "train" / (name or run.identity)))
    about = {k: v for k, v in {**run.metrics, **changes}.items() if v is not None}
    manifests.finish(folder, about, files=list(about["files"]), last=manifests.METRICS)
    return folder


def test_every_finished_run_is_found_in_order(runs):
    found = [(run.model.classifier, run.model.trained_on, run.seed) for run in runs]
    expected = {(name, plan, seed) for plan, seed, names in TRAINED for name in names}
    assert set(found) == expected and len(found) == len(expected)
    assert [run.identity for run in runs] == sorted(run.identity for run in runs)


def test_what_a_run_is_stands_in_its_metrics(runs):
    assert {(run.model.classifier, *run.model[2:]) for run in runs} == {
        ("svm_pair", "learned", "svm", "position", "reflector", "", ""),
        ("threshold_peak", "baseline", "threshold", "position", "reflector", "", ""),
        ("trees_features", "learned", "trees", "position", "reflector", "", ""),
    }


def test_only_finished_runs_count_whose_set_is_there(world, runs, pick, tmp_path):
    grid = world.sets["grid"].folder
    shutil.copytree(grid, tmp_path / "data" / grid.name)
    kept = copied(pick("svm_pair", "grid"), tmp_path)
    copied(pick("svm_pair", "scattered"), tmp_path)
    (copied(pick("threshold_peak", "grid"), tmp_path) / manifests.METRICS).unlink()
    assert [run.folder for run in load_runs(tmp_path)] == [kept]
    assert load_runs(tmp_path / "nowhere") == []


def test_a_renamed_run_is_refused(world, pick, tmp_path):
    """It would pass for one of other settings."""
    shutil.copytree(world.runs / "data", tmp_path / "data")
    run = pick("svm_pair", "grid")
    copied(run, tmp_path, name="a")
    with pytest.raises(BadValue, match=f"must be a folder called {run.identity}; was it renamed"):
        load_runs(tmp_path)


def test_a_run_of_another_version_is_left_out_and_refused_by_name(world, runs, tmp_path, capsys):
    """Runs of version 0.1 have no `format`."""
    shutil.copytree(world.runs / "data", tmp_path / "data")
    kept = copied(runs[0], tmp_path)
    old = copied(runs[1], tmp_path, format=None)
    later = copied(runs[2], tmp_path, format=99)
    assert [run.folder for run in load_runs(tmp_path)] == [kept]
    assert capsys.readouterr().err.splitlines() == [
        f"run={old}: made by echolearn 0.1, left out: train it again",
        f"run={later}: made by another version of echolearn (format 99), left out: train it again",
    ]
    with pytest.raises(BadValue, match=f"^run={old}: made by echolearn 0.1: train it again$"):
        read_run(old)


def test_on_its_own_set_a_run_predicts_held_out_rows_as_it_did_in_training(world, runs):
    for run in runs:
        dataset = world.sets[run.model.trained_on]
        parts = LearningProblem(dataset, seed=run.seed).parts()
        found = predict_rows(run, dataset)
        assert np.array_equal(found.rows, parts.test)
        assert not {*dataset["group"][found.rows]} & {*dataset["group"][parts.train]}
        assert (found.seed, found.threshold) == (run.seed, run.metrics["threshold"])
        # What is chosen, is chosen on the validation part; the test part is looked at once.
        known = {name: dataset[name][parts.validation] for name in run.inputs}
        cut = best_threshold(predict(run, known), dataset["reflector"][parts.validation])
        assert run.threshold == pytest.approx(cut, abs=1e-4)
        again = metrics.evaluate_labels(
            dataset["reflector"][found.rows], found.confidence, threshold=found.threshold
        )
        for metric in ("auc", "balanced_accuracy", "expected_calibration_error"):
            assert again[metric] == pytest.approx(run.metrics["test"][metric], abs=1e-5)


@pytest.mark.parametrize("share", [0.2, 0.4])
def test_held_out_rows_of_the_leaky_split_are_rows(world, share):
    dataset = world.sets["scattered"]
    leaky = Run(Path(), {"split": "row", "test_share": share, "seed": 5})
    problem = LearningProblem(dataset, seed=5, split="row", test_share=share)
    assert np.array_equal(held_out_rows(leaky, dataset), problem.parts().test)


def test_elsewhere_it_predicts_every_row_or_those_that_others_held_out(world, pick, tmp_path):
    """Seed by seed the same rows for everyone; what counts is the digest of the data."""
    dataset = world.sets["scattered"]
    stranger = pick("svm_pair", "grid")
    everything = predict_rows(stranger, dataset)
    assert np.array_equal(everything.rows, np.arange(len(dataset)))
    some = predict_rows(stranger, dataset, held_out=True)
    assert np.array_equal(some.rows, predict_rows(pick("svm_pair", "scattered"), dataset).rows)
    assert np.array_equal(everything.confidence[some.rows], some.confidence)
    namesake = Dataset(world.sets["grid"].folder)
    namesake.digest = "another"
    assert len(predict_rows(stranger, namesake).rows) == len(namesake)


def test_inputs_are_stacked_in_the_runs_order(world, pick):
    run = pick("svm_pair", "scattered")
    dataset = world.sets["offgrid_hall"]
    columns = {name: dataset[name] for name in ("power", "score", "toa")}
    expected = predict_rows(run, dataset).confidence
    assert np.array_equal(predict(run, columns), expected)
    swapped = columns | {"toa": dataset["power"], "power": dataset["toa"]}
    assert not np.allclose(predict(run, swapped), expected)


def test_every_echo_of_a_survey_is_predicted(comparison, pick):
    survey = comparison.surveys["hall_0dB", "gated"]
    run = pick("threshold_peak", "scattered", 1)
    found = predict_echoes(run, survey)
    assert np.array_equal(found.rows, np.arange(len(survey.points)))
    assert (found.seed, found.threshold) == (1, run.threshold)
    # A threshold orders echoes as its column does.
    assert np.array_equal(np.argsort(found.confidence), np.argsort(survey.columns["peak_to_rms"]))


def test_rows_are_labelled_as_the_paper_does(world):
    dataset = world.sets["scattered"]
    labelled = label_rows(dataset, resamples=7)
    assert np.array_equal(labelled.reference, dataset["reflector"])
    assert np.array_equal(labelled.groups, dataset["group"])
    assert np.array_equal(labelled.joint_snr_db, dataset["snr_db"])
    assert labelled.weights.shape == (7, len(dataset))
    assert labelled.source == Recordings("scattered", "set", "white", "training")


@pytest.mark.parametrize("name", ["model.onnx", "metrics.json"])
def test_a_damaged_run_predicts_nothing(world, pick, tmp_path, name):
    run = pick("threshold_peak", "grid")
    copy = Run(copied(run, tmp_path), run.metrics)
    content = bytearray((copy.folder / name).read_bytes())
    content[len(content) // 2] ^= 1
    (copy.folder / name).write_bytes(bytes(content))
    with pytest.raises(BadValue, match=f"{name}: (damaged|cannot be read)"):
        predict_rows(copy, world.sets["grid"])
