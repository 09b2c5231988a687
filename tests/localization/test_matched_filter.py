"""The matched-filter view: what it holds, and where its window ends."""

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.signals import noise_probe
from echolearn.localization.correlations import PAD
from echolearn.localization.matched_filter import MatchedFilter
from reference import RATE, observed, wave, white

PROBE = noise_probe(length=6000)


def view(lag, window, azimuths=36):
    samples = wave(PROBE, 0.0, lag) + white(PROBE, 0.01)
    return MatchedFilter(observed(PROBE, samples), window, azimuths)


def test_a_window_near_the_emission_is_padded_with_silence():
    """First lag 13: the lags before the emission cannot be recorded and count as zero."""
    matched = view(40, SearchWindow(nearest=0.2, farthest=1.0))
    assert matched.padded.shape[-1] == matched.last - matched.first + 1 + 2 * PAD
    assert (matched.padded[..., : PAD - matched.first] == 0).all()
    assert matched.toa(matched.strongest)[0] * RATE == pytest.approx(40)


def test_times_and_indices_are_inverse():
    matched = view(180, SearchWindow())
    index = np.arange(matched.last - matched.first + 1)
    assert np.array_equal(matched.index(matched.toa(index)), index)
    assert np.array_equal(matched.index(np.array([0.0, 1.0])), [0, index[-1]])
