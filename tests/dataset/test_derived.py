"""The label of time and direction: derived from a set's records, it is what a slow look at every
wall says."""

from dataclasses import replace

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.rooms import true_echoes
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import MicArray, Pose, Room
from echolearn.dataset.plans import GridPlan, ScatteredPlan
from echolearn.localization.localize import localize
from echolearn.localization.methods.gated import Gated
from echolearn.simulation.noise.white import White
from echolearn.simulation.observe import observe
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.training.split import LearningProblem
from world import write_set

WINDOW = SearchWindow()
SHARED = {
    "window": WINDOW,
    "scene": Scene(circular_array(), noise_probe(length=5000), Images(), White()),
    "localizer": Gated(WINDOW, 36),
}
LOW = Room((5.0, 4.0, 2.6), 0.25, (1.0, 1.0, 1.0, 1.0, 0.0, 1.0))
PLANS = {
    "scattered": ScatteredPlan(
        "scattered", 2, 40, (4.0, 4.0, 2.6), (6.0, 5.0, 3.5), (0.2, 0.3), 1.0, **SHARED
    ),
    "without a floor": GridPlan("grid", 1, LOW, 0.7, 1.0, **SHARED),
    "several": ScatteredPlan(
        "several",
        3,
        20,
        (4.0, 4.0, 2.6),
        (6.0, 5.0, 3.5),
        (0.2, 0.3),
        1.0,
        **SHARED | {"localizer": Gated(WINDOW, 36, echoes=3)},
    ),
}


def angle(first, second):
    """Return the angle between two directions, each azimuth and elevation, in rad."""
    a, b = (
        np.array([np.sin(e) * np.cos(p), np.sin(e) * np.sin(p), np.cos(e)])
        for p, e in (first, second)
    )
    return float(np.arccos(np.clip(a @ b, -1, 1)))


def looked_at(dataset, row, plan):
    """Tell whether an echo is true, wall by wall."""
    size = tuple(dataset["room"][row])
    walls = plan.room.walls if isinstance(plan, GridPlan) else (1.0,) * 6
    pose = Pose(dataset["position"][row], float(dataset["heading"][row]))
    truth = true_echoes(Room(size, 0.5, walls), pose, array=plan.scene.array)
    several = plan.localizer.echoes > 1
    own = [int(dataset["wall"][row])] if several else range(len(truth.toa))
    for wall in own:
        if wall < 0 or abs(truth.toa[wall] - dataset["toa"][row]) * 22050 >= 10:
            continue
        there = np.array([truth.azimuth[wall], truth.elevation[wall]])
        here = np.array([dataset["azimuth"][row], dataset["elevation"][row]])
        turned = abs(np.angle(np.exp(1j * (there[0] - here[0]))))
        upright = np.sin(there[1]) < np.sin(np.deg2rad(10))
        # A level ring hears no difference between above and below.
        mirrored = np.array([there[0], np.pi - there[1]])
        beside = min(angle(there, here), angle(mirrored, here))
        if (beside if upright else turned) <= np.deg2rad(10):
            return True
    return False


@pytest.mark.parametrize("name", PLANS)
def test_the_label_is_what_a_look_at_each_wall_says(name, tmp_path):
    plan = PLANS[name]
    dataset = write_set(plan, tmp_path)
    label = dataset["time_and_direction"]
    assert label.tolist() == [looked_at(dataset, row, plan) for row in range(len(dataset))]
    assert label.dtype == bool and 0 < label.sum() < dataset["reflector"].sum()
    some = np.array([7, 3])
    assert dataset.gather("time_and_direction", some).tolist() == label[some].tolist()
    problem = LearningProblem(dataset, target="time_and_direction")
    assert np.array_equal(problem.labels(), label)


def test_an_array_beside_its_loudspeaker_holds_the_label_itself(tmp_path):
    """Its directions are seen from its own middle, of which the records say nothing."""
    beside = MicArray(circular_array().positions + np.array([0.3, 0.0, 0.0]))
    plan = replace(PLANS["scattered"], scene=replace(SHARED["scene"], array=beside), rows=12)
    dataset = write_set(plan, tmp_path)
    assert "time_and_direction" in np.load(next(dataset.folder.glob("*.npy"))).dtype.names
    label = dataset["time_and_direction"]
    assert label.tolist() == [looked_at(dataset, row, plan) for row in range(len(dataset))]


def test_candidates_of_a_set_are_those_that_a_robot_makes_of_a_recording(tmp_path):
    plan = PLANS["several"]
    dataset = write_set(plan, tmp_path)
    rows = np.array([14, 3, 13])  # of the 5th and the 2nd observation
    found = dataset.gather("candidates", rows)
    for row, tensor in zip(rows, found, strict=True):
        rng = np.random.default_rng(np.random.SeedSequence(plan.seed, spawn_key=(row // 3,)))
        spot = plan.spot(row // 3, rng)
        about = {"scene": plan.scene, "levels": spot.levels, "rng": rng, "gain_db": spot.gain_db}
        heard, _ = observe(spot.room, spot.pose, **about)
        alone = replace(heard, samples=heard.samples[None])
        _, columns = localize(alone, plan.localizer, names=["candidates"])
        assert np.allclose(columns["candidates"][row % 3], tensor, rtol=1e-3, atol=1e-4)
    assert dataset.holds(["candidates"]) and dataset.echoes == 3
    assert np.array_equal(dataset["candidates"][rows], found)
    # An echo alone has no company.
    alone = write_set(PLANS["without a floor"], tmp_path)["candidates"]
    assert (alone[:, 0, 0] == 1).all() and not alone[:, 1:].any()
