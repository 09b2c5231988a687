"""Several echoes on the robot: what the laboratory finds, and every one of them evaluated."""

from dataclasses import replace

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.rooms import outline
from echolearn.comparison.evaluate import evaluate_survey
from echolearn.comparison.fitting import robot_at
from echolearn.comparison.localized import localize_survey
from echolearn.localization.methods.gated import Gated
from echolearn.robot.scorer import load
from echolearn.survey import reader
from echolearn.training.predictions import predict
from echolearn.training.runs import load_runs
from world import HALL, POSES, pack, plans, train, write_set

WINDOW = SearchWindow()


@pytest.fixture(scope="module")
def pairs(tmp_path_factory):
    """Return a folder with a set of two echoes a pose, and a classifier trained on it."""
    runs = tmp_path_factory.mktemp("pairs")
    plan = replace(plans()[1], localizer=Gated(WINDOW, 36, echoes=2))
    train(write_set(plan, runs), "trees_features", seed=0, runs=runs)
    [run] = load_runs(runs)
    return runs, run


def test_the_robot_finds_what_the_laboratory_finds(pairs, world, tmp_path):
    runs, run = pairs
    scorer = load(pack(replace(world, runs=runs), "trees_features", tmp_path))
    assert scorer.bundle.localizer.echoes == 2
    folder = world.runs / "survey" / "hall_0dB"
    walk = reader.read_survey(folder)
    expected = localize_survey(folder, scorer.bundle.localizer, name="two", resamples=9)
    found = scorer.score(walk.observe(range(POSES)), walk.poses)
    assert found.map.points.shape == (2 * POSES, 2) and found.echoes.toa.shape == (POSES, 2)
    assert np.abs(found.map.points - expected.points).max() <= 1e-5
    assert np.abs(found.map.confidence - predict(run, expected.columns)).max() <= 1e-5
    assert np.array_equal(expected.labelled.groups, np.repeat(np.arange(POSES), 2))
    single = localize_survey(folder, Gated(WINDOW, 36), name="one", resamples=9)
    assert expected.labelled.reference.sum() > 1.1 * single.labelled.reference.sum(), (
        "corners have two walls"
    )
    assert 0 < found.map.kept.sum() < 2 * POSES


def test_a_comparison_evaluates_every_echo(pairs, world):
    _, run = pairs
    folder = world.runs / "survey" / "hall_0dB"
    found = evaluate_survey(
        {run.model: [run]},
        folder,
        localizers={"two": Gated(WINDOW, 36, echoes=2)},
        name="two",
        robots={run.data_digest: robot_at(folder)},
        resamples=20,
    )
    assert {row["n"] for row in found.rows} == {2 * POSES}
    [coverage] = [
        r for r in found.rows if (r["classifier"], r["metric"]) == ("oracle", "wall_coverage")
    ]
    assert 0.5 < coverage["value"] <= 1.0
    assert found.survey and np.array_equal(found.survey.walls, outline(HALL))


def test_a_filter_may_look_at_what_stands_beside_the_echo_of_a_wall(world, tmp_path):
    """At rank and neighbours, in sets and bundles of `echoes=auto`; a single echo has none."""
    low = {"size_low": (5.0, 5.0, 2.2), "size_high": (6.0, 6.0, 2.4), "rows": 60}
    plan = replace(plans()[1], localizer=Gated(WINDOW, 36, echoes="auto"), **low)
    dataset = write_set(plan, tmp_path)
    assert len(dataset) == 60 and dataset["rank"].max() >= 1.0 and dataset["rank"].min() == 0.0
    inputs = ["peak_to_rms", "rank", "neighbour_lag", "neighbour_gain"]
    train(dataset, "trees_features", seed=0, runs=tmp_path, inputs=inputs)
    [run] = load_runs(tmp_path)
    scorer = load(pack(replace(world, runs=tmp_path), "trees_features", tmp_path))
    assert list(run.inputs) == list(scorer.bundle.inputs) == inputs
    walk = reader.read_survey(world.runs / "survey" / "hall_0dB")
    assert scorer.score(walk.observe(range(3)), walk.poses[:3]).map.points.shape == (3, 2)
