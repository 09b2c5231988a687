"""Training runs: division of rows, run folders, identity, resuming, and the files a run leaves."""

import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue
from echolearn.classifiers import batches
from echolearn.classifiers.architectures import Mlp
from echolearn.classifiers.inputs import Rows
from echolearn.classifiers.methods.network import Network
from echolearn.cli import config
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation import metrics
from echolearn.storage import files, manifests
from echolearn.storage.identity import digest
from echolearn.training import train as training
from echolearn.training.predictions import load_scorer
from echolearn.training.split import LearningProblem

THRESHOLD = {"_target_": "echolearn.classifiers.methods.threshold.Threshold", "inputs": ["score"]}
SVM = {
    "_target_": "echolearn.classifiers.methods.svm.Svm",
    "inputs": ["score", "power"],
    "c_grid": [1.0],
    "gamma_grid": [0.1, 1.0],
}
NETWORK = {
    "_target_": "echolearn.classifiers.methods.network.Network",
    "inputs": ["covariance_gated"],
    "net": {
        "_target_": "echolearn.classifiers.architectures.CovarianceNet",
        "channels": 4,
        "layers": 1,
        "kernel": 3,
    },
    "epochs": 8,
    "batch_size": 16,
    "lr": 0.02,
}


def make_set(
    folder: Path, *, positions: int, each: int = 1, plan: str = "toy", shards: int = 1
) -> Dataset:
    """Write a finished set whose score tells the label and whose toa tells the position, and open
    it."""
    rng = np.random.default_rng(0)
    rows = positions * each
    y = rng.random(rows) < 0.5
    columns = {
        "group": np.repeat(np.arange(positions), each),
        "reflector": y,
        "on_map": y & (rng.random(rows) < 0.8),
        "score": 0.1 * rng.normal(size=rows) + 0.2 * y,
        "power": 5 * rng.normal(size=rows) - 40,
        "snr_db": rng.uniform(-40, 40, rows),
        "covariance_gated": (rng.normal(size=(rows, 4, 9)) + 0.8 * y[:, None, None]).astype(
            np.float32
        ),
    }
    table = np.empty(
        rows, dtype=[(name, value.dtype, value.shape[1:]) for name, value in columns.items()]
    )
    for name, value in columns.items():
        table[name] = value
    for shard, part in enumerate(np.array_split(table, shards)):
        manifests.write_shard(folder, shard, part)
    about = {
        "kind": "set",
        "rows": rows,
        "plan": {"name": plan},
        "command": f"echolearn generate plan={plan}",
    }
    manifests.finish(folder, about, [manifests.shard_name(shard) for shard in range(shards)])
    return Dataset(folder)


