"""Why a map is empty: what was measured decides which cause is told first."""

from dataclasses import replace

import numpy as np
import pytest

from by_hand import write_small
from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.sides import closed
from echolearn.robot.advice import LAST, MANY, PLACES, causes
from echolearn.survey.examining import examine
from echolearn.survey.reader import read_survey
from mapped_walks import angled, lopsided

SOUND = {"direct": True, "noticed": ()}
SOUND |= {"snr_db": np.array([20.0, np.nan]), "negative_echoes": 0.0}


@pytest.fixture(scope="module")
def health(tmp_path_factory):
    """Return the health of a small survey, made out to be sound."""
    return replace(examine(read_survey(write_small(tmp_path_factory.mktemp("s")))), **SOUND)


def told(walk, health, **changes):
    return causes(walk, replace(health, **changes), window=SearchWindow(1.0, 2.0))


@pytest.fixture
def empty():
    """Return a walk 1 m from a wall, of which no echo is believed."""
    walk = lopsided()
    return replace(walk, map=replace(walk.map, kept=np.zeros(6, dtype=bool)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"noticed": ("microphone 3 is 38 dB down",)}, "microphone 3 is 38 dB down"),
        ({"snr_db": np.array([-12.0, np.nan])}, "the SNR may be as low as -12 dB"),
        ({"direct": False}, "time zero is taken on trust"),
        ({"negative_echoes": np.nan, "latency_samples": np.array([[np.nan]])}, "no arrival of the"),
    ],
)
def test_evidence_comes_before_questions(empty, health, change, message):
    assert told(empty, health) == [LAST]
    first, last = told(empty, health, **change)
    assert first.startswith(message) and last == LAST


def test_what_geometry_rules_out_comes_first(empty, health):
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    far = replace(empty, outline=closed(20 * square))
    first, second, _ = told(far, health, noticed=("most echoes are negative",))
    assert "no pose is within 2 m of a wall" in first and "16.0 m away" in first
    assert second == "most echoes are negative"


def test_kept_echoes_of_the_ceiling_alone_are_no_map(empty, health):
    kept = np.array([False] * 5 + [True])
    ceiling = replace(empty, map=replace(empty.map, kept=kept))
    assert told(ceiling, health)[0].startswith("all 1 kept echoes come from floor or ceiling")


def test_echoes_of_the_ceiling_are_told_of_where_none_is_kept(empty, health):
    elevation = np.zeros_like(empty.echoes.elevation)
    ceiling = replace(empty, echoes=replace(empty.echoes, elevation=elevation))
    first, *_, last = told(ceiling, health, snr_db=np.array([-12.0]))
    assert first.startswith("6 of 6 echoes come from floor or ceiling") and last == LAST


def test_many_points_that_agree_on_no_wall_are_in_wrong_places(health):
    walk = angled()
    assert told(walk, health, direct=False) == []
    anywhere = np.random.default_rng(0).uniform(-50, 50, walk.map.points.shape)
    lost = replace(walk, map=replace(walk.map, points=anywhere))
    assert told(lost, health) == [PLACES]
    first, second = told(lost, health, direct=False)
    assert first == PLACES and second.startswith("time zero is taken on trust")
    few = np.arange(len(anywhere)) < MANY - 1
    assert told(replace(lost, map=replace(lost.map, kept=few)), health) == []
