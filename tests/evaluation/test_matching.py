"""Matching of echoes and walls, by hand and against every possible way."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from echolearn.checks import BadValue
from echolearn.evaluation.matching import match_echoes


def matched(reference, estimated, tolerance=0.1):
    return match_echoes(np.array(reference), np.array(estimated), tolerance=tolerance).tolist()


def test_matching_by_hand():
    assert matched([0.5], [0.45, 0.52]) == [-1, 0], "a wall found twice counts once"
    # Greedily, 0.51 would take the wall at 0.5 and leave 0.44 alone.
    assert matched([0.5, 0.58], [0.51, 0.44]) == [1, 0]
    assert matched([0.5], [0.75], tolerance=0.25) == [-1], "the tolerance itself is too far"
    assert matched([0.5], [0.7499], tolerance=0.25) == [0]
    assert matched([], [0.1, 0.2]) == [-1, -1]
    assert matched([0.1], []) == []


times = st.lists(st.floats(0, 0.5), min_size=1, max_size=3)


@given(times, times)
@settings(max_examples=40)
def test_no_other_way_has_more_pairs_or_as_many_with_less_error(reference, estimated):
    found = matched(reference, estimated)
    pairs = [(r, w) for r, w in enumerate(found) if w >= 0]
    assert len({w for _, w in pairs}) == len(pairs)
    error = sum(abs(estimated[r] - reference[w]) for r, w in pairs)
    spare = [*range(len(reference)), *[-1] * len(estimated)]
    for way in set(permutations(spare, len(estimated))):
        other = [abs(estimated[r] - reference[w]) for r, w in enumerate(way) if w >= 0]
        other = [e for e in other if e / 0.1 < 1]
        assert (-len(pairs), error) <= (-len(other), sum(other) + 1e-12)


def test_bad_values_are_named():
    with pytest.raises(BadValue, match=r"^tolerance=10 s: .*are times in samples"):
        match_echoes(np.zeros(1), np.zeros(1), tolerance=10)
    with pytest.raises(BadValue, match=r"^estimated_toa=NaN"):
        matched([0.1], [np.nan])
