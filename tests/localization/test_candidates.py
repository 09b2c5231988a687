"""The candidates of a pose: by hand, and against what must not matter."""

from math import cos, log, sin

import numpy as np
import pytest

from echolearn.localization.candidates import DESCRIBED, NEEDED, candidates
from echolearn.localization.columns import CANDIDATES, tensor_shape

ECHOES = 3


@pytest.fixture
def columns():
    """Return two poses of three echoes each, the last of which is none."""
    rng = np.random.default_rng(0)
    drawn = {name: rng.uniform(0.5, 1.5, 2 * ECHOES) for name in NEEDED}
    drawn["gain"][-1] = -0.1
    return drawn


def by_hand(columns, row):
    """Return the candidates of one echo, one after the other."""
    first = row // ECHOES * ECHOES
    others = [other for other in range(first, first + ECHOES) if other != row]
    found = []
    for other in [row, *others]:
        if other != row and columns["gain"][other] <= 0:
            found.append([0.0] * 14)
            continue
        turn = columns["azimuth"][other] - columns["azimuth"][row]
        height = sin(columns["elevation"][other])
        gains = max(columns["gain"][other], 1e-38) / max(columns["gain"][row], 1e-38)
        described = [columns[name][other] for name in DESCRIBED]
        late = columns["toa"][other] - columns["toa"][row]
        stronger = min(max(log(gains), -10.0), 10.0)
        found.append(
            [1.0, *described, late, height * cos(turn), height * sin(turn), height, stronger]
        )
    return np.array(found + [[0.0] * 14] * (CANDIDATES - ECHOES))


def test_an_echo_comes_first_and_the_others_relative_to_it(columns):
    found = candidates(columns, echoes=ECHOES)
    assert found.shape == (2 * ECHOES, *tensor_shape("candidates", 6))
    for row in range(2 * ECHOES):
        assert np.allclose(found[row], by_hand(columns, row), rtol=1e-6), row


def test_neither_gain_nor_heading_nor_delay_matters(columns):
    changed = columns | {
        "gain": 10.0 * columns["gain"],
        "azimuth": columns["azimuth"] + 2.0,
        "toa": columns["toa"] + 0.3,
    }
    expected = candidates(columns, echoes=ECHOES)
    assert np.allclose(candidates(changed, echoes=ECHOES), expected, atol=1e-6)


def test_of_many_echoes_the_strongest_are_seen():
    rng = np.random.default_rng(1)
    drawn = {name: rng.uniform(0.5, 1.5, 10) for name in NEEDED}
    drawn["score"] = np.arange(10.0)
    scores = candidates(drawn, echoes=10)[:, :, 1 + DESCRIBED.index("score")]
    assert scores[0].tolist() == [0, 1, 2, 3, 4, 5, 6, 7]
    assert scores[9].tolist() == [9, 0, 1, 2, 3, 4, 5, 6]
