"""Finished runs read back: which of them count, what they held out, and that they answer as they
did when trained."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from echolearn.checks import BadValue
from echolearn.comparison.choice import Comparison
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation import metrics
from echolearn.evaluation.rows import Recordings
from echolearn.storage import manifests
from echolearn.training.runs import (
    Run,
    label_rows,
    load_runs,
    predict_echoes,
    predict_rows,
    read_run,
)
from echolearn.training.split import Task
from world import TRAINED, World

@pytest.fixture(scope="module")
def runs(world: World) -> list[Run]:
    return load_runs(world.runs)


def called(runs: list[Run], classifier: str, trained_on: str, seed: int) -> Run:
    """Return the one run of that classifier, set and seed."""
    [run] = [
        r for r in runs if (r.classifier, r.trained_on, r.seed) == (classifier, trained_on, seed)
    ]
    return run


def test_every_finished_run_is_found_in_order(runs: list[Run]) -> None:
    expected = {(name, plan, seed) for plan, seed, names in TRAINED for name in names}
    assert {(run.classifier, run.trained_on, run.seed) for run in runs} == expected
    assert [run.identity for run in runs] == sorted(run.identity for run in runs)
    assert len(runs) == len(expected)


def test_unfinished_runs_do_not_count(world: World, runs: list[Run], tmp_path: Path) -> None:
    shutil.copytree(world.runs / "data", tmp_path / "data")
    shutil.copytree(runs[0].folder, tmp_path / "train" / runs[0].identity)
    shutil.copytree(runs[1].folder, tmp_path / "train" / runs[1].identity)
    (tmp_path / "train" / runs[1].identity / "metrics.json").unlink()
    assert [run.identity for run in load_runs(tmp_path)] == [runs[0].identity]


def test_runs_whose_set_is_gone_do_not_count(world: World, tmp_path: Path) -> None:
    shutil.copytree(world.runs / "train", tmp_path / "train")
    grid = world.sets["grid"].folder
    shutil.copytree(grid, tmp_path / "data" / grid.name)
    assert {run.trained_on for run in load_runs(tmp_path)} == {"grid"}
    assert load_runs(tmp_path / "nowhere") == []


def test_two_runs_of_one_name_are_not_averaged(
    world: World, runs: list[Run], tmp_path: Path
) -> None:
    """A classifier with other settings, or an outdated one, would pass for another seed."""
    grid = world.sets["grid"].folder
    shutil.copytree(grid, tmp_path / "data" / grid.name)
    for digest in ("0123456789ab", "ba9876543210"):
        shutil.copytree(
            called(runs, "svm_pair", "grid", 0).folder,
            tmp_path / "train" / f"svm_pair-grid-s0-{digest}",
        )
    with pytest.raises(
        BadValue,
        match=r"^runs=svm_pair-grid-s0-0123456789ab, svm_pair-grid-s0-ba9876543210: one run",
    ):
        load_runs(tmp_path)


def test_held_out_rows_are_those_of_the_task(world: World, runs: list[Run]) -> None:
    for run in runs:
        dataset = world.sets[run.trained_on]
        parts = Task(dataset, seed=run.seed).parts()
        assert np.array_equal(run.held_out(dataset), parts.test)
        assert not set(dataset["group"][run.held_out(dataset)]) & set(dataset["group"][parts.train])


def test_held_out_rows_of_the_leaky_split_are_rows(world: World) -> None:
    for share in (0.2, 0.4):
        leaky = Run(Path(), {"split": "row", "test_share": share, "seed": 5})
        expected = Task(world.sets["scattered"], seed=5, split="row", test_share=share).parts().test
        assert np.array_equal(leaky.held_out(world.sets["scattered"]), expected)


def test_on_its_own_set_a_run_answers_about_held_out_rows_as_it_did_in_training(
    world: World, runs: list[Run]
) -> None:
    for run in runs:
        dataset = world.sets[run.trained_on]
        given = predict_rows(run, dataset)
        assert given.seed == run.seed and given.threshold == run.metrics["threshold"]
        assert np.array_equal(given.rows, Task(dataset, seed=run.seed).parts().test)
        again = metrics.evaluate_labels(
            dataset["reflector"][given.rows], given.confidence, threshold=given.threshold
        )
        for metric in ("auc", "balanced_accuracy", "expected_calibration_error"):
            assert again[metric] == pytest.approx(run.metrics["test"][metric], abs=1e-5)


def test_elsewhere_it_answers_about_every_row(world: World, runs: list[Run]) -> None:
    dataset = world.sets["offgrid_hall"]
    given = predict_rows(called(runs, "svm_pair", "scattered", 1), dataset)
    assert np.array_equal(given.rows, np.arange(len(dataset)))
    assert ((given.confidence >= 0) & (given.confidence <= 1)).all()


def test_among_others_who_studied_a_set_it_answers_about_what_they_held_out(
    world: World, runs: list[Run]
) -> None:
    """Seed by seed the same rows for everyone."""
    dataset = world.sets["scattered"]
    stranger, student = (
        called(runs, "svm_pair", "grid", 0),
        called(runs, "svm_pair", "scattered", 0),
    )
    rows = [predict_rows(run, dataset, held_out=True).rows for run in (stranger, student)]
    assert np.array_equal(*rows) and len(rows[0]) == 28
    everything = predict_rows(stranger, dataset)
    assert np.array_equal(
        everything.confidence[rows[0]], predict_rows(stranger, dataset, held_out=True).confidence
    )


def test_another_set_of_the_same_name_is_another_set(
    world: World, runs: list[Run], tmp_path: Path
) -> None:
    """What counts is the digest of the data."""
    copy = Dataset(shutil.copytree(world.sets["grid"].folder, tmp_path / "copy"))
    copy.digest = "another"
    assert len(predict_rows(called(runs, "svm_pair", "grid", 0), copy).rows) == len(copy)


def test_a_threshold_orders_rows_as_its_column_does(world: World, runs: list[Run]) -> None:
    run, dataset = called(runs, "threshold_peak", "scattered", 0), world.sets["offgrid_hall"]
    by_column, by_confidence = (
        np.argsort(dataset["peak_to_rms"]),
        np.argsort(predict_rows(run, dataset).confidence),
    )
    assert np.array_equal(by_column, by_confidence)


def test_inputs_are_stacked_in_the_runs_order(world: World, runs: list[Run]) -> None:
    run, dataset = called(runs, "svm_pair", "scattered", 0), world.sets["offgrid_hall"]
    columns = {name: dataset[name] for name in ("power", "score", "toa")}
    swapped = columns | {"toa": dataset["power"], "power": dataset["toa"]}
    expected = predict_rows(run, dataset).confidence
    assert np.array_equal(run.confidence(columns), expected)
    assert not np.allclose(run.confidence(swapped), expected)


def test_every_echo_of_a_walk_is_answered(comparison: Comparison, runs: list[Run]) -> None:
    heard = comparison.surveys["hall_0dB", "gated"]
    run = called(runs, "threshold_peak", "scattered", 1)
    given = predict_echoes(run, heard)
    assert np.array_equal(given.rows, np.arange(len(heard.points)))
    assert np.array_equal(np.argsort(given.confidence), np.argsort(heard.columns["peak_to_rms"]))
    assert (given.seed, given.threshold) == (1, run.threshold)


def test_rows_are_labelled_as_the_paper_does(world: World) -> None:
    dataset = world.sets["scattered"]
    labelled = label_rows(dataset, resamples=7)
    assert np.array_equal(labelled.reference, dataset["reflector"])
    assert np.array_equal(labelled.groups, dataset["group"])
    assert np.array_equal(labelled.joint_snr_db, dataset["snr_db"])
    assert labelled.weights.shape == (7, len(dataset))
    assert labelled.source == Recordings("scattered", "set", "white", "training")


@pytest.mark.parametrize("name", ["model.onnx", "metrics.json"])
def test_a_damaged_run_answers_nothing(
    world: World, runs: list[Run], tmp_path: Path, name: str
) -> None:
    run = called(runs, "threshold_peak", "grid", 0)
    copy = Run(shutil.copytree(run.folder, tmp_path / run.identity), run.metrics)
    content = bytearray((copy.folder / name).read_bytes())
    content[len(content) // 2] ^= 1
    (copy.folder / name).write_bytes(bytes(content))
    with pytest.raises(BadValue, match=f"{name}: (damaged|cannot be read)"):
        predict_rows(copy, world.sets["grid"])


def test_a_run_of_before_is_left_out_and_refused_by_name(
    world: World, runs: list[Run], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Runs of version 0.1 have no `format`."""
    shutil.copytree(world.runs / "data", tmp_path / "data")
    kept, old, later = (
        Path(shutil.copytree(run.folder, tmp_path / "train" / run.identity)) for run in runs[:3]
    )
    for folder, number in ((old, {}), (later, {"format": 99})):
        about = {k: v for k, v in manifests.verify(folder).items() if k != "format"} | number
        manifests.finish(folder, about, list(about["files"]), last=manifests.METRICS)
    assert [run.folder for run in load_runs(tmp_path)] == [kept]
    assert capsys.readouterr().err.splitlines() == [
        f"run={old}: made by echolearn 0.1, left out: train it again",
        f"run={later}: made by another version of echolearn (format 99), left out: train it again",
    ]
    with pytest.raises(BadValue, match=f"^run={old}: made by echolearn 0.1: train it again$"):
        read_run(old)


def test_what_a_run_is_stands_in_its_metrics(runs: list[Run]) -> None:
    found = {(run.classifier, run.method, run.role) for run in runs}
    assert found == {
        ("svm_pair", "svm", "learned"),
        ("threshold_peak", "threshold", "baseline"),
        ("trees_features", "trees", "learned"),
    }
    assert {run.plan for run in runs} == {"grid", "scattered"}
    assert {(run.target, run.split) for run in runs} == {("reflector", "position")}