@pytest.fixture(scope="module")
def toy(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return make_set(tmp_path_factory.mktemp("toy"), positions=150, each=2)


def train(task: LearningProblem, keys: dict[str, Any], runs: Path, **more: Any) -> dict[str, Any]:
    return training.train(
        task,
        **{
            "name": "some",
            "classifier": lambda: config.build(keys),
            "config": keys,
            "runs": runs,
            **more,
        },
    )


def never() -> Any:
    raise AssertionError("a finished run was redone")


class TestDivision:
    def test_the_papers_numbers(self, tmp_path: Path) -> None:
        task = LearningProblem(make_set(tmp_path, positions=1989))
        assert [len(rows) for rows in task.parts()] == [1273, 318, 398]

    @pytest.mark.parametrize(("split", "shared"), [("position", False), ("row", True)])
    def test_only_the_leaky_split_parts_positions(
        self, tmp_path: Path, split: str, shared: bool
    ) -> None:
        task = LearningProblem(make_set(tmp_path, positions=221, each=9), split=split)
        parts, group = task.parts(), task.dataset["group"]
        assert np.array_equal(np.sort(np.concatenate(parts)), np.arange(1989))
        assert bool(set(group[parts.train]) & set(group[parts.test])) is shared
        assert bool(set(group[parts.train]) & set(group[parts.validation])) is shared

    def test_folds_cover_all_but_the_test_part_once(self, toy: Dataset) -> None:
        task = LearningProblem(toy, seed=4)
        folds, group, (train_rows, validation, test) = (
            list(task.folds(5)),
            toy["group"],
            task.parts(),
        )
        tested = np.sort(np.concatenate([fold.test for fold in folds]))
        assert np.array_equal(tested, np.sort(np.concatenate([train_rows, validation])))
        assert not set(tested) & set(test)
        for fold in folds:
            sides = [set(group[rows]) for rows in fold]
            assert not sides[0] & sides[1] and not sides[1] & sides[2] and not sides[0] & sides[2]

    def test_seeds_divide_differently_and_repeatably(self, toy: Dataset) -> None:
        tests = [LearningProblem(toy, seed=seed).parts().test for seed in (0, 0, 1)]
        assert np.array_equal(tests[0], tests[1]) and not np.array_equal(tests[0], tests[2])


COMMAND = "echolearn train seed=2 'classifier.inputs=[score]'"
Done = tuple[LearningProblem, dict[str, Any], Path, dict[str, Any]]


def finish(toy: Dataset, keys: dict[str, Any], runs: Path) -> Done:
    task = LearningProblem(toy, seed=2)
    return task, keys, runs, train(task, keys, runs, command=COMMAND)


@pytest.fixture(scope="module")
def threshold(toy: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Done:
    return finish(toy, THRESHOLD, tmp_path_factory.mktemp("threshold"))


@pytest.fixture(scope="module")
def network(toy: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Done:
    return finish(toy, NETWORK, tmp_path_factory.mktemp("network"))


@pytest.fixture(params=["threshold", "network"])
def done(request: pytest.FixtureRequest) -> Done:
    return request.getfixturevalue(request.param)  # type: ignore[no-any-return]


class TestRun:
    def test_folder_is_named_after_what_it_is(self, done: Done) -> None:
        _, keys, runs, result = done
        folder = runs / "train" / result["run"]
        assert result["run"].startswith("some-toy-s2-")
        saved = json.loads((folder / "config.json").read_text())
        assert saved["classifier"] == keys and result["run"].endswith(digest(saved))
        assert json.loads((folder / "metrics.json").read_text()) == result

    def test_file_scores_the_test_rows_as_reported(self, done: Done) -> None:
        task, _, runs, result = done
        test = task.parts().test
        confidence = load_scorer(runs / "train" / result["run"])(
            task.inputs(result["inputs"])[test]
        )
        values = metrics.evaluate_labels(
            task.labels()[test], confidence, threshold=result["threshold"]
        )
        assert float(values["auc"]) == pytest.approx(result["test"]["auc"], abs=1e-3)
        assert float(values["balanced_accuracy"]) == pytest.approx(
            result["test"]["balanced_accuracy"], abs=0.02
        )
        assert (
            result["test"]["auc"] > 0.85
            and result["rows"]["test"] == 60
            and result["model"]["parity"] <= 1e-5
        )

    def test_finished_runs_are_skipped(self, done: Done) -> None:
        task, keys, runs, result = done
        assert training.train(task, name="some", classifier=never, config=keys, runs=runs) == result

    def test_any_change_is_another_run(self, done: Done, toy: Dataset) -> None:
        task, keys, runs, _ = done
        with pytest.raises(AssertionError, match="redone"):
            training.train(
                task, name="some", classifier=never, config=keys | {"inputs": ["power"]}, runs=runs
            )
        for other in (
            LearningProblem(toy, seed=3),
            LearningProblem(toy, seed=2, target="on_map"),
            LearningProblem(toy, seed=2, split="row"),
        ):
            with pytest.raises(AssertionError, match="redone"):
                training.train(other, name="some", classifier=never, config=keys, runs=runs)

    def test_the_dashboard_compares_all(self, done: Done) -> None:
        _, _, runs, result = done
        events = EventAccumulator(str(runs / "train" / result["run"]))
        events.Reload()
        figures = {
            f"{part}/{name}"
            for part in ("val", "test")
            for name in ("auc", "balanced_accuracy", "f1")
        }
        assert (
            figures <= set(events.Tags()["scalars"]) and "hp_metric" not in events.Tags()["scalars"]
        )
        assert events.Scalars("test/auc")[-1].value == pytest.approx(
            result["test"]["auc"], rel=1e-6
        )
        assert "test/pr" in events.Tags()["tensors"]
        sessions = [
            tag for tag in events.summary_metadata if tag.startswith("_hparams_/session_start_info")
        ]
        assert len(sessions) == 1


class TestTrust:
    @pytest.fixture
    def run(self, threshold: Done, tmp_path: Path) -> Path:
        """Copy the folder of a finished run."""
        _, _, runs, result = threshold
        return Path(
            shutil.copytree(runs / "train" / result["run"], tmp_path / "train" / result["run"])
        )

    @pytest.mark.parametrize("name", ["model.onnx", "config.json", "metrics.json"])
    def test_any_flipped_bit_is_refused_and_mended(
        self, toy: Dataset, run: Path, tmp_path: Path, name: str
    ) -> None:
        expected = {
            path.name: path.read_bytes()
            for path in run.iterdir()
            if path.suffix in (".json", ".onnx")
        }
        whole = expected[name]
        advice = files.MEND if name == "metrics.json" else f"run again: {re.escape(COMMAND)}"
        for place in range(0, len(whole), len(whole) // 40):
            (run / name).write_bytes(
                whole[:place] + bytes([whole[place] ^ 1 << place % 8]) + whole[place + 1 :]
            )
            with pytest.raises(BadValue, match=rf"{name}: .*; {advice}$"):
                manifests.verify(run)
            with pytest.raises(BadValue, match=f"{name}: "):
                load_scorer(run)
        train(LearningProblem(toy, seed=2), THRESHOLD, tmp_path, command=COMMAND)
        assert {key: (run / key).read_bytes() for key in expected if key != "timing.json"} == {
            key: content for key, content in expected.items() if key != "timing.json"
        }

    def test_a_finished_run_names_every_file_that_counts(self, run: Path) -> None:
        assert set(manifests.verify(run)["files"]) == {"config.json", "model.onnx"}

    def test_another_wording_is_the_same_run(self, toy: Dataset, run: Path, tmp_path: Path) -> None:
        before = (run / "metrics.json").read_bytes()
        result = train(
            LearningProblem(toy, seed=2),
            THRESHOLD,
            tmp_path,
            classifier=never,
            command="echolearn train seed=2",
        )
        assert result["command"] == COMMAND and (run / "metrics.json").read_bytes() == before

    def test_a_renamed_run_is_not_taken_for_another(
        self, toy: Dataset, run: Path, tmp_path: Path
    ) -> None:
        identity = files.load_json(run / "config.json")
        identity["problem"]["seed"] = 1
        run.rename(run.parent / f"some-toy-s1-{digest(identity)}")
        with pytest.raises(BadValue, match="another run"):
            train(LearningProblem(toy, seed=1), THRESHOLD, tmp_path)

    @pytest.mark.parametrize("keys", [THRESHOLD, NETWORK], ids=["threshold", "network"])
    def test_a_full_disk_is_one_line(
        self, keys: dict[str, Any], toy: Dataset, tmp_path: Path, capfd: pytest.CaptureFixture[str]
    ) -> None:
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(
            resource.RLIMIT_FSIZE, (2500, hard)
        )  # bytes in a file: enough for a model, not for a log
        try:
            with pytest.raises(
                BadValue, match="cannot be written .*make room and run the same command again"
            ):
                train(LearningProblem(toy), keys, tmp_path)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert capfd.readouterr().err == "" and not list(tmp_path.rglob("metrics.json"))

    def test_an_unfinished_run_cannot_be_loaded(self, tmp_path: Path) -> None:
        with pytest.raises(BadValue, match="metrics.json"):
            load_scorer(tmp_path)

    def test_killed_and_run_again_gives_equal_metrics(self, toy: Dataset, tmp_path: Path) -> None:
        expected = train(LearningProblem(toy), NETWORK, tmp_path / "calm")["run"]
        folder = tmp_path / "killed" / "train" / expected
        kill_when(
            (folder / "best.ckpt").is_file,
            lambda: train(LearningProblem(toy), NETWORK, tmp_path / "killed"),
        )
        assert not (folder / "metrics.json").exists()
        (folder / "events.out.tfevents.torn").write_bytes(b"torn")
        train(LearningProblem(toy), NETWORK, tmp_path / "killed")
        calm = tmp_path / "calm" / "train" / expected
        for name in ("metrics.json", "config.json", "model.onnx"):
            assert (folder / name).read_bytes() == (calm / name).read_bytes()
        assert not (folder / "events.out.tfevents.torn").exists()

    def test_two_at_once_give_one_whole_run(
        self, toy: Dataset, tmp_path: Path, capfd: pytest.CaptureFixture[str]
    ) -> None:
        """The second waits, says so, and finds what the first has made; nothing but the run is
        left."""
        expected = train(LearningProblem(toy), NETWORK, tmp_path / "calm")
        folder = tmp_path / "both" / "train" / expected["run"]
        child = os.fork()
        if child == 0:
            os._exit(train(LearningProblem(toy), NETWORK, tmp_path / "both") != expected)
        while not (folder / "config.json").is_file():
            time.sleep(0.001)
        assert train(LearningProblem(toy), NETWORK, tmp_path / "both") == expected
        assert os.waitpid(child, 0)[1] == 0
        assert manifests.verify(folder) == expected
        assert [path.name for path in folder.parent.glob("[!.]*")] == [folder.name]
        assert len(list(folder.glob("events.*"))) == len(
            list((tmp_path / "calm").rglob("events.*"))
        )
        waited = f"{folder.name}: waiting for another command that trains this run"
        assert capfd.readouterr().err.splitlines().count(waited) == 1


class TestStreaming:
    """Sets too large for memory: batches from the shards."""

    def test_the_run_is_the_same_to_the_last_byte(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        task = LearningProblem(make_set(tmp_path / "set", positions=150, each=2, shards=7))
        whole = tmp_path / "whole" / "train" / train(task, NETWORK, tmp_path / "whole")["run"]
        monkeypatch.setattr(batches, "IN_MEMORY", 0)
        streamed = (
            tmp_path / "streamed" / "train" / train(task, NETWORK, tmp_path / "streamed")["run"]
        )
        for name in ("metrics.json", "config.json", "model.onnx", "metrics.csv"):
            assert (streamed / name).read_bytes() == (whole / name).read_bytes()

    @pytest.mark.parametrize("limit", [0, 2**20])
    def test_no_more_rows_are_fetched_at_once_than_a_block(
        self, limit: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        rng, fetched = np.random.default_rng(0), []
        table = rng.normal(size=(9000, 2)).astype(np.float32)

        def gather(rows: Array) -> Array:
            fetched.append(len(rows))
            return table[rows]

        monkeypatch.setattr(batches, "IN_MEMORY", limit)
        net = Network(["a", "b"], Mlp(widths=[4]), epochs=2, batch_size=1000)
        rows, y = Rows(gather, np.arange(9000), ["a", "b"]), table[:, 0] > 0
        net.fit(
            rows,
            y,
            groups=y,
            validation=(rows.part(np.arange(100)), y[:100]),
            folder=tmp_path,
            seed=0,
        )
        net.decision(rows)
        assert max(fetched) <= 4096
        assert (fetched.count(1000) == 2 * 9) is (limit == 0)

    def test_what_is_not_finite_is_named_by_its_row_in_the_set(self, toy: Dataset) -> None:
        def gather(rows: Array) -> Array:
            return np.where(rows[:, None, None] == 11, np.nan, toy.gather("covariance_gated", rows))

        rows = Rows(gather, np.arange(300), ["covariance_gated"]).part(np.array([2, 11, 40]))
        assert rows[:1].shape == (1, 4, 9) and rows.shape == (3, 4, 9)
        with pytest.raises(BadValue, match="covariance_gated=nan in row 11: "):
            rows[1:]


def kill_when(ready: Callable[[], bool], work: Callable[[], object]) -> None:
    """Do `work` in a forked process and kill it with SIGKILL as soon as `ready`."""
    child = os.fork()
    if child == 0:
        work()
        os._exit(0)
    deadline = time.monotonic() + 30
    while not ready() and time.monotonic() < deadline:
        time.sleep(0.001)
    os.kill(child, signal.SIGKILL)
    assert os.waitpid(child, 0)[1] == signal.SIGKILL


def test_cross_validation_and_grid_search_are_recorded(toy: Dataset, tmp_path: Path) -> None:
    result = train(LearningProblem(toy), SVM, tmp_path, folds=3)
    assert result["cross_validation"]["auc"]["mean"] == pytest.approx(0.92, abs=0.06)
    assert 0 < result["cross_validation"]["auc"]["sd"] < 0.1
    assert result["grid_search"]["gamma"] in SVM["gamma_grid"]
    assert (
        result["grid_search"]["search_rows"]
        == result["grid_search"]["fit_rows"]
        == result["rows"]["train"]
    )


BAD: dict[str, Callable[[Dataset, Path], object]] = {
    "column=no_such": lambda toy, runs: train(
        LearningProblem(toy), THRESHOLD | {"inputs": ["no_such"]}, runs
    ),
    "known to simulations only": lambda toy, runs: train(
        LearningProblem(toy), THRESHOLD | {"inputs": ["snr_db"]}, runs
    ),
    "column=covariance_steered": lambda toy, runs: train(
        LearningProblem(toy), NETWORK | {"inputs": ["covariance_steered"]}, runs
    ),
    "classifier.lr=abc": lambda toy, runs: train(
        LearningProblem(toy), NETWORK | {"lr": "abc"}, runs
    ),
    "target=wall": lambda toy, runs: LearningProblem(toy, target="wall"),
    "split=time": lambda toy, runs: LearningProblem(toy, split="time"),
    "test_share=1": lambda toy, runs: LearningProblem(toy, test_share=1.0),
    "seed=-1": lambda toy, runs: LearningProblem(toy, seed=-1),
    "folds=1": lambda toy, runs: train(LearningProblem(toy), THRESHOLD, runs, folds=1),
    "use a larger set": lambda toy, runs: train(
        LearningProblem(toy, split="row", test_share=0.01, seed=0), THRESHOLD, runs
    ),
}


@pytest.mark.parametrize("part", BAD)
def test_bad_values_are_named_and_leave_nothing(part: str, toy: Dataset, tmp_path: Path) -> None:
    with pytest.raises(BadValue) as caught:
        BAD[part](toy, tmp_path)
    assert part in str(caught.value) and "\n" not in str(caught.value)
    assert not list(tmp_path.rglob("*"))


def test_finding_finished_runs_loads_no_learning_library(toy: Dataset, threshold: Done) -> None:
    _, keys, runs, result = threshold
    code = f"""
import sys
from pathlib import Path
from echolearn.dataset.labelled_set import Dataset
from echolearn.training.predictions import load_scorer
from echolearn.training.split import LearningProblem
from echolearn.training.train import train
task = LearningProblem(Dataset(Path({str(toy.folder)!r})), seed=2)
result = train(task, name="some", classifier=None, config={keys!r}, runs=Path({str(runs)!r}))
print(result["run"], *sorted({{"torch", "sklearn", "lightning", "onnxruntime"}} & set(sys.modules)))
"""
    out = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout
    assert out.split() == [result["run"]]


def test_inputs_are_float32_of_the_columns(toy: Dataset) -> None:
    task = LearningProblem(toy)
    expected: Array = np.stack([toy["score"], toy["power"]], axis=1).astype(np.float32)
    np.testing.assert_array_equal(task.inputs(["score", "power"]), expected)
    assert task.inputs(["covariance_gated"]).shape == (300, 4, 9)
