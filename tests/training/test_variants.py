"""Runs of one classifier with several settings: names, which are told apart, which is the best."""

import shutil
from collections import Counter
from dataclasses import replace
from functools import partial

import pytest

from echolearn.checks import BadValue
from echolearn.cli.config import build
from echolearn.comparison.compare import compare
from echolearn.storage.identity import by_short_names
from echolearn.training.runs import load_runs
from echolearn.training.split import LearningProblem
from echolearn.training.train import train
from echolearn.training.variants import (
    Wanted,
    best_of,
    find_runs,
    selection_lines,
    told_apart,
    variant_text,
)
from world import CLASSIFIERS

VARIED = [
    ({}, ""),
    ({"classifier.c_grid": [10.0]}, "c10"),
    ({"classifier.c_grid": [0.1, 10.0], "classifier.gamma_grid": [1]}, "c0.1_10-gamma1"),
    ({"classifier.monitor": "auc", "aim": "precision 0.9"}, "monitor_auc-aim_precision_0.9"),
    ({"classifier.members.a.l2": 1, "classifier.members.b.l2": 2}, "members.a.l21-members.b.l22"),
    ({"classifier.estimator._target_": "sklearn.svm.LinearSVC", "aim": "a"}, "LinearSVC-aim_a"),
    ({"classifier.path": "../x y"}, "path_.._x_y"),
]


@pytest.mark.parametrize(("varied", "text"), VARIED)
def test_what_is_varied_becomes_a_part_of_a_name(varied, text):
    assert variant_text(varied) == text


def test_a_long_one_becomes_its_digest_and_others_another():
    long = {variant_text({f"classifier.{'k' * 50}": value}) for value in (1, 2)}
    assert len(long) == 2 and {len(each) for each in long} == {12}


def learn(world, runs, *, seed=0, variant="", name="trees_features", **changes):
    """Train trees on the scattered set with other settings; return the run's metrics."""
    keys = CLASSIFIERS[name] | changes
    problem = LearningProblem(world.sets["scattered"], target="reflector", seed=seed)
    make = partial(build, keys, "classifier")
    about = {"config": by_short_names(keys), "runs": runs, "variant": variant}
    return train(problem, name=name, classifier=make, **about)


@pytest.fixture(scope="module")
def swept(world, tmp_path_factory):
    """Return a folder with sets, walks and a sweep over depths beside the usual trees."""
    runs = tmp_path_factory.mktemp("swept")
    for kind in ("data", "survey"):
        (runs / kind).symlink_to(world.runs / kind)
    learn(world, runs)
    for depth in (1, 2):
        for seed in (0, 1):
            learn(world, runs, depth=depth, seed=seed, variant=f"depth{depth}")
    return runs


def test_a_sweep_names_runs_and_moves_no_identity(world, swept, tmp_path):
    """By whatever command a run is asked for, it is made once."""
    known = {run.identity: run for run in load_runs(swept)}
    plain = learn(world, tmp_path, depth=1)["run"]
    title, _, digest = plain.rpartition("-")
    assert title == "trees_features-scattered-s0" and f"{title}-depth1-{digest}" in known
    assert learn(world, swept, depth=1)["run"] == f"{title}-depth1-{digest}"
    assert learn(world, swept, depth=1, variant="other")["run"] == f"{title}-depth1-{digest}"
    # The other way round: what is there under its usual name keeps it.
    assert learn(world, tmp_path, depth=1, variant="depth1")["run"] == plain
    assert len(load_runs(swept)) == 5 and len(load_runs(tmp_path)) == 0


def test_each_setting_is_a_classifier_with_all_of_its_seeds(swept):
    found, selected = find_runs(swept)
    names = Counter(run.model.classifier for run in found)
    assert names == {"trees_features": 1, "trees_features-depth1": 2, "trees_features-depth2": 2}
    assert selected == {}


def test_runs_without_a_name_of_their_own_are_told_apart_by_what_differs(world, tmp_path):
    (tmp_path / "data").symlink_to(world.runs / "data")
    for depth in (1, 2):
        learn(world, tmp_path, depth=depth)
    found, _ = find_runs(tmp_path)
    assert {run.model.classifier for run in found} == {
        "trees_features-depth1",
        "trees_features-depth2",
    }
    # One alone, or one for each seed, has the name that it always had.
    assert [run.model.classifier for run in told_apart(load_runs(tmp_path)[:1])] == [
        "trees_features"
    ]


def test_a_run_that_is_there_twice_is_returned_once(swept):
    runs = load_runs(swept)
    again = replace(runs[0], metrics={**runs[0].metrics, "cross_validation": {"auc": {}}})
    for pair in ([runs[0], again], [again, runs[0]]):
        [found] = told_apart(pair)
        assert found.metrics["cross_validation"]
    assert told_apart([*runs, *runs]) == told_apart(runs)


def test_the_best_is_chosen_by_validation_rows_alone(swept):
    def with_figures(run):
        share = {"": 0.6, "depth1": 0.9, "depth2": 0.7}[run.variant] - 0.3 * run.seed
        figures = {"validation": {"balanced_accuracy": share}}
        return replace(run, metrics={**run.metrics, **figures, "test": {"auc": -share}})

    found, selected = best_of([with_figures(run) for run in load_runs(swept)])
    assert [(run.variant, run.seed) for run in found] == [("depth1", 0), ("depth1", 1)]
    [line] = selection_lines(selected)
    assert line.startswith("trees_features-depth1, trained on scattered: the best of 3 settings")


def test_runs_are_chosen_by_patterns_of_their_names(swept):
    def chosen(*among):
        return sorted(run.variant for run in find_runs(swept, Wanted(among))[0])

    assert chosen("trees_*") == ["", "depth1", "depth1", "depth2", "depth2"]
    assert chosen("*-depth1-*", "trees_*-s1-*") == ["depth1", "depth1", "depth2"]
    assert chosen("trees_features-depth2") == ["depth2", "depth2"]
    with pytest.raises(BadValue, match=r"^runs=mlp_\*: must name one run .* of trees_features$"):
        chosen("trees_*", "mlp_*")


def test_a_sweep_is_compared_and_the_table_says_what_was_selected(swept, tmp_path, capsys):
    shutil.copytree(swept, tmp_path / "runs", symlinks=True)
    about = {"tested": ["scattered"], "surveys": [], "localizers": {}, "resamples": 20}
    shown = {}
    for select in ("all", "best"):
        folder = compare(name=select, runs=tmp_path / "runs", wanted=Wanted(select=select), **about)
        shown[select] = (folder / "table.md").read_text()
        page = (folder / "report.html").read_text()
        assert ("trees_features-depth2" in page) == (select == "all")
        assert ("best of 3 settings" in page) == (select == "best")
    assert "settings" not in shown["all"]
    best = find_runs(swept, Wanted(select="best"))[0][0].model.classifier
    assert f"{best}, trained on scattered: the best of 3 settings by balanced" in shown["best"]
    with pytest.raises(BadValue, match="^select=worst: must be"):
        Wanted(select="worst")
