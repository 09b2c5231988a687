"""Judges of walls compared wall by wall: a few short walks, from sets to tables."""

import csv
from dataclasses import replace

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Room
from echolearn.classifiers.methods.threshold import Threshold
from echolearn.classifiers.methods.trees import Trees
from echolearn.cli.commands import verify_folder
from echolearn.comparison.walk_cells import Cell
from echolearn.comparison.walks import compare_walks, no_better
from echolearn.dataset.generate import folder_of, generate
from echolearn.dataset.hypothesis_records import HypothesisPlan
from echolearn.dataset.labelled_set import Dataset
from echolearn.dataset.walk_plan import WalkPlan
from echolearn.dataset.walk_set import WalkSet
from echolearn.evaluation import wall_scoring
from echolearn.robot.scorer import load
from echolearn.runtime.engines.serial import Serial
from echolearn.simulation.noise.white import White
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.training.export import export
from echolearn.training.split import LearningProblem
from echolearn.training.train import train
from refusals import refused

TRAINING = WalkPlan(
    name="walked",
    seed=5,
    rows=6,
    poses=22,
    paths=("wandering",),
    rooms=("box",),
    odometry=("white",),
    odometry_error=(0.0, 0.01),
    extent=(1.0, 3.0),
    stride=(0.2, 0.4),
    margin=(1.1, 1.4),
    height=(2.5, 4.0),
    t60=(0.3, 0.3),
    wall_factor=(1.0, 1.0),
    snr_db=(-5.0, 5.0),
    window=SearchWindow(1.0, 1.9),
    scene=Scene(circular_array(), noise_probe(burst=500, length=2000), Images(), White()),
    shard_rows=5,
    room=Room((5.0, 4.0, 3.0), 0.3),
)
TEST = replace(TRAINING, seed=6, rows=3, snr_db=(0.0, 0.0), role="test")
CELLS = [
    replace(TEST, name="here_exact", odometry_error=(0.0, 0.0)),
    replace(TEST, name="here_1cm", odometry_error=(0.01, 0.01)),
]
AUDIBLE = 6
"""Poses that must hear a wall."""

JUDGES = {
    "walls_threshold": lambda: Threshold(["evidence_2"]),
    "walls_trees": lambda: Trees(["evidence_2", "relative", "above_3"], iterations=20, min_leaf=3),
    "walls_geometry": lambda: Trees(["poses", "distance_mean"], iterations=20, min_leaf=3),
}


def opened(plan, runs):
    """Return a set of walks with its hypotheses."""
    generate(plan, runs=runs, engine=Serial())
    found = generate(HypothesisPlan(plan, count=8, strips=False), runs=runs, engine=Serial())
    return Cell(WalkSet(folder_of(plan, runs)), Dataset(found))


def fit(name, runs, dataset):
    """Train a judge of walls."""
    problem = LearningProblem(dataset, target="is_wall", test_share=0.2, validation_share=0.4)
    about = {"config": {"name": name}, "runs": runs, "aim": "precision 0.97"}
    train(problem, name=name, classifier=JUDGES[name], **about)


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """Return the folder of runs and the cells; not to be changed."""
    runs = tmp_path_factory.mktemp("runs")
    for name in JUDGES:
        fit(name, runs, opened(TRAINING, runs).hypotheses)
    return runs, [opened(plan, runs) for plan in CELLS]


@pytest.fixture(scope="module")
def compared(world):
    runs, cells = world
    with pytest.MonkeyPatch.context() as patch:
        # The walks are shorter than those that are compared in earnest.
        patch.setattr(wall_scoring, "AUDIBLE", AUDIBLE)
        return compare_walks(cells, name="walls", runs=runs, resamples=50)


def read(folder, name):
    with (folder / name).open() as file:
        return list(csv.DictReader(file))


def pick(rows, **wanted):
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def test_every_judge_and_yardstick_has_its_rows_in_every_cell(compared, world):
    rows = read(compared, "results.csv")
    names = {*JUDGES, "oracle", "exact_poses", "ransac_joint", "hough_joint"}
    for cell in world[1]:
        here = pick(rows, tested_on=cell.name)
        assert {row["classifier"] for row in here} == names
        assert {(row["room"], row["snr_db"]) for row in here} == {("5x4x3", "0")}
    assert {row["odometry_error"] for row in rows} == {"0", "0.01"}
    oracle = pick(rows, classifier="oracle", metric="precision")
    assert [float(row["value"]) for row in oracle] == [1.0, 1.0]
    shares = pick(rows, metric="found")
    found = {(row["classifier"], row["tested_on"]): float(row["value"]) for row in shares}
    for (name, place), value in found.items():
        # Others may find what is not among the hypotheses.
        assert 0.0 <= value <= (found["oracle", place] if name in JUDGES else 1.0)
    # Loud walks along walls: most hypotheses that are walls are found, and exact poses are those of
    # the other cell.
    assert found["walls_threshold", "here_exact"] > 0.5
    [best] = {row["classifier"] for row in read(compared, "tests.csv")} - {"walls_threshold"}
    assert found["exact_poses", "here_1cm"] == found[best, "here_exact"]


