"""Plans: the numbers of the paper, and rows that depend on their own number alone."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Room
from echolearn.dataset.plans import GridPlan, ScatteredPlan
from echolearn.localization.methods.gated import Gated
from echolearn.simulation.noise.diffuse import Diffuse
from echolearn.simulation.noise.rotor import Rotor
from refusals import refused

CONFIGS = sorted((Path(__file__).parents[2] / "conf" / "plan").glob("*.yaml"))


def configured(path, scene):
    """Build the plan that a YAML file writes down, with this scene."""
    content = yaml.safe_load(path.read_text())
    kind = GridPlan if content.pop("_target_").endswith("GridPlan") else ScatteredPlan
    content.pop("defaults", None)
    # Both are chosen by another group, which is clean by default.
    content.pop("realism")
    content["name"] = content["name"].removesuffix("${realism.suffix}")
    scene = scene if content["sdnr_db"] is None else replace(scene, diffuse=Diffuse(Rotor()))
    for key, noun in (("room", Room), ("window", SearchWindow)):
        if key in content:
            content[key] = noun(**{k: v for k, v in content[key].items() if k != "_target_"})
    return kind(**{**content, "scene": scene, "localizer": Gated(content["window"])})


@pytest.fixture(scope="module")
def plans(scene):
    """Return every configured plan of observations by the name of its file."""
    # Those of walks have no localizer, and tests of their own.
    paths = [path for path in CONFIGS if "WalkPlan" not in path.read_text()]
    return {path.stem: configured(path, scene) for path in paths}


def spots(plan, rows):
    """Draw rows of a plan, each from its own seed."""
    return [
        plan.spot(row, np.random.default_rng(np.random.SeedSequence(plan.seed, spawn_key=(row,))))
        for row in rows
    ]


def place(spot):
    """Return all of a spot as something that compares."""
    return (*replace(spot, pose=None).__dict__.values(), *spot.pose.position, spot.pose.heading)


# ---------------------------------------------------------------- the paper's numbers


def test_the_papers_grid_is_17_x_13_x_9_at_uniform_snr(plans):
    plan = plans["paper"]
    assert [len(np.unique(axis)) for axis in plan.positions.T] == [17, 13, 9]
    assert len(plan) == 17 * 13 * 9 == 1989
    assert plan.positions.min(axis=0).tolist() == [1, 1, 1]
    assert plan.positions.max(axis=0).tolist() == [9, 7, 5]
    drawn = spots(plan, range(1989))
    assert [spot.group for spot in drawn] == list(range(1989))
    levels = np.array([spot.levels.snr_db for spot in drawn])
    assert np.abs(levels).max() <= 40
    counts, _ = np.histogram(levels, 8, (-40, 40))
    assert (np.abs(counts - 1989 / 8) < 5 * np.sqrt(1989 / 8)).all()


def test_the_planar_reading_is_221_positions_at_9_snrs(plans):
    plan = plans["paper_planar"]
    drawn = spots(plan, range(len(plan)))
    assert len(drawn) == 221 * 9 == 1989
    assert {spot.pose.position[2] for spot in drawn} == {3.5}
    assert [spot.levels.snr_db for spot in drawn[:9]] == list(range(-40, 41, 10))
    assert np.bincount([spot.group for spot in drawn]).tolist() == [9] * 221
    assert plan.room.walls[4:] == (0.0, 0.0)


# ---------------------------------------------------------------- rows


def test_rows_depend_on_their_number_and_the_seed_alone(plans):
    for plan in plans.values():
        ahead = [place(spot) for spot in spots(plan, range(12))]
        assert ahead == [place(spot) for spot in spots(plan, range(11, -1, -1))][::-1]
        if plan.snr_db is not None:
            assert ahead[0] != place(spots(replace(plan, seed=99), [0])[0])


def test_scattered_rows_stay_in_their_ranges_and_fill_them(plans):
    plan = plans["scattered"]
    drawn = spots(plan, range(1500))
    assert [spot.group for spot in drawn] == list(range(1500))
    size = np.array([spot.room.size for spot in drawn])
    margins = np.array([spot.pose.position for spot in drawn])
    assert (margins >= plan.margin).all()
    assert (size - margins >= plan.margin).all()
    values = [
        ([spot.room.t60 for spot in drawn], *plan.t60),
        ([spot.levels.snr_db for spot in drawn], *plan.snr_db),
        ([spot.gain_db for spot in drawn], *plan.gain_db),
        ([spot.pose.heading for spot in drawn], -np.pi, np.pi),
        ([spot.room.walls for spot in drawn], *plan.wall_factor),
        *zip(size.T, plan.size_low, plan.size_high, strict=True),
    ]
    for value, low, high in values:
        edge = 0.02 * (high - low)
        assert low <= np.min(value) < low + edge
        assert high - edge < np.max(value) <= high


def test_rotor_noise_has_a_level_of_its_own_and_changes_nothing_else_about_a_row(plans):
    plan = plans["scattered_rotor"]
    drawn = spots(plan, range(1000))
    sdnr = np.array([spot.levels.sdnr_db for spot in drawn])
    snr = np.array([spot.levels.snr_db for spot in drawn])
    assert -40 <= sdnr.min() < -39
    assert 39 < sdnr.max() <= 40
    assert abs(np.corrcoef(sdnr, snr)[0, 1]) < 5 / np.sqrt(1000)
    quiet = replace(plan, sdnr_db=None, scene=replace(plan.scene, diffuse=None))
    for without, spot in zip(spots(quiet, range(9)), drawn[:9], strict=True):
        silent = replace(spot, levels=replace(spot.levels, sdnr_db=None))
        assert place(without) == place(silent)


def test_sensor_noise_may_be_absent_where_rotors_are_present(plans):
    alone = replace(plans["scattered_rotor"], snr_db=None)
    grid = replace(plans["paper"], snr_db=None, sdnr_db=(-10.0, 0.0), scene=alone.scene)
    for plan in (alone, grid):
        assert {spot.levels.snr_db for spot in spots(plan, range(3))} == {None}
    assert all(-10 <= spot.levels.sdnr_db <= 0 for spot in spots(grid, range(3)))


def test_scattered_wall_distances_cannot_be_memorised(plans):
    """On the grid three distances fall into 1 ... 2 m; scattered rows have as many as rows."""
    for name, least, most in (("paper", 3, 3), ("scattered", 201, 400)):
        nearest = [
            np.minimum(s.pose.position, s.room.size - s.pose.position).min()
            for s in spots(plans[name], range(400))
        ]
        distinct = np.unique(np.round([d for d in nearest if d <= 2.0], 6))
        assert least <= len(distinct) <= most


# ---------------------------------------------------------------- what is refused


BAD = {
    "paper": {
        "plan.step=0 m: must be a number from 0.01": {"step": 0},
        "plan.step=half m": {"step": "half"},
        "plan.margin=4.5 m": {"margin": 4.5},
        "pose.position=(0.1, 0.1, 0.1) m: the array of radius 0.2 m": {"margin": 0.1},
        "plan.height=7.0 m": {"height": 7.0},
        "plan.snr_db=[40.0, -40.0]": {"snr_db": (40.0, -40.0)},
        "plan.snr_db=-400.0 dB": {"snr_db": (-400.0, 40.0)},
        "plan.snr_db=None": {"snr_db": None},
        "plan.snr_db=": {"snr_levels": (0.0,)},
        "plan.snr_levels=loud dB": {"snr_db": None, "snr_levels": ("loud",)},
        "plan.seed=-1": {"seed": -1},
        "plan.seed=0.5": {"seed": 0.5},
        "plan.shard_rows=0 rows": {"shard_rows": 0},
        "plan.name=../paper": {"name": "../paper"},
        "plan.role=exam: must be training or grid or test": {"role": "exam"},
        "plan.further=covariance: must be a list of names": {"further": "covariance"},
        "plan.further=['toa']: must be some of level, ": {"further": ["toa"]},
    },
    "scattered": {
        "plan.rows=0": {"rows": 0},
        "plan.t60=[0.9, 0.3]": {"t60": (0.9, 0.3)},
        "room.t60=0.1 s": {"t60": (0.1, 0.3)},
        "plan.margin=0.1 m": {"margin": 0.1},
        "plan.margin=1.6 m": {"margin": 1.6},
        "plan.size_low=[15.0, 14.0]": {"size_low": (15.0, 5.0, 3.0)},
        "plan.wall_factor=1.5": {"wall_factor": (0.5, 1.5)},
        "plan.gain_db=[0.0]": {"gain_db": (0.0,)},
        "plan.sdnr_db=-10.0 dB: must be null in a scene without diffuse noise; choose": {
            "sdnr_db": (-10.0, 0.0)
        },
        "plan.snr_db=None: must be a level in dB where there is no other noise": {"snr_db": None},
    },
    "scattered_rotor": {
        "plan.sdnr_db=None: must be a level in dB, as the scene has diffuse noise": {
            "sdnr_db": None
        },
        "plan.sdnr_db=[0.0, -10.0]": {"sdnr_db": (0.0, -10.0)},
        "plan.sdnr_db=-10.0: must be two numbers": {"sdnr_db": -10.0},
    },
}


@pytest.mark.parametrize(("name", "said"), [(name, said) for name in BAD for said in BAD[name]])
def test_bad_plans_are_refused_in_one_line(plans, name, said):
    with refused(said):
        replace(plans[name], **BAD[name][said])


@pytest.mark.parametrize("far", [(9.9, 8.0, 6.0), (10.0, 8.0, 6.0)])
def test_every_position_of_a_grid_lies_inside(plans, far):
    """A grid that starts inside ends inside: its margin holds on the far side too."""
    places = replace(plans["paper"], room=Room(far, 0.6), step=0.7, margin=0.3).positions
    assert (places >= 0.3 - 1e-9).all()
    assert (np.array(far) - places >= 0.3 - 1e-9).all()


def test_a_layer_outside_the_room_is_refused_wherever_the_grid_is(plans):
    plan = plans["paper_planar"]
    assert len(replace(plan, height=0.1)) == 1989  # the ring is flat
    with refused("pose.position="):
        replace(plan, height=0.0)
