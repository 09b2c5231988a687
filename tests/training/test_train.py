"""Training runs: division of rows, run folders, identity, resuming, and the files a run leaves."""

import csv
import json
import os
import re
import resource
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from lightning.pytorch.loggers import CSVLogger
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData

from children import begin, kill_when
from echolearn.checks import BadValue
from echolearn.classifiers import batches
from echolearn.classifiers.architectures import Mlp
from echolearn.classifiers.classifier import Examples
from echolearn.classifiers.inputs import Rows
from echolearn.classifiers.methods.network import Network
from echolearn.cli import config
from echolearn.dataset.labelled_set import FORMAT, Dataset
from echolearn.storage import files, manifests
from echolearn.storage.identity import digest
from echolearn.training import train as training
from echolearn.training.predictions import load_scorer
from echolearn.training.runs import check_metrics, read_run
from echolearn.training.split import LearningProblem

METHODS = "echolearn.classifiers.methods."
THRESHOLD = {"_target_": f"{METHODS}threshold.Threshold", "inputs": ["score"]}
SVM = {
    "_target_": f"{METHODS}svm.Svm",
    "inputs": ["score", "power"],
    "c_grid": [1.0],
    "gamma_grid": [0.1, 1.0],
}
NETWORK = {
    "_target_": f"{METHODS}network.Network",
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


def make_set(folder, *, positions, each=1, shards=1):
    """Write a finished set whose score tells the label, and open it."""
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
        "covariance_gated": rng.normal(size=(rows, 4, 9)) + 0.8 * y[:, None, None],
    }
    fields = [(name, value.dtype, value.shape[1:]) for name, value in columns.items()]
    table = np.empty(rows, dtype=fields)
    for name, value in columns.items():
        table[name] = value
    for shard, part in enumerate(np.array_split(table, shards)):
        manifests.write_shard(folder, shard, array=part)
    about = {
        "kind": "set",
        "format": FORMAT,
        "rows": rows,
        "plan": {"name": "toy"},
        "command": "echolearn generate plan=toy",
    }
    manifests.finish(folder, about, files=[manifests.shard_name(shard) for shard in range(shards)])
    return Dataset(folder)


def train(problem, keys, runs, **more):
    """Train a classifier under the name "some"."""
    given = {"classifier": lambda: config.build(keys, "classifier"), "config": keys, "name": "some"}
    return training.train(problem, runs=runs, **given | more)


COMMAND = "echolearn train seed=2 'classifier.inputs=[score]'"
KEYS = {"threshold": THRESHOLD, "network": NETWORK}


@pytest.fixture(scope="module")
def toy(tmp_path_factory):
    return make_set(tmp_path_factory.mktemp("toy"), positions=150, each=2)


@pytest.fixture(scope="module", params=KEYS)
def method(request):
    return str(request.param)


@pytest.fixture(scope="module")
def done(method, toy, tmp_path_factory):
    """Return the folder of a finished run; not to be changed."""
    runs = tmp_path_factory.mktemp(method)
    result = train(LearningProblem(toy, seed=2), KEYS[method], runs, command=COMMAND)
    return runs / "train" / str(result["run"])


@pytest.fixture(scope="module")
def calm(toy, tmp_path_factory):
    """Return the folder of a network's run that nothing has disturbed."""
    runs = tmp_path_factory.mktemp("calm")
    return runs / "train" / str(train(LearningProblem(toy), NETWORK, runs)["run"])


def never():
    raise AssertionError("a finished run was redone")


def result_files(folder):
    """Return the files that equal runs have in common."""
    return {name: (folder / name).read_bytes() for name in ("metrics.json", *FILES)}


FILES = ("config.json", "model.onnx")


