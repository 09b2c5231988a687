"""Searches over settings: drawn by seed, continued after any end, written as what `train` takes."""

import csv
import json
import re
import signal
import subprocess
import sys

import pytest
import yaml

from echolearn.checks import BadValue
from echolearn.classifiers.methods.svm import Svm
from echolearn.cli.config import build
from echolearn.cli.main import main
from echolearn.cli.own import file_of, options_of, search_space
from echolearn.evaluation import metrics
from echolearn.storage import manifests
from echolearn.training.fitting import edges_of, examples_of
from echolearn.training.search_space import Choices, Range, read_space, with_values
from echolearn.training.split import LearningProblem
from echolearn.training.tune_page import FoundSettings, experiment, tune_page
from world import CLASSIFIERS

TREES = {**CLASSIFIERS["trees_features"], "depth": 3, "learning_rate": 0.1, "iterations": 8}
SPACE = {"depth": {"low": 1, "high": 6}, "learning_rate": {"low": 0.01, "high": 1.0, "log": True}}


@pytest.fixture
def tune(world, tmp_path):
    """Return a function that searches over trees of the scattered set."""
    pytest.importorskip("optuna")
    from echolearn.training.tune import Tuning
    from echolearn.training.tune import tune as search

    def run(name="found", trials=6, runs=tmp_path, keys=TREES, space=SPACE, **more):
        order = Tuning(
            LearningProblem(world.sets["scattered"], target="reflector"),
            "trees_features",
            lambda values: build(with_values(keys, values), "classifier"),
            config={},
            space=read_space(space, name="space"),
            **more,
        )
        return search(order, name=name, runs=runs, trials=trials, command="echolearn tune x")

    return run


def table(folder):
    """Return the rows of a search's table."""
    return list(csv.DictReader((folder / "trials.csv").read_text().splitlines()))


def test_equal_seeds_try_equal_settings_and_others_others(tune):
    one, two = tune("one"), tune("two")
    assert (one / "trials.csv").read_bytes() == (two / "trials.csv").read_bytes()
    other = table(tune("three", seed=1))
    assert [row["learning_rate"] for row in other] != [row["learning_rate"] for row in table(one)]
    assert all(1 <= int(row["depth"]) <= 6 for row in other)


def test_the_value_is_that_of_validation_rows_and_the_best_is_written(tune, world):
    folder = tune()
    rows = table(folder)
    best = max(rows, key=lambda row: float(row["value"]))
    found = yaml.safe_load((folder / "experiment" / "found.yaml").read_text())
    assert found["name"] == "found" and found["defaults"] == [
        {"override /classifier": "trees_features"}
    ]
    assert found["classifier"]["depth"] == int(best["depth"])

    # Fitted by hand with these settings.
    problem = LearningProblem(world.sets["scattered"], target="reflector")
    model = build(with_values(TREES, found["classifier"]), "classifier")
    examples = examples_of(model, problem, parts=problem.parts(), folder=folder)
    model.fit(examples)
    unseen, labels = examples.validation
    auc = metrics.auc(labels, model.decision(unseen))
    assert float(best["value"]) == pytest.approx(float(auc), abs=1e-6)


def test_more_trials_continue_and_no_more_leave_it(tune):
    whole = (tune("whole", trials=6) / "trials.csv").read_bytes()
    folder = tune("parts", trials=3)
    few = (folder / "trials.csv").read_text()
    journal = (folder / "journal.log").stat().st_size
    tune("parts", trials=2)
    assert (folder / "journal.log").stat().st_size == journal
    tune("parts", trials=6)
    assert (folder / "trials.csv").read_bytes() == whole and whole.decode().startswith(few)
    assert manifests.verify(folder)["trials"] == 6
    with pytest.raises(BadValue, match="must be a search of the same classifier"):
        tune("parts", seed=4)


