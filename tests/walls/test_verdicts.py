"""What a classifier says of the lines of a walk: what it is shown, and what follows from it."""

import numpy as np
import pytest

from echolearn.walls.nouns import SOUND
from echolearn.walls.strips import sound_columns, strip_rows, strips
from echolearn.walls.verdicts import WallClassifier, verdicts
from heard_walks import heard, wandering

WALK = heard([(0.0, 5.0, -9, 9), (np.pi / 2, 4.0, -9, 9)], wandering(40), amplitude=3.0)


def asked(inputs, *, belief, walk=WALK):
    """Return the verdicts of a classifier, and what it was shown."""
    shown = []

    def confidence(x):
        shown.append(x)
        return belief(x)

    return verdicts(walk, WallClassifier(inputs, confidence, 0.5, count=6)), shown


def test_columns_come_in_the_order_that_the_bundle_names():
    names = ("median", "evidence_2")
    said, [shown] = asked(names, belief=lambda x: np.linspace(0.0, 1.0, len(x)))
    whole = sound_columns(WALK, said.found, cut=strips(WALK, said.found))
    assert np.array_equal(shown, whole[:, [SOUND.index(name) for name in names]])
    assert shown.dtype == np.float32


def test_what_is_believed_is_what_is_sure_enough_and_two_walls_are_the_strongest():
    said, _ = asked(["evidence_2"], belief=lambda x: (x[:, 0] > 12.0) + 0.0)
    assert np.array_equal(said.believed, said.confidence >= 0.5)
    lines = sorted((track.line.normal, track.line.offset) for track in said.walls)
    assert lines == [pytest.approx((0.0, 5.0), abs=0.02), pytest.approx((np.pi / 2, 4.0), abs=0.02)]


def test_networks_are_shown_strips_of_the_poses_that_see_them():
    said, [shown] = asked(["strips"], belief=lambda x: np.ones(len(x)))
    cut = strips(WALK, said.found)
    seen = cut.seen.sum(axis=1)
    assert shown.shape[1] == seen.max() < len(WALK.poses) and shown.dtype == np.float32
    whole = strip_rows(WALK, cut, number=0, rng=np.random.default_rng(0))
    assert np.array_equal(shown, whole[:, : seen.max()].astype(np.float32))
    for strip, count in zip(shown, seen, strict=True):
        assert strip[:count].any(axis=1).all() and not strip[count:].any()


def test_of_a_walk_that_speaks_for_nothing_nobody_is_asked():
    said, shown = asked(["evidence_2"], belief=np.ones, walk=heard([], wandering(2)))
    assert len(said.found) == len(said.tracks) == len(said.confidence) == 0 and shown == []


def test_poses_that_heard_nothing_by_themselves_stand_on_the_line():
    said, _ = asked(["evidence_2"], belief=lambda x: np.ones(len(x)))
    for track in said.tracks:
        normal = np.array([np.cos(track.line.normal), np.sin(track.line.normal)])
        off = np.abs(track.places @ normal - track.line.offset)
        assert off[~track.heard].max(initial=0.0) < 1e-9
        assert np.array_equal(track.places[track.heard], track.points[track.heard])
