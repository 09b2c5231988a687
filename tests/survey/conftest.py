"""A small survey, written by hand."""

import pytest

from by_hand import write_small


@pytest.fixture
def folder(tmp_path):
    """Return a survey of two poses and three microphones, as a robot leaves it."""
    return write_small(tmp_path)
