"""The map of validation positions: points where walls are, in metres or in shares of each room."""

import numpy as np
import pytest

from echolearn.acoustics.types import SPEED_OF_SOUND, MicArray
from echolearn.training.dashboard_figures import filtered_map

ROOMS = np.array([[4.0, 3.0, 2.5], [8.0, 6.0, 2.5]])


class Rows:
    """Echoes of the wall x = 0 from the middle of each room, heard by a microphone beside it."""

    array = MicArray(np.zeros((1, 3)))

    def __init__(self, rooms):
        self.fields = {
            "toa": rooms[:, 0] / SPEED_OF_SOUND,
            "azimuth": np.full(len(rooms), np.pi),
            "elevation": np.full(len(rooms), np.pi / 2),
            "position": rooms / 2,
            "heading": np.zeros(len(rooms)),
            "room": rooms,
        }

    def holds(self, names):
        return {*names} <= {*self.fields}

    def gather(self, name, rows):
        return self.fields[name][rows]


@pytest.mark.parametrize(
    ("rooms", "expected", "unit"),
    [(ROOMS, 0.5, "shares of each room"), (ROOMS[[1, 1]], 3.0, "m")],
)
def test_points_lie_on_the_wall(rooms, expected, unit):
    confidence = np.array([0.4, 0.6])
    figure = filtered_map(Rows(rooms), np.arange(2), confidence=confidence, cut=0.5)
    [axes] = figure.axes
    _, removed, kept = axes.lines
    for line in (removed, kept):
        assert np.ravel(line.get_xydata()) == pytest.approx([0.0, expected])
    assert axes.get_xlabel() == f"x, {unit}"


def test_what_has_no_place_is_not_drawn():
    rows = Rows(ROOMS)
    del rows.fields["room"]
    assert filtered_map(rows, np.arange(2), confidence=np.ones(2), cut=0.5) is None
