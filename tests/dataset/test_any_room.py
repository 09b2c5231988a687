"""Sets and surveys of rooms that are no boxes: where positions lie, what is true, what is heard."""

from dataclasses import replace

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.polygon_room import PolygonRoom
from echolearn.acoustics.rooms import outline, true_echoes
from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.types import Pose
from echolearn.dataset.plans import GridPlan
from echolearn.dataset.records import records
from echolearn.localization.methods.joint import Joint
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.rir.images import Images
from echolearn.simulation.survey import survey
from echolearn.survey.reader import read_survey
from refusals import refused

PILLAR = ((2.5, 2.5), (2.9, 2.5), (2.9, 2.9), (2.5, 2.9))
ROOM = PolygonRoom(
    ((-1.0, 1.0), (8.0, 1.0), (8.0, 5.5), (4.0, 5.5), (4.0, 9.0), (-1.0, 9.0)),
    6.0,
    0.4,
    pillars=(PILLAR,),
    doors=((0, 4.5, 7.5),),
)
WINDOW = SearchWindow()


@pytest.fixture(scope="module")
def plan(brief):
    """Return a grid in an L of 6 m height, loud."""
    scene = replace(brief, rir=Images())
    return GridPlan("l", 0, ROOM, 0.9, 1.2, WINDOW, scene, Joint(WINDOW), 3.0, None, (30.0,), 5)


def test_positions_are_those_of_the_grid_off_walls_and_pillars(plan):
    x, y, z = plan.positions.T
    assert np.allclose(x, 0.2 + 0.9 * np.round((x - 0.2) / 0.9)) and (z == 3.0).all()
    away = distance_to_outline(plan.positions[:, :2], ROOM.faces[0])
    assert away.min() >= 1.2 - 1e-9 and len(plan) == len(plan.positions) > 15
    # In either leg, and on either side of the pillar.
    assert (y > 6.0).any() and (x > 5.0).any() and (x < 1.5).any()
    with refused("plan.margin=3 m: must leave at least one position off all walls"):
        replace(plan, margin=3.0)
    with refused("plan.margin=5.0 m: must be a number from 0 to 3 m"):
        replace(plan, margin=5.0)


def test_echoes_that_are_found_are_true_ones(plan):
    """Of pillars, too, and none of a door; the truth has a column for every wall that may be."""
    table = records(plan, range(len(plan)))
    assert table["truth_toa"].shape == (len(plan), len(outline(ROOM)) + 2)
    for row in table:
        truth = true_echoes(ROOM, Pose(row["position"]), array=plan.scene.array).toa
        assert np.array_equal(row["truth_toa"][: len(truth)], truth)
        assert np.isnan(row["truth_toa"][len(truth) :]).all()
    lags = table["truth_toa"] * 22050.0
    first, last = WINDOW.lags(plan.scene.array, 22050.0)
    in_reach = ((lags >= first) & (lags <= last)).any(axis=1)
    assert in_reach.mean() > 0.5
    assert table["reflector"][in_reach].mean() > 0.95 and table["on_map"][in_reach].mean() > 0.9
    assert table["reflector"][~in_reach].mean() < 0.3
    assert table["room"].tolist() == [[9.0, 8.0, 6.0]] * len(plan)


def test_a_survey_of_it_reads_back_with_pillars_and_doors(plan, tmp_path):
    folder = survey(
        name="l", room=ROOM, scene=plan.scene, levels=NoiseLevels(20.0), poses=3, runs=tmp_path
    )
    read = read_survey(folder)
    assert np.array_equal(read.walls, outline(ROOM))
    assert read.conditions["room"] == ROOM.dimensions
    places = np.array([pose.position for pose in read.poses])
    assert distance_to_outline(places[:, :2], ROOM.faces[0]).min() > 1.0
