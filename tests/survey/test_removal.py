"""How much of the direct path is removed: what is measured, and what is said of it."""

from dataclasses import replace

import numpy as np
import pytest

from by_hand import ARRAY, FILES, PROBE, edit
from echolearn.acoustics.geometry import SearchWindow
from echolearn.survey import direct_path
from echolearn.survey.audio import wav_bytes
from echolearn.survey.reader import read_survey
from echolearn.survey.removal import removal_lines, removed_db

WINDOW = SearchWindow(0.6, 1.0)
LEVEL = 1e-3


def heard(folder, *, loudness, ringing=0):
    """Return a survey of the direct path in noise, by a loudspeaker that rings for some samples."""
    rng = np.random.default_rng(0)
    arrived = direct_path.delayed(PROBE, ARRAY, speed_of_sound=340.0)
    response = 0.8 ** np.arange(1 + ringing)
    rung = np.apply_along_axis(np.convolve, 1, arrived, response)[:, : PROBE.length]
    for name in FILES:
        samples = loudness * rung + LEVEL * rng.standard_normal((3, PROBE.length))
        (folder / name).write_bytes(wav_bytes(samples, 22050.0))
    edit(folder, direct_path="present")
    return replace(read_survey(folder), window=WINDOW)


def measured(survey, way):
    """Return what is measured of one way."""
    return removed_db(replace(survey, direct=way), np.full((2, 3), LEVEL))


def test_what_is_removed_is_what_was_there_over_what_is_left(folder):
    """A free field of gain 0.4 is taken off a direct path of gain 0.8: half of it is left, 6 dB."""
    gain = float(direct_path.free_field(ARRAY)[0])
    survey = heard(folder, loudness=2 * gain)
    assert measured(survey, "analytic") == pytest.approx(20 * np.log10(2), abs=0.3)
    assert measured(survey, "fitted") > 25
    assert measured(survey, "fir") > 20


def test_a_loudspeaker_that_rings_is_told_and_what_helps(folder):
    survey = replace(heard(folder, loudness=1.0, ringing=12), direct="fitted")
    little = measured(survey, "fitted")
    assert 0 < little < 6
    [line] = removal_lines(survey, little)
    assert line.startswith(f"direct=fitted removes {little:.1f} dB of what comes before the first")
    assert line.endswith("must be 6 dB or more; direct=fir fits it to each recording")
    assert removal_lines(survey, measured(survey, "fir")) == []
    [line] = removal_lines(replace(survey, direct="fir"), -0.02)
    assert "removes 0.0 dB" in line and line.endswith("is probe.wav what was played?")


def test_where_there_is_none_or_noise_hides_it_nothing_is_said(folder):
    hidden = heard(folder, loudness=1e-2 * LEVEL)
    assert np.isnan(measured(hidden, "fitted"))
    assert removal_lines(hidden, measured(hidden, "fitted")) == []
    assert np.isnan(removed_db(replace(hidden, direct=None), np.full((2, 3), LEVEL)))