class TestDivision:
    def test_the_papers_numbers(self, tmp_path):
        problem = LearningProblem(make_set(tmp_path, positions=1989))
        assert [len(rows) for rows in problem.parts()] == [1273, 318, 398]

    @pytest.mark.parametrize(("split", "shared"), [("position", False), ("row", True)])
    def test_only_the_leaky_split_parts_positions(self, toy, split, shared):
        parts = LearningProblem(toy, split=split).parts()
        assert np.array_equal(np.sort(np.concatenate(parts)), np.arange(300))
        known = {*toy["group"][parts.train]}
        assert bool(known & {*toy["group"][parts.test]}) is shared
        assert bool(known & {*toy["group"][parts.validation]}) is shared

    def test_fewer_training_rows_are_part_of_more_and_nothing_else_changes(self, toy):
        """Whole positions of two rows; who asks for more than there are has all."""
        whole = LearningProblem(toy, seed=4).parts()
        parts = [LearningProblem(toy, seed=4, train_rows=n).parts() for n in (20, 61, 10**6)]
        few, more, every = ({*each.train} for each in parts)
        assert (len(few), len(more)) == (20, 60) and few < more < every == {*whole.train}
        for each in parts:
            assert np.array_equal(each.validation, whole.validation)
            assert np.array_equal(each.test, whole.test)
            assert all(np.bincount(toy["group"][each.train])[toy["group"][each.train]] == 2)
        identities = [LearningProblem(toy, train_rows=n).identity() for n in (None, 20)]
        assert identities[1] == identities[0] | {"train_rows": 20}
        with pytest.raises(BadValue, match="^train_rows=9"):
            LearningProblem(toy, train_rows=9)

    def test_folds_cover_all_but_the_test_part_once(self, toy):
        problem = LearningProblem(toy, seed=4)
        parts = problem.parts()
        folds = list(problem.folds(5))
        tested = np.sort(np.concatenate([fold.test for fold in folds]))
        assert np.array_equal(tested, np.sort(np.concatenate([parts.train, parts.validation])))
        for fold in folds:
            first, second, third = ({*toy["group"][rows]} for rows in fold)
            assert not first & second and not second & third and not first & third

    def test_inputs_are_float32_of_the_columns(self, toy):
        problem = LearningProblem(toy)
        expected = np.stack([toy["score"], toy["power"]], axis=1).astype(np.float32)
        np.testing.assert_array_equal(problem.inputs(["score", "power"]), expected)
        assert problem.inputs(["covariance_gated"]).shape == (300, 4, 9)


