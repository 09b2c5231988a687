"""Sets of several echoes: in a corner two walls answer, and both come onto the map."""

from dataclasses import replace

import numpy as np
import pytest

from echolearn.acoustics.bistatic import wall_points
from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.rooms import outline
from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.types import Room
from echolearn.dataset.generate import generate
from echolearn.dataset.labelled_set import Dataset
from echolearn.dataset.plans import GridPlan
from echolearn.dataset.records import records
from echolearn.evaluation.matching import match_echoes
from echolearn.localization.methods.em import Em
from echolearn.localization.methods.joint import Joint
from echolearn.runtime.engines.serial import Serial

WINDOW = SearchWindow()
TALL = Room((6.0, 5.0, 6.0), 0.3)
"""Floor and ceiling 3 m from a robot at mid-height: outside the window."""


@pytest.fixture(scope="module")
def corner(brief):
    """Return the four corners of a room, 1.2 m from both walls, loud and quiet."""
    two = Joint(WINDOW, echoes=2)
    return GridPlan("corner", 0, TALL, 2.6, 1.2, WINDOW, brief, two, 3.0, None, (30.0, -5.0), 5)


@pytest.mark.parametrize("localizer", [Joint(WINDOW, echoes=2), Em(WINDOW, echoes=2)])
def test_a_corner_gives_two_map_points(corner, localizer):
    table = records(replace(corner, localizer=localizer), range(len(corner)))
    loud = table[table["snr_db"] == 30.0]
    assert loud["reflector"].all() and loud["on_map"].all()
    points = map_points(loud, corner)
    for first, second in zip(points[::2], points[1::2], strict=True):
        walls = [
            np.minimum(abs(p), abs(p - np.array(TALL.size[:2]))).argmin() for p in (first, second)
        ]
        assert sorted(walls) == [0, 1]  # one on a wall across x, one across y


def map_points(table, plan):
    return wall_points(
        table["toa"],
        table["azimuth"],
        table["elevation"],
        position=table["position"],
        heading=table["heading"],
        array=plan.scene.array,
    )


def test_records_go_echo_by_echo_and_no_wall_counts_twice(corner):
    table = records(corner, range(len(corner)))
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


def test_a_wall_that_is_found_twice_is_one_reflector(corner):
    """With more echoes than walls in reach, what is left over cannot be a reflector for a wall that
    has its echo."""
    table = records(replace(corner, localizer=Joint(WINDOW, echoes=4)), range(2)).reshape(2, 4)
    for echoes in table:
        found = echoes["wall"][echoes["wall"] >= 0]
        assert len(found) == len(set(found))


def test_a_set_of_two_echoes_has_all_of_them(corner, tmp_path):
    found = Dataset(generate(corner, runs=tmp_path, engine=Serial()))
    assert len(found) == 2 * len(corner) == len(found["toa"])
    assert np.array_equal(found["echo"], np.tile([0, 1], len(corner)))