def test_a_killed_one_is_continued_as_if_nothing_had_happened(tune):
    """A trial was drawn and never ended, and the journal ends within a line."""
    from echolearn.training.trials import next_trial, open_study

    whole = (tune("whole", trials=5) / "trials.csv").read_bytes()
    folder = tune("killed", trials=3)
    code = """
import os, signal, sys
from pathlib import Path
from echolearn.training.search_space import Range
from echolearn.training.trials import next_trial, open_study, suggested
study = open_study(Path(sys.argv[1]))
with next_trial(study, Path(sys.argv[1]), trials=5) as trial:
    suggested(study, trial, space={"depth": Range(1, 6)}, seed=0)
    with open(f"{sys.argv[1]}/journal.log", "a") as journal:
        journal.write('{"op_code":')
    os.kill(os.getpid(), signal.SIGKILL)
"""
    killed = subprocess.run([sys.executable, "-c", code, str(folder)], check=False)
    assert killed.returncode == -signal.SIGKILL
    tune("killed", trials=5)
    assert (folder / "trials.csv").read_bytes() == whole
    study = open_study(folder)
    with next_trial(study, folder, trials=5) as trial:
        assert trial is None


def test_several_at_once_share_the_trials(tune, tmp_path):
    """While one holds the only trial left, another finds nothing to do and writes nothing."""
    from echolearn.training.trials import next_trial, open_study

    folder = tune("shared", trials=2)
    study = open_study(folder)
    with next_trial(study, folder, trials=3) as held:
        assert held.number == 2
        tune("shared", trials=3)
        assert manifests.verify(folder)["trials"] == 2
    tune("shared", trials=3)
    assert [row["state"] for row in table(folder)] == ["complete"] * 3


def test_a_trial_that_fails_is_told_and_the_others_go_on(tune):
    space = {"depth": {"choices": [2, 0]}}
    folder = tune("failing", trials=6, space=space)
    states = {row["depth"]: row["state"] for row in table(folder)}
    assert states == {"2": "complete", "0": "fail"}
    with pytest.raises(BadValue, match=r"^trials=2: must have one .*; classifier.depth="):
        tune("none", trials=2, space={"depth": {"choices": [0, -1]}})


def test_networks_that_are_worse_are_stopped(tune):
    keys = {
        "_target_": "echolearn.classifiers.methods.network.Network",
        "inputs": ["peak_to_rms", "joint"],
        "net": {"_target_": "echolearn.classifiers.architectures.Mlp", "widths": [8]},
        "lr": 0.01,
        "epochs": 12,
    }
    # The first five are slow to learn, and so is every later one but for some.
    space = {"lr": {"low": 0.00001, "high": 0.1, "log": True}}
    folder = tune("pruned", trials=9, keys=keys, space=space, metric="average_precision")
    rows = table(folder)
    assert {row["state"] for row in rows} == {"complete", "pruned"}
    assert all((row["value"] == "") == (row["state"] == "pruned") for row in rows)


def test_the_page_shows_all(tune):
    space = {**SPACE, "min_leaf": {"choices": [5, 500]}}
    folder = tune("page", trials=12, space=space)
    page = (folder / "tune.html").read_text()
    for heading in ("The best settings", "History", "Importance", "Slices", "All trials"):
        assert f"<h2>{heading}</h2>" in page
    assert page.count('role="img"') == 3 and not re.search(r'(src|href)="(?!#)', page)
    assert page.count("<tr><td>") == 12
    best = json.loads((folder / "manifest.json").read_text())["best"]
    assert f"auc {best:.4f} on validation rows" in page


def test_a_best_value_near_an_end_lies_at_the_edge():
    assert Range(1.0, 100.0, log=True).at_edge(99.0)
    assert not Range(1.0, 100.0, log=True).at_edge(10.0)
    assert Range(0.0, 1.0).at_edge(0.01) and not Range(0.0, 1.0).at_edge(0.03)


