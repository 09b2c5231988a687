"""Echoes by their truth, by hand and against loops; the largest recall at a precision."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.types import Echoes, MicArray, Truth
from echolearn.evaluation.labelling import echo_scores, label_echoes
from echolearn.evaluation.matching import agree
from echolearn.evaluation.metrics import recall_at

RATE = 1000.0
FLAT = np.pi / 2


def truth(*echoes):
    """Return true echoes by time in samples, azimuth and elevation in degrees."""
    toa, azimuth, elevation = np.reshape(echoes, (-1, 3)).T
    return Truth(toa / RATE, np.deg2rad(azimuth), np.deg2rad(elevation))


def found(rows):
    """Return echoes of P poses, likewise."""
    toa, azimuth, elevation = np.moveaxis(np.array(rows, dtype=float), -1, 0)
    rest = np.zeros((3, *toa.shape))
    return Echoes(toa / RATE, rest[0], rest[1], np.deg2rad(azimuth), np.deg2rad(elevation), rest[2])


def test_labels_by_hand():
    every = truth((100, 0, 90), (130, 175, 90))
    echoes = found(
        [
            [(109, 9, 90), (121, -176, 90)],  # both right, the second across the turn
            [(109, 11, 90), (125, 0, 90)],  # right in time alone
            [(111, 0, 90), (141, 175, 90)],  # late
            [(101, 0, 90), (99, 1, 90)],  # one true echo serves one estimate
        ]
    )
    labels = label_echoes([every] * 4, echoes, sample_rate=RATE)
    assert labels.by_time.tolist() == [True, True, True, True, False, False, True, False]
    assert labels.strict.tolist() == [True, True, False, False, False, False, True, False]
    scores = echo_scores(labels, np.array([1, 1, 1, 0, 0, 0, 0, 1], dtype=bool))
    assert scores["precision"] == pytest.approx(2 / 4)
    assert scores["true_retention"] == pytest.approx(2 / 3)
    assert scores["spurious_removal"] == pytest.approx(3 / 5)
    assert scores["time_precision"] == pytest.approx(3 / 4)
    assert scores["time_true_retention"] == pytest.approx(3 / 5)


def test_near_the_axis_the_angle_between_directions_counts():
    above = truth((100, 0, 2))
    near = agree(above, azimuth=np.deg2rad([90.0, 90.0]), elevation=np.deg2rad([7.0, 15.0]))
    assert near[:, 0].tolist() == [True, False]
    # Anywhere else elevation, which many arrays hardly know, does not.
    aside = truth((100, 0, 60))
    assert agree(aside, azimuth=np.deg2rad([9.0]), elevation=np.deg2rad([90.0])).tolist() == [
        [True]
    ]


LINE = MicArray(np.array([[0.0, 0.1, 0.0], [0.0, 0.0, 0.0], [0.0, -0.2, 0.0]]))
"""Across the heading."""

UPRIGHT = MicArray(np.array([[0.0, 0.1, 0.0], [0.0, -0.1, 0.0], [0.0, 0.0, 0.1]]))
"""A plane across the heading, which hears no difference between front and back."""

SPACE = MicArray(np.array([[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [-0.1, 0.0, 0.0], [0.0, 0.0, 0.1]]))


@pytest.mark.parametrize(
    ("array", "true", "estimated", "same"),
    [
        (circular_array(), (0, 178), (90, 3), True),  # floor, told as the ceiling
        (circular_array(), (10, 90), (170, 90), False),
        (SPACE, (0, 178), (90, 3), False),
        (SPACE, (30, 90), (38, 90), True),
        (LINE, (30, 90), (150, 90), True),  # the other side of the line
        (LINE, (30, 90), (-150, 90), False),  # the other end of it
        (LINE, (0, 90), (0, 3), True),  # straight above, across the line, too
        (LINE, (30, 90), (165, 90), False),
        (UPRIGHT, (20, 90), (160, 90), True),
        (UPRIGHT, (20, 90), (-160, 90), False),
        (None, (20, 90), (160, 90), False),
    ],
)
def test_directions_that_an_array_cannot_tell_apart_count_as_one(array, true, estimated, same):
    """By azimuth and elevation in degrees."""
    there = truth((100, *true))
    azimuth, elevation = np.deg2rad([[estimated[0]], [estimated[1]]])
    assert agree(there, azimuth=azimuth, elevation=elevation, array=array).tolist() == [[same]]


def test_what_is_not_known_has_no_label():
    blind = Truth(np.array([0.1]), np.array([np.nan]), np.array([np.nan]))
    labels = label_echoes([blind], found([[(100, 0, 90)]]), sample_rate=RATE)
    assert labels.strict is None and labels.by_time.all()
    assert set(echo_scores(labels, np.ones(1, dtype=bool))) == {
        "time_precision",
        "time_true_retention",
        "time_spurious_removal",
    }
    none = Truth(*np.zeros((3, 0)))
    labels = label_echoes([none], found([[(100, 0, 90)]]), sample_rate=RATE)
    assert not labels.strict.any()


rows = st.lists(
    st.tuples(st.booleans(), st.sampled_from([0.1, 0.2, 0.3, 0.6, 0.9])), min_size=1, max_size=30
)


@given(rows, st.sampled_from([0.5, 0.75, 0.9, 1.0]), st.integers(0, 99))
def test_recall_at_a_precision_is_the_best_of_all_cuts(rows, precision, seed):
    reference, confidence = (np.array(column) for column in zip(*rows, strict=True))
    counts = np.random.default_rng(seed).integers(0, 3, len(rows))
    best = []
    for each in (np.ones(len(rows)), counts):
        true = each[reference].sum()
        largest = 0.0 if true else np.nan
        for cut in confidence:
            kept = confidence >= cut
            right, total = each[kept & reference].sum(), each[kept].sum()
            if true and total and right / total >= precision - 1e-9:
                largest = max(largest, right / true)
        best.append(largest)
    assert recall_at(reference, confidence, precision=precision) == pytest.approx(
        best[0], nan_ok=True
    )
    weighted = recall_at(reference, confidence, precision=precision, weights=counts[None])
    assert weighted[0] == pytest.approx(best[1], nan_ok=True)


def test_nine_of_ten_are_ninety_percent():
    reference = np.array([True] * 9 + [False])
    assert recall_at(reference, np.ones(10), precision=0.9) == 1.0