def test_a_judge_that_believes_all_that_is_right_finds_what_the_walls_say(compared, world):
    """The oracle's share by a loop over walls, hypotheses and poses."""
    cell = world[1][0]
    data = cell.hypotheses
    audible = found = 0
    for row, truth in enumerate(cell.truths):
        own = data["group"] == row
        walls = data["wall"][own & data["is_wall"]]
        audible += int((truth.heard >= AUDIBLE).sum())
        found += int((truth.heard[walls] >= AUDIBLE).sum())
    rows = pick(read(compared, "results.csv"), tested_on=cell.name, classifier="oracle")
    [share] = [row for row in rows if row["metric"] == "found"]
    assert int(share["walls"]) == audible > 4
    assert float(share["value"]) == pytest.approx(found / audible)


def test_tests_are_paired_over_walks_and_corrected(compared):
    rows = read(compared, "tests.csv")
    [every] = pick(rows, against="walls_geometry", tested_on="all", metric="auc")
    each = pick(rows, against="walls_geometry", metric="auc", classifier="walls_trees")
    cells = [float(row["difference"]) for row in each if row["tested_on"] != "all"]
    # The same walks in both cells are three walks, not six.
    assert every["n"] == "3" and float(every["difference"]) == pytest.approx(
        np.mean(cells), abs=1e-5
    )
    assert all(float(row["p"]) <= float(row["p_holm"]) <= 1.0 for row in rows)
    # Three walks can be swapped in 8 ways: nothing is certain.
    assert min(float(row["p"]) for row in rows) > 0.05


def test_who_does_not_clearly_beat_the_control_is_told_of(compared, capsys):
    warned = read(compared, "warnings.csv")
    assert [row["code"] for row in warned] == ["W07"]
    assert warned[0]["classifier"] == "walls_trees"
    row = {"classifier": "a", "against": "c", "metric": "auc", "tested_on": "all"}
    row |= {"difference": 0.2, "ci_low": 0.1, "ci_high": 0.3, "p_holm": 0.01}
    assert no_better([row], "c") == []
    assert len(no_better([row | {"ci_low": -0.1}], "c")) == 1
    assert len(no_better([row | {"p_holm": 0.2}], "c")) == 1


def test_the_page_tells_cells_and_a_comparison_is_made_once(compared, world, capsys):
    verify_folder(compared)
    before = (compared / "manifest.json").read_bytes()
    runs, cells = world
    assert compare_walks(cells, name="walls", runs=runs, resamples=50) == compared
    table = capsys.readouterr().out
    assert "| dB, cm | 0, 0.0 | 0, 1.0 |" in table and "**W07** walls_trees" in table
    assert (compared / "manifest.json").read_bytes() == before


def test_without_the_control_there_is_no_comparison(world):
    from echolearn.training.variants import Wanted

    runs, cells = world
    wanted = Wanted(("walls_trees-*", "walls_threshold-*"))
    with refused("runs=walls_threshold, walls_trees: must have walls_geometry"):
        compare_walks(cells, name="other", runs=runs, wanted=wanted)
    with refused("walks=[]: must name at least one"):
        compare_walks([], name="other", runs=runs)


def test_a_run_becomes_a_bundle_that_says_what_it_judges(world, tmp_path):
    runs, _ = world
    [run] = (runs / "train").glob("walls_trees-*")
    scene = TRAINING.scene
    about = {"array": scene.array, "probe": scene.probe, "runs": runs, "best": None}
    page = tmp_path / "card.md"
    bundle = load(export(run=run, name="judge", card=page, resamples=50, **about)).bundle
    assert bundle.hypotheses == 8 and bundle.inputs == ("evidence_2", "relative", "above_3")
    assert bundle.localizer.window == TRAINING.window
    assert bundle.about["label"]["true"] == "the line is a wall's, within 2 degrees and 5 cm"
    said = page.read_text()
    assert "6 walks of 22 poses" in said and bundle.about["threshold"]["chosen"] in said
    # The control hears nothing, so it maps nothing.
    [blind] = (runs / "train").glob("walls_geometry-*")
    with refused(f"{runs}/bundles/blind/bundle.json columns=poses, distance_mean: must be some of"):
        export(run=blind, name="blind", resamples=50, **about)