def test_the_page_says_what_lies_at_an_edge():
    space = {"c_grid": Range(0.1, 10.0, log=True, listed=True), "depth": Choices([1, [2]])}
    trials = [
        (0, "complete", 0.5, {"c_grid": 1.0, "depth": "1"}),
        (1, "pruned", None, {"c_grid": 5.0, "depth": "1"}),
        (2, "complete", 0.9, {"c_grid": 9.99, "depth": "[2]"}),
        (3, "complete", 0.9, {"c_grid": 2.0, "depth": "1"}),
    ]
    search = FoundSettings(
        "x<y", "svm_pair", "auc", space, trials, {"c_grid": 1.0, "depth": 0.0}, ""
    )
    [line] = search.edges()
    assert line == "c_grid=9.99: the best lies at the edge of [0.1, 10.0]; widen it"
    page = tune_page(search).decode()
    assert line in page and "x<y" not in page and "by trial 2 of 4 (3 complete, 1 pruned)" in page
    assert yaml.safe_load(experiment(search))["classifier"] == {"c_grid": [9.99], "depth": [2]}


def test_an_svm_says_when_its_best_lies_on_the_edge_of_the_grid():
    model = Svm(("toa",), c_grid=[1.0, 10.0], gamma_grid=[0.1, 1.0, 10.0])
    model.cross_validation = {"c": 10.0, "gamma": 1.0}
    assert [*edges_of(model)] == ["c=10, the best, lies on the edge of its grid; widen c_grid"]
    model.c_grid = [10.0]
    assert [*edges_of(model)] == []


SPACES = """
{}                                   | must be a mapping
depth: 3                             | must be a mapping
depth: {low: 3}                      | must be a mapping
depth: {low: 3, high: 2}             | must be below high
depth: {low: 0, high: 2, log: true}  | above 0 with log
depth: {low: 1, high: 2, step: 1}    | must be a mapping
depth: {choices: [1]}                | must be two values
"""


@pytest.mark.parametrize("row", SPACES.strip().splitlines())
def test_a_space_that_is_none_is_refused(row):
    text, reason = row.split(" | ")
    with pytest.raises(BadValue, match=reason):
        read_space(yaml.safe_load(text), name="space")


# Classifiers of walls are not searched yet.
@pytest.mark.parametrize("name", [n for n in options_of("classifier") if "walls" not in n])
def test_every_classifier_has_a_space_of_its_own_keys_or_says_that_it_has_none(name):
    if name.startswith(("threshold", "ensemble", "sklearn", "adapted")):
        with pytest.raises(BadValue, match="classifier/search/"):
            search_space(name)
        return
    from echolearn.cli.compose import compose

    found, _ = search_space(name)
    [(_, config)] = compose("train", [f"classifier={name}"])
    for key, each in read_space(found, name=name).items():
        ends = each.choices if hasattr(each, "choices") else [each.low, each.high]
        for end in ends:
            value = [end] if getattr(each, "listed", False) else end
            build(with_values(config["classifier"], {key: value}), "classifier")
    assert file_of(f"classifier/{name}") is not None
    with pytest.raises(BadValue, match="must be a key of the classifier"):
        with_values(config["classifier"], {"nothing.here": 1})


def test_what_a_search_wrote_can_be_trained(world, tmp_path, monkeypatch, capsys):
    """By the command line, as the page says."""
    pytest.importorskip("optuna")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ECHOLEARN_CONFIG", "")
    small = ["plan=tiny_scattered", "plan.rows=150", "target=reflector"]
    assert main(["generate", *small[:2], "engine=serial"]) == 0
    words = ["classifier=trees_features", "classifier.iterations=20", *small]
    space = "space={depth:{low:2,high:4}}"
    assert main(["tune", *words, "trials=2", "name=mine", space]) == 0
    place = f"--config-dir={tmp_path / 'runs/tune/mine'}"
    assert main(["train", "experiment=mine", *small, place]) == 0
    [run] = (tmp_path / "runs/train").iterdir()
    assert run.name.startswith("mine-tiny_scattered-s0-")
    found = yaml.safe_load((tmp_path / "runs/tune/mine/experiment/mine.yaml").read_text())
    config = json.loads((run / "config.json").read_text())["classifier"]
    assert config["depth"] == found["classifier"]["depth"]
