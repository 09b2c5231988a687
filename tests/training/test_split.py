"""The split of a set: by position, at random, by its seed alone."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from echolearn.checks import BadValue
from echolearn.training.split import split_groups


@given(st.lists(st.integers(0, 30), min_size=1, max_size=80), st.floats(0, 1), st.integers(0, 99))
def test_no_position_falls_on_both_sides(groups, share, seed):
    positions = np.array(groups)
    first, second = split_groups(positions, share=share, seed=seed)
    assert sorted([*first, *second]) == list(range(len(groups)))
    assert not set(positions[first]) & set(positions[second])
    assert len(set(positions[second])) == round(share * len(set(groups)))


def test_splits_follow_their_seed_alone():
    groups = np.repeat(np.arange(50), 3)
    one, same, other = (split_groups(groups, share=0.2, seed=seed)[1] for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.array_equal(one, other)
    shuffled = np.random.default_rng(0).permutation(groups)
    assert set(shuffled[split_groups(shuffled, share=0.2, seed=1)[1]]) == set(groups[one])


@pytest.mark.parametrize("share", [-0.1, 1.1, "fifth"])
def test_a_share_that_is_none_is_refused(share):
    with pytest.raises(BadValue, match=f"^share={share}"):
        split_groups(np.arange(5), share=share, seed=0)
