"""The largest value nearby, beside SciPy's."""

import numpy as np
import pytest
from scipy.ndimage import maximum_filter1d

from echolearn.walls.neighbourhood import largest_near

VALUES = np.random.default_rng(0).standard_normal((4, 9, 11)).astype(np.float32)


@pytest.mark.parametrize("reach", [0, 1, 2, 3, 4, 7, 20])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_it_is_the_maximum_filter(axis, reach):
    expected = maximum_filter1d(VALUES, 2 * reach + 1, axis=axis, mode="nearest")
    found = largest_near(VALUES, reach, axis=axis)
    assert np.array_equal(found, expected) and found.dtype == VALUES.dtype


@pytest.mark.parametrize("reach", [1, 3, 4])
def test_around_a_circle_the_first_follows_the_last(reach):
    expected = maximum_filter1d(VALUES, 2 * reach + 1, axis=1, mode="wrap")
    assert np.array_equal(largest_near(VALUES, reach, axis=1, circular=True), expected)