class TestRun:
    def test_folder_is_named_after_what_it_is(self, done, method):
        saved = json.loads((done / "config.json").read_text())
        assert done.name == f"some-toy-s2-{digest(saved)}" and saved["classifier"] == KEYS[method]
        assert {*manifests.verify(done)["files"]} == {*FILES}

    def test_metrics_tell_how_well_it_did(self, done, method):
        result = manifests.verify(done)
        assert result["test"]["auc"] > 0.85 and result["rows"]["test"] == 60
        assert result["model"]["parity"] <= 1e-5
        assert (result["method"], result["accelerator"]) == (method, "cpu")

    def test_finished_runs_are_skipped_and_any_change_is_another_run(self, done, method, toy):
        """Another wording of the command is no change."""
        before = (done / "metrics.json").read_bytes()
        again = partial(train, runs=done.parents[1], classifier=never, command="echolearn train")
        found = again(LearningProblem(toy, seed=2), KEYS[method])
        assert found["command"] == COMMAND and (done / "metrics.json").read_bytes() == before
        changes = [{"seed": 3}, {"target": "reflector"}, {"split": "row"}]
        for change in changes:
            with pytest.raises(AssertionError, match="redone"):
                again(LearningProblem(toy, **{"seed": 2} | change), KEYS[method])
        with pytest.raises(AssertionError, match="redone"):
            again(LearningProblem(toy, seed=2), KEYS[method] | {"inputs": ["power"]})

    def test_tensorboard_compares_all(self, done):
        events = EventAccumulator(str(done))
        events.Reload()
        scalars = events.Tags()["scalars"]
        assert {"val/auc", "val/f1", "test/auc", "test/balanced_accuracy"} <= {*scalars}
        assert "hp_metric" not in scalars and "test/pr" in events.Tags()["tensors"]
        auc = manifests.verify(done)["test"]["auc"]
        assert events.Scalars("test/auc")[-1].value == pytest.approx(auc, rel=1e-6)
        # An experiment in one run would hide the hyperparameters of the others.
        said = {tag for tag in events.summary_metadata if tag.startswith("_hparams_")}
        assert said == {f"_hparams_/session_{part}_info" for part in ("start", "end")}
        assert {"test/reliability", "test/precision_recall"} <= {*events.Tags()["images"]}
        # By name, the first five are shown.
        told = events.summary_metadata["_hparams_/session_start_info"].plugin_data.content
        names = sorted(HParamsPluginData.FromString(told).session_start_info.hparams)
        assert names[:3] == ["1 plan", "2 seed", "3 classifier"]

    def test_a_network_tells_each_epoch_and_ends_at_its_best(self, calm):
        events = EventAccumulator(str(calm))
        events.Reload()
        losses = [each.value for each in events.Scalars("val/loss")]
        for tag in ("val/auc", "val/balanced_accuracy"):
            curve = [(each.step, each.value) for each in events.Scalars(tag)]
            assert [step for step, _ in curve] == list(range(len(losses) + 1))
            assert all(0 <= value <= 1 for _, value in curve)
        best = events.Scalars("val/auc")[int(np.argmin(losses))].value
        assert events.Scalars("val/auc")[-1].value == pytest.approx(best, abs=1e-6)
        assert {each.value for each in events.Scalars("train/lr")} == {np.float32(NETWORK["lr"])}

    def test_cross_validation_and_grid_search_are_recorded_and_one_line_said(
        self, toy, tmp_path, capfd
    ):
        result = train(LearningProblem(toy), SVM, tmp_path, folds=3)
        figures = r"test AUC 0\.\d+, balanced accuracy 0\.\d+"
        line = rf": \d+\.\d s on cpu, {figures} of {result['rows']['test']} rows(; .*_grid)?\n"
        assert re.fullmatch(result["run"] + line, capfd.readouterr().err)
        auc = result["cross_validation"]["auc"]
        assert auc["mean"] == pytest.approx(0.92, abs=0.06) and 0 < auc["sd"] < 0.1
        assert auc["mean"] == pytest.approx(np.mean(auc["values"])) and len(auc["values"]) == 3
        # A third of what is not for testing, over four fifths of the rest.
        ratio = result["cross_validation"]["test_to_training"]
        assert ratio == pytest.approx((1 / 3) / (0.8 * 2 / 3), rel=0.05)
        search = result["grid_search"]
        assert search["gamma"] in SVM["gamma_grid"]
        assert search["search_rows"] == search["fit_rows"] == result["rows"]["train"]
        # TensorBoard draws the whole grid, a curve over C for each gamma.
        events = EventAccumulator(str(tmp_path / "train" / result["run"]))
        events.Reload()
        tags = [f"search/gamma={gamma:g}" for gamma in SVM["gamma_grid"]]
        grid = [[each.value for each in events.Scalars(tag)] for tag in tags]
        assert np.shape(grid) == (len(SVM["gamma_grid"]), len(SVM["c_grid"]))
        assert np.max(grid) == pytest.approx(search["auc"])

    def test_what_a_training_was_without_is_told_by_its_model(self, toy, tmp_path):
        problem = LearningProblem(toy, train_rows=100)
        result = train(problem, THRESHOLD, tmp_path, without=["power", "joint"])
        run = read_run(tmp_path / "train" / result["run"])
        assert (run.model.train_rows, run.model.without) == ("100", "power joint")
        assert run.model.training == "toy (on_map, 100 rows, without power joint)"
        assert run.model.full.training == "toy (on_map)"
        odd = replace(run, metrics={**run.metrics, "without": ["snr_db"]})
        with pytest.raises(BadValue, match="metrics.json without"):
            check_metrics(odd)

    def test_finding_a_finished_run_loads_no_learning_library(self, done, method, toy):
        code = f"""
import sys
from pathlib import Path
from echolearn.dataset.labelled_set import Dataset
from echolearn.training.runs import load_runs
from echolearn.training.split import LearningProblem
from echolearn.training.train import train
runs = Path({str(done.parents[1])!r})
problem = LearningProblem(Dataset(Path({str(toy.folder)!r})), seed=2)
result = train(problem, name="some", classifier=None, config={KEYS[method]!r}, runs=runs)
load_runs(runs)
print(result["run"], *{{"torch", "sklearn", "lightning", "onnxruntime"}} & set(sys.modules))
"""
        asked = [sys.executable, "-c", code]
        out = subprocess.run(asked, capture_output=True, text=True, check=True).stdout
        assert out.split() == [done.name]


