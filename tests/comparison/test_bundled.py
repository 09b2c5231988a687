"""Bundles in a comparison: the same figures as the run they are of, or a row that says why none."""

import csv
import re
import shutil
from pathlib import Path
from typing import Any

import pytest

import world as small
from by_hand import edit
from echolearn.acoustics.geometry import circular_array
from echolearn.checks import BadValue
from echolearn.comparison.compare import compare, load_inputs
from echolearn.comparison.evaluate import evaluate
from echolearn.comparison.fitting import robot_in, split_fitting
from echolearn.evaluation.rows import (
    BUNDLE,
    MISSING_COLUMNS,
    OTHER_ARRAY,
    OWN_SET,
    pick,
)
from echolearn.training.export import find_run
from refusals import refused

TREES = "trees_features"
ITS_ROW = "small (bundle)"


@pytest.fixture
def runs(world, packed, tmp_path):
    """Return a copy of the world's sets and runs with a bundle beside them."""
    made = tmp_path / "runs"
    for part in ("data", "train"):
        shutil.copytree(world.runs / part, made / part)
    shutil.copytree(packed, made / "bundles" / "small")
    yield made


def rows_of(world, runs, **changes):
    """Return the rows of a comparison on one set that nobody knows, and what is asked for."""
    asked: dict[str, Any] = {"tested": ["offgrid_hall"], "surveys": [], "bundles": ["small"]}
    localizers = {"gated": world.arguments["localizers"]["gated"]}
    inputs = load_inputs(runs, localizers=localizers, **asked | changes)
    return list(evaluate(inputs, resamples=30, workers=1).rows)


def figures(rows, **wanted):
    """Return values by what a row is about, but for who it is about."""
    found = pick(rows, **wanted)
    about = ("tested_on", "kind", "localizer", "seed", "snr_db", "metric", "n")
    return {tuple(row[key] for key in about): row["value"] for row in found}


def test_a_bundle_says_of_sets_and_surveys_what_its_run_says(world, runs):
    walks = [str(world.runs / "survey" / name) for name in small.WALKS]
    heard = Path(shutil.copytree(walks[0], runs / "recorded"))
    for name in ("manifest.json", "simulated.json"):
        (heard / name).unlink()
    edit(heard, conditions={"room": "recorded", "snr_db": 0.0})
    tested = ["offgrid_hall", "scattered", "grid"]
    rows = rows_of(world, runs, tested=tested, surveys=[*walks, str(heard)])
    # The scattered set is its own: both are judged on the rows that the run held out.
    its, that = figures(rows, classifier=ITS_ROW), figures(rows, classifier=TREES)
    assert its.keys() == that.keys()
    assert {key[:2] for key in its} >= {(name, "set") for name in tested}
    assert {key[1] for key in its} == {"set", "survey", "measured"}
    for key, value in that.items():
        assert its[key] == pytest.approx(value, abs=1e-6, nan_ok=True), key
    [role] = {row["role"] for row in pick(rows, classifier=ITS_ROW)}
    assert role == BUNDLE


def test_without_its_run_a_bundle_is_not_judged_on_its_own_set(world, runs):
    [own] = (runs / "train").glob(f"{TREES}-scattered-*")
    shutil.rmtree(own)
    rows = rows_of(world, runs, tested=["offgrid_hall", "scattered"])
    [said] = pick(rows, classifier=ITS_ROW, tested_on="scattered")
    assert (said["metric"], said["n"]) == (OWN_SET, 0)
    assert pick(rows, classifier=ITS_ROW, tested_on="offgrid_hall", metric="auc", snr_db="")


def test_a_bundle_for_another_array_is_a_row_that_says_so(world, runs):
    """On the map of a walk, too, where others are judged."""
    wide = circular_array(radius=0.3).positions.tolist()
    walk = Path(shutil.copytree(world.runs / "survey" / small.WALKS[0], runs / "wide"))
    for name in ("manifest.json", "simulated.json"):
        (walk / name).unlink()
    edit(walk, microphones=wide, map=False, walls=...)
    # Of a few recordings nobody tells that these are not its microphones.
    table = (walk / "poses.csv").read_text().splitlines()
    (walk / "poses.csv").write_text("\n".join(table[:4]) + "\n")
    truth = "index,toa_s,azimuth_rad,elevation_rad\n0,0.01,0,1.5707\n"
    (walk / "truth.csv").write_text(truth)
    rows = rows_of(world, runs, surveys=[str(walk)])
    [said] = pick(rows, classifier=ITS_ROW, kind="measured")
    assert said["metric"] == OTHER_ARRAY


def test_who_looks_at_columns_that_are_not_there_is_a_row_that_says_so(world, runs):
    scattered = world.sets["scattered"]
    inputs = load_inputs(
        runs, tested=["offgrid_hall"], surveys=[], localizers={}, bundles=["small"]
    )
    robot = robot_in(scattered.manifest["plan"]["scene"])
    lacking = {"holds": lambda names: "joint" not in names}
    fitting, unfit = split_fitting(inputs.models, inputs.robots, tested=robot, **lacking)
    assert {model.classifier: why for model, why in unfit.items()} == {
        TREES: MISSING_COLUMNS,
        ITS_ROW: MISSING_COLUMNS,
    }
    assert {model.classifier for model in fitting} == {"svm_pair", "threshold_peak"}


def test_a_comparison_shows_bundles_and_never_chooses_one(world, runs):
    shared: dict[str, Any] = {
        "tested": ["offgrid_hall"],
        "surveys": [str(world.runs / "survey" / small.WALKS[1])],
        "localizers": {"gated": world.arguments["localizers"]["gated"]},
        "resamples": 30,
        "runs": runs,
    }
    folder = compare(name="both", bundles=["small"], **shared)
    with (folder / "results.csv").open(newline="") as file:
        found = list(csv.DictReader(file))
    its = [row for row in found if row["classifier"] == ITS_ROW]
    assert {row["kind"] for row in its} == {"set", "survey"}
    assert {(row["role"], row["method"], row["trained_on"]) for row in its} == {
        (BUNDLE, BUNDLE, "scattered")
    }
    assert f"| {ITS_ROW} |" in (folder / "table.md").read_text()
    assert re.search(
        rf"<td>[^\n]*{re.escape(ITS_ROW)}</span>", (folder / "report.html").read_text()
    )
    assert find_run(None, folder).model.role == "learned"

    before = (folder / "results.csv").read_bytes()
    compare(name="both", **shared)
    after = (folder / "results.csv").read_bytes()
    without = [line for line in before.splitlines() if ITS_ROW.encode() not in line]
    assert after.splitlines() == without


def test_what_is_no_bundle_or_a_second_of_its_name_is_refused(world, runs, tmp_path):
    with refused(
        "bundles=best: must be a folder that echolearn export wrote, or the name of a bundl"
    ):
        rows_of(world, runs, bundles=["best"])
    twin = Path(shutil.copytree(runs / "bundles" / "small", tmp_path / "elsewhere"))
    with refused(f"bundles={twin}: must be bundles of different names; another one is called sm"):
        rows_of(world, runs, bundles=["small", str(twin)])
    with pytest.raises(BadValue, match=r"model.onnx=damaged: must have the size and SHA-256"):
        (twin / "model.onnx").write_bytes(b"")
        rows_of(world, runs, bundles=[str(twin)])
