"""The burst as the loudspeaker plays it: where it is taken from, and what it is good for."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from by_hand import ARRAY, FILES, PROBE, edit
from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.signals import matched_filter, noise_probe
from echolearn.acoustics.types import Probe
from echolearn.survey import direct_path
from echolearn.survey.audio import wav_bytes
from echolearn.survey.early import loudspeaker_response
from echolearn.survey.mending import taken_off
from echolearn.survey.played import AFTER, AHEAD, as_played
from echolearn.survey.reader import read_survey

BURST = noise_probe(length=3000)
RING = circular_array(microphones=4)
RESPONSE = lfilter(*butter(2, [0.03, 0.6], "bandpass"), np.eye(1, 40)[0])
"""Of a loudspeaker, from the emission on."""


def heard(array=RING, *, response=RESPONSE, probe=BURST):
    """Return the direct sound of a loudspeaker of that response, shape (M, N)."""
    arrived = direct_path.delayed(probe, array, speed_of_sound=343.0)
    gain = direct_path.free_field(array)[:, None]
    return gain * np.apply_along_axis(np.convolve, 1, arrived, response)[:, : probe.length]


def taken(samples, array=RING):
    """Return the response that is taken from recordings."""
    about = {"positions": array.positions, "last": 110, "speed_of_sound": 343.0}
    return loudspeaker_response(samples, BURST, **about)


def test_the_response_is_that_of_the_loudspeaker_at_the_way_to_the_microphones():
    """Whatever their distances, gains and echoes are, and the noise of each recording."""
    rng = np.random.default_rng(0)
    uneven = replace(RING, positions=RING.positions * np.array([[1.0], [0.5], [1.3], [0.8]]))
    quiet = heard(uneven)
    echoes = [0.05 * np.roll(quiet, lag, axis=-1) for lag in rng.integers(150, 400, 12)]
    walk = np.array([quiet + echo + 0.1 * rng.standard_normal(quiet.shape) for echo in echoes])
    found = taken(walk, uneven)
    expected = np.zeros(AHEAD + AFTER + 1)
    expected[AHEAD : AHEAD + 40] = RESPONSE / np.linalg.norm(RESPONSE)
    assert found @ expected > 0.98
    assert np.abs(found[: AHEAD - 3]).max() < 0.06


def test_filtering_the_recording_is_seeking_by_what_was_played():
    """By the sum over the burst as played, at every lag."""
    rng = np.random.default_rng(1)
    samples = rng.standard_normal((2, 3, 900))
    probe = Probe(rng.standard_normal(60), 22050.0, 900)
    response = rng.standard_normal(AHEAD + AFTER + 1)
    found = matched_filter(as_played(samples, response), probe, first=20, last=300)
    played = np.convolve(probe.samples, response)
    for lag in (20, 111, 300):
        start = lag - AHEAD
        expected = samples[..., start : start + len(played)] @ played
        assert found[..., lag - 20] == pytest.approx(expected)


def test_echoes_stay_in_time_and_stand_higher_above_the_noise():
    late = int(np.abs(RESPONSE).argmax())
    wave = np.pad(RESPONSE, (200 - late, 0))
    echo = np.convolve(BURST.samples, wave)[: BURST.length]
    noise = np.random.default_rng(2).standard_normal((200, BURST.length))
    # As it is once latency has been taken off.
    response = taken(taken_off(heard(), late))
    heights = []
    for change in (lambda x: x, lambda x: as_played(x, response)):
        clean = matched_filter(change(echo), BURST, first=150, last=250)
        noisy = matched_filter(change(noise), BURST, first=200, last=200)
        assert abs(int(clean.argmax()) + 150 - 200) <= 1
        heights.append(clean.max() / noisy.std())
    # What a matched filter gains: the root of the energy over the crest's.
    crest = np.abs(RESPONSE).max() / np.linalg.norm(RESPONSE)
    assert heights[1] / heights[0] == pytest.approx(1 / crest, rel=0.15)


def test_a_calibration_tells_the_same_and_recordings_are_filtered_when_read(folder):
    rung = heard(ARRAY, probe=PROBE)
    rng = np.random.default_rng(3)
    for name in FILES:
        noisy = rung + 1e-3 * rng.standard_normal(rung.shape)
        (folder / name).write_bytes(wav_bytes(noisy, 22050.0))
    (folder / "calibration.wav").write_bytes(wav_bytes(3 * rung, 22050.0))
    edit(folder, direct_path="present")
    survey = replace(read_survey(folder), window=SearchWindow(0.6, 1.0), direct="fir")
    walk, alone = (replace(survey, played=way) for way in ("walk", "calibration"))
    assert walk.response @ alone.response > 0.99
    plain = survey.observe([0]).samples
    assert np.allclose(walk.observe([0]).samples, as_played(plain, walk.response))
    assert walk.looked_at == [0, 1]
