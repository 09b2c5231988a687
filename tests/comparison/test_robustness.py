"""The same positions under another condition: found by themselves, differences paired."""

from dataclasses import replace

import numpy as np
import pytest

from echolearn.comparison.compare import load_inputs
from echolearn.comparison.evaluate import evaluate_conditions
from echolearn.comparison.robustness import COLUMNS, locked_on, under_conditions
from echolearn.evaluation.metrics import auc
from echolearn.evaluation.rows import pick
from echolearn.training.predictions import predict_rows
from world import plans, write_set


@pytest.fixture(scope="module")
def inputs(world, tmp_path_factory):
    """Return the world's runs with a test set, the same louder, at another level, and another."""
    runs = tmp_path_factory.mktemp("conditions")
    usual = replace(plans()[2], rows=50)
    quiet = replace(usual, name="quiet", snr_db=(-12.0, -12.0))
    louder = replace(usual, name="louder", gain_db=(12.0, 12.0))
    moved = replace(usual, name="moved", seed=9)
    found = [write_set(plan, runs) for plan in (usual, louder, quiet, moved)]
    known = load_inputs(world.runs, tested=["scattered"], surveys=[], localizers={})
    return replace(known, sets={dataset.name: dataset for dataset in found})


def test_sets_of_the_same_positions_are_found(inputs):
    assert under_conditions(inputs.sets) == {"louder": "offgrid_hall", "quiet": "offgrid_hall"}


def test_a_gain_changes_no_filter_of_ratios_and_noise_changes_all(inputs):
    rows = evaluate_conditions(inputs, resamples=30)
    assert all({*row} == {*COLUMNS.split()} for row in rows)
    about = {"trained_on": "scattered", "classifier": "threshold_peak"}
    [louder] = pick(rows, tested_on="louder", **about)
    assert [louder[key] for key in ("difference", "ci_low", "ci_high")] == pytest.approx([0, 0, 0])
    assert louder["ceiling_difference"] == 0

    # By hand, over the two seeds.
    [quiet] = pick(rows, tested_on="quiet", **about)
    models = [model for model in inputs.models if pick([model._asdict()], **about)]
    areas = {
        name: np.mean(
            [
                auc(inputs.sets[name]["reflector"], predict_rows(run, inputs.sets[name]).confidence)
                for model in models
                for run in inputs.models[model]
            ]
        )
        for name in ("quiet", "offgrid_hall")
    }
    assert quiet["auc"] == pytest.approx(areas["quiet"])
    assert quiet["difference"] == pytest.approx(areas["quiet"] - areas["offgrid_hall"])
    assert quiet["ci_low"] < quiet["difference"] < quiet["ci_high"]
    assert quiet["ceiling"] < louder["ceiling"]


def test_where_positions_were_trained_at_only_those_held_out_count(inputs, world, tmp_path):
    trained = load_inputs(world.runs, tested=["scattered"], surveys=[], localizers={})
    [scattered] = [plan for plan in plans() if plan.name == "scattered"]
    louder = write_set(replace(scattered, name="louder", gain_db=(12.0, 12.0)), tmp_path)
    both = replace(trained, sets={**trained.sets, "louder": louder})
    rows = pick(evaluate_conditions(both, resamples=30), trained_on="scattered")
    assert {row["tested_on"] for row in rows} == {"louder"}

    about = {"trained_on": "scattered", "classifier": "threshold_peak", "target": "reflector"}
    [row] = pick(rows, **about)
    [model] = [each for each in both.models if pick([each._asdict()], **about)]
    answers = [predict_rows(run, louder, held_out=True) for run in both.models[model]]
    assert all(0 < len(each.rows) < len(louder) / 2 for each in answers)
    areas = [auc(louder["reflector"][each.rows], each.confidence) for each in answers]
    assert row["auc"] == pytest.approx(np.mean(areas))


def test_locked_is_what_is_within_two_samples_of_an_echo(inputs):
    dataset = inputs.sets["offgrid_hall"]
    told = locked_on(dataset)
    truth = dataset["truth_toa"]
    for row in range(len(dataset)):
        away = np.abs(truth[row][np.isfinite(truth[row])] - dataset["toa"][row]).min() * 22050
        assert told[row] == (away <= 2)
    assert 0 < told.mean() < 1 and (dataset["reflector"][told == 1]).all()
