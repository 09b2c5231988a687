"""A small survey, written by hand."""

from pathlib import Path

import pytest

from by_hand import write_small


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a survey of two poses and three microphones, as a robot leaves it."""
    return write_small(tmp_path)
