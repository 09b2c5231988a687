"""How far echoes are heard and how long a place rings, against sound whose decay is known."""

from pathlib import Path

import numpy as np
import pytest

from echolearn.survey.reach import UNHEARD, reach_in, reach_of
from echolearn.survey.reader import read_survey

RATE = 22050.0


def decaying(t60, *, noise, averaged=600, seconds=0.8):
    """Return mean squares of Gaussian correlations that decay into noise."""
    rng = np.random.default_rng(0)
    times = np.arange(round(seconds * RATE)) / RATE
    power = 10.0 ** (-6.0 * times / t60) + noise
    return power * rng.chisquare(averaged, len(times)) / averaged


def reach(energy, averaged=600):
    return reach_in(energy, rate=RATE, averaged=averaged, first=128, step=343.0 / RATE / 2)


@pytest.mark.parametrize("t60", [0.2, 0.6, 1.0])
@pytest.mark.parametrize("noise_db", [-60.0, -40.0, -25.0])
def test_the_decay_is_that_of_the_sound_whatever_the_noise(t60, noise_db):
    found = reach(decaying(t60, noise=10.0 ** (noise_db / 10)))
    assert found.t60 == pytest.approx(t60, rel=0.1)


def test_echoes_are_heard_as_far_as_they_stand_out_of_averaged_noise():
    """E falls to CLEAR standard deviations of the noise where both closed forms meet."""
    found = reach(decaying(0.5, noise=1e-2))
    width = round(0.002 * RATE)
    least = 1e-2 * 5.0 * np.sqrt(2.0 * 4.0 / (600 * width))
    path = 343.0 * (-0.5 * np.log10(least) / 6.0)
    assert found.farthest == pytest.approx(128 * 343.0 / RATE / 2 + path / 2, rel=0.1)


def test_noise_alone_tells_nothing():
    found = reach(decaying(0.5, noise=1e6))
    assert np.isnan(found.farthest) and np.isnan(found.t60)


def test_recordings_that_end_at_once_tell_nothing():
    assert np.isnan(reach(decaying(0.5, noise=0.0, seconds=0.005)).t60)


def test_a_walk_cut_to_its_window_tells_nothing():
    """The recordings of the example end before a whole burst came back from where echoes begin."""
    walk = read_survey(Path(__file__).parents[2] / "examples" / "survey" / "short")
    assert reach_of(walk) == UNHEARD