LAUNCHED = """
    SLURM_JOB_ID=1 SLURM_JOB_NAME=t SLURM_NTASKS=4 SLURM_NTASKS_PER_NODE=4 SLURM_PROCID=1
    SLURM_LOCALID=1 SLURM_NODEID=0 RANK=1 LOCAL_RANK=1 WORLD_SIZE=4 LOCAL_WORLD_SIZE=4 GROUP_RANK=0
    MASTER_ADDR=nowhere.example MASTER_PORT=1 TORCHELASTIC_RUN_ID=1 OMPI_COMM_WORLD_RANK=1
    OMPI_COMM_WORLD_SIZE=4 OMPI_COMM_WORLD_LOCAL_RANK=1 PMI_RANK=1 PMI_SIZE=4
""".split()
"""What SLURM, torchrun and MPI tell the second of four processes."""


def test_variables_of_launchers_change_nothing(toy, calm, tmp_path):
    code = f"""
from pathlib import Path
from echolearn.cli import config
from echolearn.dataset.labelled_set import Dataset
from echolearn.training.split import LearningProblem
from echolearn.training.train import train
keys = {NETWORK!r}
train(
    LearningProblem(Dataset(Path({str(toy.folder)!r}))),
    name="some",
    classifier=lambda: config.build(keys, "classifier"),
    config=keys,
    runs=Path({str(tmp_path)!r}),
)
"""
    environment = os.environ | dict(each.split("=") for each in LAUNCHED)
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)
    folder = tmp_path / "train" / calm.name
    for name in ("metrics.csv", "hparams.yaml", "best.safetensors"):
        assert (folder / name).read_bytes() == (calm / name).read_bytes()
    assert result_files(folder) == result_files(calm)
    assert len([*folder.iterdir()]) == len([*calm.iterdir()])


