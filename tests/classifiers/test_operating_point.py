"""Cuts by hand, against all cuts one by one, and the words for an aim."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echolearn.checks import BadValue
from echolearn.classifiers.operating_point import (
    Aim,
    OutOfReach,
    best_threshold,
    choose_cut,
    read_aim,
)
from echolearn.evaluation.metrics import recall_at


def test_balanced_by_hand():
    confidence = np.array([0.1, 0.2, 0.35, 0.6, 0.8, 0.9])
    assert best_threshold(confidence, np.array([0, 0, 0, 1, 1, 1])) == pytest.approx(0.475)
    assert best_threshold(confidence, np.array([0, 1, 0, 0, 1, 1])) == pytest.approx(0.7)
    assert best_threshold(np.full(4, 0.3), np.array([0, 1, 0, 1])) == 0.5

    # Cuts at 0.2 and 0.75 are equally good; the one nearer to 0.5 is taken.
    alternating = np.array([0, 1, 0, 1])
    assert best_threshold(np.array([0.1, 0.3, 0.6, 0.9]), alternating) == pytest.approx(0.75)


@pytest.mark.parametrize(
    ("aim", "threshold", "precision", "retention"),
    [
        ("precision 1", 0.75, 1.0, 0.5),
        ("precision 0.75", 0.45, 0.75, 0.75),
        ("precision 0.6", 0.25, 2 / 3, 1.0),
        ("precision 0.5", 0.25, 2 / 3, 1.0),
        ("retention 0.5", 0.75, 1.0, 0.5),
        ("retention 0.6", 0.45, 0.75, 0.75),
        ("retention 1", 0.25, 2 / 3, 1.0),
    ],
)
def test_by_hand(aim, threshold, precision, retention):
    confidence = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.9, 0.95])
    y = np.array([0, 0, 1, 0, 1, 0, 1, 1], dtype=bool)
    found = choose_cut(confidence, y, aim=read_aim(aim))
    assert found.aim == aim
    shares = (found.threshold, found.precision, found.retention)
    assert shares == pytest.approx((threshold, precision, retention))


def test_what_keeps_all_is_a_cut_too():
    y = np.array([True, False, True, True])
    for aim in ("precision 0.7", "retention 1"):
        assert choose_cut(np.full(4, 0.3), y, aim=read_aim(aim)).threshold == 0.0


@given(
    st.lists(st.tuples(st.integers(0, 8), st.booleans()), min_size=2, max_size=40),
    st.sampled_from([0.3, 0.5, 0.75, 0.9, 1.0]),
)
def test_no_other_cut_keeps_more_at_that_precision(rows, share):
    confidence = np.array([level for level, _ in rows]) / 10
    y = np.array([label for _, label in rows])
    if not 0 < y.sum() < len(y):
        return
    most = float(recall_at(y, confidence, precision=share))
    if most == 0:
        with pytest.raises(OutOfReach, match="best is"):
            choose_cut(confidence, y, aim=Aim("precision", share))
        return
    found = choose_cut(confidence, y, aim=Aim("precision", share))
    kept = confidence >= found.threshold
    assert y[kept].mean() == pytest.approx(found.precision) and found.precision >= share - 1e-9
    assert y[kept].sum() / y.sum() == pytest.approx(found.retention) == pytest.approx(most)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("precision 1.2", "aim=precision 1.2: must name a share from 0.01 to 1$"),
        ("precision 90", "aim=precision 90: must name a share from 0.01 to 1; 90 % is 0.9"),
        ("retention nan", "must name a share"),
        ("0.9", "aim=0.9: must be balanced, precision <share> .*; precision 0.9?"),
        ("sure", "aim=sure: must be balanced"),
        ("balanced 0.5", "must be balanced"),
        (None, "aim=None: must be balanced"),
    ],
)
def test_an_aim_that_is_none_is_refused(text, said):
    with pytest.raises(BadValue, match=said):
        read_aim(text)


def test_an_aim_is_written_in_one_way():
    assert str(read_aim("  precision   0.90 ")) == "precision 0.9"
    assert str(read_aim("balanced")) == "balanced"
