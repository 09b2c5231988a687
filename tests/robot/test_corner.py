"""Several echoes from the set to the robot: in a corner two walls answer, and both come onto the
map."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow, distance_to_outline, outline, wall_points
from echolearn.acoustics.types import Array, Room
from echolearn.comparison.evaluate import evaluate_survey
from echolearn.comparison.localized import localize_survey
from echolearn.dataset.generate import generate
from echolearn.dataset.labelled_set import Dataset
from echolearn.dataset.plans import GridPlan, Plan
from echolearn.dataset.records import records
from echolearn.evaluation.matching import match_echoes
from echolearn.localization.methods.em import Em
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.joint import Joint
from echolearn.robot.scorer import load
from echolearn.runtime.engines.processes import Processes
from echolearn.runtime.engines.serial import Serial
from echolearn.simulation.scene import Scene
from echolearn.survey import reader
from echolearn.training.predictions import predict
from echolearn.training.runs import Run, load_runs
from world import HALL, POSES, World, pack, plans, train, write_set

WINDOW = SearchWindow()
TALL = Room((6.0, 5.0, 6.0), 0.3)
"""Floor and ceiling 3 m from a robot at mid-height: outside the window."""


@pytest.fixture(scope="module")
def corner(brief: Scene) -> GridPlan:
    """Return the four corners of a room, 1.2 m from both walls, loud and quiet."""
    return GridPlan(
        "corner",
        0,
        TALL,
        2.6,
        1.2,
        WINDOW,
        brief,
        Joint(WINDOW, echoes=2),
        3.0,
        None,
        (30.0, -5.0),
        5,
    )


@pytest.mark.parametrize("localizer", [Joint(WINDOW, echoes=2), Em(WINDOW, echoes=2)])
def test_a_corner_gives_two_map_points(corner: GridPlan, localizer: Joint | Em) -> None:
    table = records(replace(corner, localizer=localizer), range(len(corner)))
    loud = table[table["snr_db"] == 30.0]
    assert loud["reflector"].all() and loud["on_map"].all()
    points = map_points(loud, corner)
    for first, second in zip(points[::2], points[1::2], strict=True):
        walls = [
            np.minimum(abs(p), abs(p - np.array(TALL.size[:2]))).argmin() for p in (first, second)
        ]
        assert sorted(walls) == [0, 1]  # one on a wall across x, one across y


def map_points(table: Array, plan: Plan) -> Array:
    return wall_points(
        table["toa"],
        table["azimuth"],
        table["elevation"],
        position=table["position"],
        heading=table["heading"],
        array=plan.scene.array,
    )


def test_records_go_echo_by_echo_and_no_wall_counts_twice(corner: GridPlan) -> None:
    table = records(corner, range(len(corner)))
    assert len(table) == 2 * len(corner)
    assert np.array_equal(table["echo"], np.tile([0, 1], len(corner)))
    assert np.array_equal(table["group"], np.repeat(np.arange(len(corner)) // 2, 2))
    assert (table["gain"][::2] >= table["gain"][1::2]).all()
    assert np.array_equal(table["reflector"], table["wall"] >= 0)
    for first, second in zip(table[::2], table[1::2], strict=True):
        assert first["wall"] != second["wall"] or first["wall"] == -1
        truth = first["truth_toa"][np.isfinite(first["truth_toa"])]
        toa = np.array([first["toa"], second["toa"]])
        assert np.array_equal(
            match_echoes(truth, toa, tolerance=10 / 22050.0), [first["wall"], second["wall"]]
        )
    near = distance_to_outline(map_points(table, corner), outline(TALL)) <= 0.10
    assert np.array_equal(table["on_map"], near)


def test_a_wall_that_is_found_twice_is_one_reflector(corner: GridPlan) -> None:
    """With more echoes than walls in reach, what is left over cannot be a reflector for a wall that
    has its echo."""
    table = records(replace(corner, localizer=Joint(WINDOW, echoes=4)), range(2)).reshape(2, 4)
    for echoes in table:
        found = echoes["wall"][echoes["wall"] >= 0]
        assert len(found) == len(set(found))


def test_a_set_of_two_echoes_is_whole_and_the_same_from_any_worker(
    corner: GridPlan, tmp_path: Path
) -> None:
    one = generate(corner, runs=tmp_path / "one", engine=Serial())
    two = generate(corner, runs=tmp_path / "two", engine=Processes(2))
    found = Dataset(one)
    assert len(found) == 2 * len(corner) == len(found["toa"])
    assert {path.name: path.read_bytes() for path in one.iterdir()} == {
        p.name: p.read_bytes() for p in two.iterdir()
    }


@pytest.fixture(scope="module")
def pairs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Run]:
    """Return a folder with a set of two echoes a pose, and a classifier trained on it."""
    runs = tmp_path_factory.mktemp("pairs")
    plan = replace(plans()[1], localizer=Gated(WINDOW, 36, echoes=2))
    train(write_set(plan, runs), "trees_features", seed=0, runs=runs)
    [run] = load_runs(runs)
    return runs, run


def test_the_robot_hears_what_the_laboratory_hears(
    pairs: tuple[Path, Run], world: World, tmp_path: Path
) -> None:
    runs, run = pairs
    scorer = load(pack(replace(world, runs=runs), "trees_features", tmp_path))
    assert scorer.bundle.localizer.echoes == 2
    folder = world.runs / "survey" / "hall_0dB"
    walk = reader.read_survey(folder)
    heard = localize_survey(folder, scorer.bundle.localizer, name="two", resamples=9)
    found = scorer.score(walk.observe(range(POSES)), walk.poses)
    assert found.map.points.shape == (2 * POSES, 2) and found.echoes.toa.shape == (POSES, 2)
    assert np.abs(found.map.points - heard.points).max() <= 1e-5
    assert np.abs(found.map.confidence - predict(run, heard.columns)).max() <= 1e-5
    assert np.array_equal(heard.labelled.groups, np.repeat(np.arange(POSES), 2))
    single = localize_survey(folder, Gated(WINDOW, 36), name="one", resamples=9)
    assert heard.labelled.reference.sum() > 1.1 * single.labelled.reference.sum(), (
        "corners have two walls"
    )
    assert 0 < found.map.kept.sum() < 2 * POSES


def test_a_comparison_evaluates_every_echo(pairs: tuple[Path, Run], world: World) -> None:
    _, run = pairs
    found = evaluate_survey(
        {run.model: [run]},
        world.runs / "survey" / "hall_0dB",
        localizer=Gated(WINDOW, 36, echoes=2),
        name="two",
        paired=False,
        resamples=20,
    )
    assert {row["n"] for row in found.rows} == {2 * POSES}
    [coverage] = [
        r for r in found.rows if (r["classifier"], r["metric"]) == ("oracle", "wall_coverage")
    ]
    assert 0.5 < coverage["value"] <= 1.0
    assert found.survey and np.array_equal(found.survey.corners, outline(HALL))