class TestTrust:
    @pytest.fixture
    def run(self, toy, tmp_path):
        """Return the folder of a finished run, to be damaged."""
        problem = LearningProblem(toy, seed=2)
        return tmp_path / "train" / str(train(problem, THRESHOLD, tmp_path, command=COMMAND)["run"])

    def test_any_flipped_bit_is_refused_and_mended(self, toy, run, tmp_path):
        expected = result_files(run)
        for name, whole in expected.items():
            again = re.escape(f"{COMMAND} runs={tmp_path}")
            mend = files.MEND if name == "metrics.json" else f"run again: {again}"
            for place in range(0, len(whole), len(whole) // 40):
                flipped = bytes([whole[place] ^ 1 << place % 8])
                (run / name).write_bytes(whole[:place] + flipped + whole[place + 1 :])
                for read in (manifests.verify, load_scorer):
                    with pytest.raises(BadValue, match=rf"{name}: .*; {mend}$"):
                        read(run)
            train(LearningProblem(toy, seed=2), THRESHOLD, tmp_path, command=COMMAND)
            assert result_files(run) == expected

    def test_a_renamed_run_is_not_taken_for_another(self, toy, run, tmp_path):
        identity = files.load_json(run / "config.json")
        identity["problem"]["seed"] = 1
        run.rename(run.parent / f"some-toy-s1-{digest(identity)}")
        with pytest.raises(BadValue, match="another run"):
            train(LearningProblem(toy, seed=1), THRESHOLD, tmp_path)

    def test_a_full_disk_is_one_line(self, method, toy, tmp_path, capfd):
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        # Bytes in a file: enough for a model, not for a log.
        resource.setrlimit(resource.RLIMIT_FSIZE, (2500, hard))
        said = "cannot be written .*make room and run the same command again"
        try:
            with pytest.raises(BadValue, match=said):
                train(LearningProblem(toy), KEYS[method], tmp_path)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert capfd.readouterr().err == "" and not list(tmp_path.rglob("metrics.json"))

    def test_killed_and_run_again_gives_equal_results(self, toy, calm, tmp_path):
        again = partial(train, LearningProblem(toy), NETWORK, tmp_path)
        folder = tmp_path / "train" / calm.name
        kill_when((folder / "best.safetensors").is_file, again)
        assert not (folder / "metrics.json").exists()
        with pytest.raises(BadValue, match="not finished"):
            load_scorer(folder)
        (folder / "events.out.tfevents.torn").write_bytes(b"torn")
        again()
        assert result_files(folder) == result_files(calm)
        assert not (folder / "events.out.tfevents.torn").exists()

    def test_two_at_once_give_one_whole_run(self, toy, calm, tmp_path, capfd):
        """The second waits, says so, and finds what the first has made; nothing else is left."""
        again = partial(train, LearningProblem(toy), NETWORK, tmp_path)
        expected = manifests.verify(calm)
        folder = tmp_path / "train" / calm.name
        child = begin(again)
        while child.is_alive() and not (folder / "config.json").is_file():
            time.sleep(0.001)
        assert again() == expected
        child.join()
        assert child.exitcode == 0
        assert manifests.verify(folder) == expected and list(folder.parent.iterdir()) == [folder]
        assert len(list(folder.glob("events.*"))) == len(list(calm.glob("events.*")))
        waited = f"{folder.name}: waiting for another command that trains this run"
        # None if the machine had no time for this one until the first was ready.
        assert capfd.readouterr().err.splitlines().count(waited) <= 1


class TestStreaming:
    """Sets too large for memory: batches from the shards."""

    def test_the_run_is_the_same_to_the_last_byte(self, tmp_path, monkeypatch):
        problem = LearningProblem(make_set(tmp_path / "set", positions=150, each=2, shards=7))
        found = []
        for limit in (batches.IN_MEMORY, 0):
            monkeypatch.setattr(batches, "IN_MEMORY", limit)
            runs = tmp_path / str(limit)
            folder = runs / "train" / train(problem, NETWORK, runs)["run"]
            found.append((result_files(folder), (folder / "metrics.csv").read_bytes()))
        assert found[0] == found[1]

    @pytest.mark.parametrize("limit", [0, 2**20])
    def test_no_more_rows_are_fetched_at_once_than_a_block(self, limit, tmp_path, monkeypatch):
        fetched = []
        table = np.random.default_rng(0).normal(size=(9000, 2)).astype(np.float32)

        def gather(rows):
            fetched.append(len(rows))
            return table[rows]

        monkeypatch.setattr(batches, "IN_MEMORY", limit)
        net = Network(["a", "b"], Mlp(widths=[4]), epochs=2, batch_size=1000)
        rows = Rows(gather, np.arange(9000), ["a", "b"])
        y = table[:, 0] > 0
        held = (rows.part(np.arange(100)), y[:100])
        net.fit(Examples(rows, y, y, held, folder=tmp_path, seed=0))
        net.decision(rows)
        assert max(fetched) <= 4096
        assert (fetched.count(1000) == 2 * 9) is (limit == 0)

    def test_what_is_not_finite_is_named_by_its_row_in_the_set(self, toy):
        def gather(rows):
            return np.where(rows[:, None, None] == 11, np.nan, toy.gather("covariance_gated", rows))

        rows = Rows(gather, np.arange(300), ["covariance_gated"]).part(np.array([2, 11, 40]))
        assert rows[:1].shape == (1, 4, 9) and rows.shape == (3, 4, 9)
        with pytest.raises(BadValue, match="covariance_gated=nan in row 11: "):
            rows[1:]


BAD = {
    "column=no_such": ({}, {"inputs": ["no_such"]}),
    "classifier.inputs=text": ({}, {"inputs": "text"}),
    "target=wall": ({"target": "wall"}, {}),
    "split=time": ({"split": "time"}, {}),
    "test_share=1": ({"test_share": 1.0}, {}),
    "seed=-1": ({"seed": -1}, {}),
    "use a larger set": ({"split": "row", "test_share": 0.01}, {}),
    "folds=1: ": ({}, {"folds": 1}),
    "name=../up: ": ({}, {"name": "../up"}),
}


@pytest.mark.parametrize("part", BAD)
def test_bad_values_are_named_and_leave_nothing(part, toy, tmp_path):
    fields, given = BAD[part]
    more = {"inputs": ["score"], **given}
    keys = THRESHOLD | {"inputs": more.pop("inputs")}
    with pytest.raises(BadValue) as caught:
        train(LearningProblem(toy, **fields), keys, tmp_path, **more)
    assert part in str(caught.value) and "\n" not in str(caught.value)
    assert not list(tmp_path.rglob("*"))


def test_the_cut_does_what_it_is_aimed_at_on_validation_rows(toy, tmp_path, capsys):
    """And leaves the fitted classifier as it was; another aim is another run."""
    problem = LearningProblem(toy, seed=2)
    found = {
        aim: train(problem, THRESHOLD, tmp_path, aim=aim)
        for aim in ("balanced", "precision 0.95", "retention 0.95")
    }
    assert len({each["run"] for each in found.values()}) == 3
    assert len({each["model"]["sha256"] for each in found.values()}) == 1
    for aim, metric in (("precision 0.95", "precision"), ("retention 0.95", "recall")):
        assert found[aim]["validation"][metric] >= 0.95
        point = found[aim]["operating_point"]
        assert point == {
            "aim": aim,
            "precision": pytest.approx(found[aim]["validation"]["precision"]),
            "retention": pytest.approx(found[aim]["validation"]["recall"]),
            "missed": None,
        }
    assert "cannot be reached" not in capsys.readouterr().err
    with pytest.raises(BadValue, match="aim=precision 1.2: must name a share from"):
        train(problem, THRESHOLD, tmp_path, aim="precision 1.2")


def test_todays_calibration_and_cut_leave_a_run_its_name(toy, tmp_path):
    """Those of before had no such keys."""
    found = train(LearningProblem(toy, seed=2), THRESHOLD, tmp_path)
    config = files.load_json(tmp_path / "train" / found["run"] / "config.json")
    assert {*config} == {"format", "name", "classifier", "folds", "problem"}
    other = train(LearningProblem(toy, seed=2), THRESHOLD, tmp_path, calibration="isotonic")
    assert other["run"] != found["run"] and len(other["calibration"]["knots"]) > 3
    assert other["model"]["parity"] < 1e-5


def test_a_precision_out_of_reach_loses_no_run(toy, tmp_path, capsys):
    noise = {**THRESHOLD, "inputs": ["power"]}
    found = train(LearningProblem(toy, seed=2), noise, tmp_path, aim="precision 0.999")
    assert found["operating_point"]["aim"] == "balanced"
    said = "aim=precision 0.999: cannot be reached on validation rows; best is 0."
    assert said in found["operating_point"]["missed"] and said in capsys.readouterr().err


@pytest.mark.parametrize("kind", KEYS)
def test_a_logger_of_lightning_is_told_what_a_run_is_worth(kind, toy, tmp_path):
    """A network's epochs come before, and the run is the one that it is without a logger."""
    place = {"save_dir": str(tmp_path), "name": "logs", "version": "one"}
    logger = partial(CSVLogger, **place)
    result = train(LearningProblem(toy, seed=2), KEYS[kind], tmp_path / "with", logger=logger)
    told = rows_of_csv(tmp_path / "logs" / "one" / "metrics.csv")
    assert float(told[-1]["test/auc"]) == pytest.approx(result["test"]["auc"])
    epochs = [row for row in told if row.get("train/loss")]
    assert bool(epochs) is (kind == "network")
    assert "classifier.inputs" in (tmp_path / "logs" / "one" / "hparams.yaml").read_text()
    alone = train(LearningProblem(toy, seed=2), KEYS[kind], tmp_path / "without")
    assert result["model"] == alone["model"] and result["run"] == alone["run"]


def rows_of_csv(file):
    """Return the rows of a CSV file."""
    with file.open() as lines:
        return list(csv.DictReader(lines))
