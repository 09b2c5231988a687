"""What arrives before the first echo: fitted as long sums say, then gone, and nothing else."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import direct_paths
from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.probes import mls_probe, sweep_probe
from echolearn.acoustics.signals import convolve, matched_filter, noise_probe, power
from echolearn.acoustics.types import MicArray, Probe
from echolearn.checks import BadValue
from echolearn.survey import direct_path
from echolearn.survey.early import early_lags, early_responses, without_early

PROBE = noise_probe(length=6000)
ARRAY = circular_array()
LAGS = early_lags(PROBE, ARRAY, window=SearchWindow(), speed_of_sound=343.0)
ECHO = 180
"""Lag of an echo in the search window."""


def heard(*parts, probe=PROBE, length=400):
    """Return the burst at some lags, each with its gain, shape (N,)."""
    response = np.zeros(length)
    for lag, gain in parts:
        response[lag] += gain
    return convolve(probe.samples, response, length=probe.length)


def test_all_lags_from_the_direct_path_to_the_window_are_fitted():
    """0.2 m are 12.9 samples; what microphone 1 hears after 115.7 others hear 25.7 before."""
    assert LAGS == (12 - 6, 90 - 8)
    beside = MicArray(np.array([[0.0, 0, 0], [0.1, 0, 0]]))
    assert early_lags(PROBE, beside, window=SearchWindow(), speed_of_sound=343.0)[0] == 0
    near = SearchWindow(0.2, 1.0)
    # The direct path goes, though echoes are sought from there on.
    assert early_lags(PROBE, ARRAY, window=near, speed_of_sound=343.0) == (6, 12 + 6)


def test_a_microphone_that_the_burst_does_not_reach_is_refused():
    brief = noise_probe(burst=16, length=18)
    with pytest.raises(BadValue, match="microphones=0.2 m: must hear the direct path within"):
        early_lags(brief, ARRAY, window=SearchWindow(), speed_of_sound=343.0)


@pytest.mark.parametrize(
    ("lags", "lost", "length"),
    [((0, 30), 0, 400), ((6, 30), 0, 400), ((0, 30), 9, 400), ((4, 25), 17, 105), ((0, 40), 3, 90)],
    ids=["whole", "later", "lost", "lost and cut", "cut"],
)
def test_responses_are_those_of_a_long_sum(lags, lost, length):
    """Against a table of all copies of the burst, whatever of them was recorded."""
    rng = np.random.default_rng(3)
    probe = Probe(rng.standard_normal(80), 22050.0, length)
    samples = rng.standard_normal((2, 3, length))
    samples[..., :lost] = 0.0
    copies = np.zeros((length, lags[1] - lags[0]))
    for column, lag in enumerate(range(*lags)):
        rest = probe.samples[: length - lag]
        copies[lag : lag + len(rest), column] = rest
    copies[:lost] = 0.0
    expected = np.linalg.lstsq(copies, samples.reshape(-1, length).T, rcond=None)[0]
    found = early_responses(samples, probe, lags=lags, lost=lost, penalty=0.0)
    assert np.allclose(found.reshape(-1, found.shape[-1]).T, expected, atol=1e-4)


@given(st.lists(st.floats(-30, 30), min_size=1, max_size=LAGS[1] - LAGS[0]))
def test_whatever_comes_early_nothing_is_left_of_it(gains):
    """A loudspeaker that rings, a robot's own body: the echo is as if they were not there."""
    quiet = heard((ECHO, 0.1))
    early = heard(*((LAGS[0] + k, gain) for k, gain in enumerate(gains)))
    left = without_early(quiet + early, PROBE, lags=LAGS)
    # What is left of a lag that is kept is below the echo's own side lobes.
    assert power(left - without_early(quiet, PROBE, lags=LAGS)) < 0.2 * power(quiet)
    r = matched_filter(left, PROBE, first=LAGS[1] + 8, last=300)
    assert np.abs(r).argmax() == ECHO - LAGS[1] - 8


def test_where_nothing_comes_early_an_echo_and_noise_stay_what_they_are():
    """All lags would take 7 % of the energy under the burst with them."""
    rng = np.random.default_rng(5)
    noisy = heard((ECHO, 0.3)) + rng.standard_normal((40, PROBE.length))
    kept = without_early(noisy, PROBE, lags=LAGS)
    assert power(kept - noisy).sum() < 0.01 * power(noisy).sum()
    r = matched_filter(kept, PROBE, first=ECHO, last=ECHO)
    whole = matched_filter(noisy, PROBE, first=ECHO, last=ECHO)
    assert r.mean() == pytest.approx(whole.mean(), rel=0.02)
    all_lags = early_responses(noisy, PROBE, lags=LAGS, penalty=0.0)
    taken = convolve(PROBE.samples, all_lags, length=PROBE.length)
    assert power(taken).sum() > 0.01 * power(noisy).sum()


def test_a_loudspeaker_that_rings_is_removed_where_geometry_leaves_half():
    rings = 0.8 ** np.arange(40)
    # Whole samples away, so that nothing rings for ever between them.
    ring = circular_array(radius=13 * 343.0 / 22050.0)
    arrived = direct_path.delayed(PROBE, ring, speed_of_sound=343.0)
    rung = np.apply_along_axis(np.convolve, 1, arrived, rings)[:, : PROBE.length]
    fitted = direct_path.remove(rung, arrived)
    left = without_early(rung, PROBE, lags=LAGS)
    assert power(fitted).mean() > 0.3 * power(rung).mean()
    assert power(left).mean() < 1e-5 * power(rung).mean()


def test_what_was_lost_is_not_there_to_be_subtracted():
    whole = heard((13, 1.0), (40, 0.3))
    cut = np.where(np.arange(PROBE.length) < 25, 0.0, whole)
    left = without_early(cut, PROBE, lags=LAGS, lost=25)
    assert power(left) < 1e-6 * power(whole)
    assert not left[:25].any()
    assert power(without_early(cut, PROBE, lags=LAGS)) > 100 * power(left)


def test_a_loudspeaker_that_rings_leaves_the_echoes_of_a_room_where_they_are(tmp_path):
    """In silence: what the table of direct paths shows of a hundred poses and more, of eight."""
    poses = direct_paths.places(8, np.random.default_rng(4))
    heard_there = direct_paths.case(direct_paths.CASES["all of these"], poses)
    survey = direct_paths.write(tmp_path / "walk", heard_there.received, heard_there)
    right = {
        way: direct_paths.right(direct_paths.without_direct(survey, way), heard_there.truths)
        for way in ("fir", "fitted")
    }
    assert right["fir"].all()
    assert not right["fitted"].all()


def test_measured_responses_are_as_a_robot_would_record_them():
    """The direct sound of a pulse from the array's middle, within a sample of the way."""
    recorded = direct_paths.measured(90)
    assert recorded.received.shape == (90, 6, direct_paths.PROBE.length)
    way = 0.048 * direct_paths.RATE / 343.0
    r = matched_filter(recorded.received[::9], direct_paths.PROBE, first=0, last=300)
    assert np.abs(np.abs(r).argmax(axis=-1) - way).max() < 1.5


LONG = {
    "noise": noise_probe(burst=9000, length=12_000),
    "sequence": mls_probe(bits=13, length=12_000),
    "sweep": sweep_probe(seconds=0.4, length=12_000),
    "exponential sweep": sweep_probe(law="exponential", seconds=0.4, length=12_000),
    "to the end": sweep_probe(seconds=0.54, length=12_000),
}
"""Bursts of 8000 samples and more; echoes come after 150."""


@pytest.mark.parametrize("name", LONG)
def test_of_a_long_burst_the_direct_path_is_subtracted_while_it_lasts(name):
    """As loud as a burst of 1500 samples of noise, and the echo is found as with that."""
    for probe in (LONG[name], PROBE):
        scale = np.sqrt(PROBE.energy / probe.energy)
        loud = Probe(scale * probe.samples, probe.sample_rate, probe.length)
        response = heard((13, 1.0), (14, -0.6), (30, 0.2), (ECHO, 0.02), probe=loud)
        rng = np.random.default_rng(2)
        noisy = response + 0.01 * rng.standard_normal((20, probe.length))
        left = without_early(noisy, loud, lags=LAGS)
        r = matched_filter(left, loud, first=100, last=300) / loud.energy
        # A sweep has no power at some frequencies, so its peak is some lags wide.
        assert np.abs(r.argmax(axis=-1) + 100 - ECHO).max() <= 2
        assert r[:, ECHO - 100].mean() == pytest.approx(0.02, rel=0.1)
        assert power(left).mean() < 2e-3 * power(noisy).mean()


def test_a_batch_is_each_of_it_silence_stays_and_nothing_is_changed_in_place():
    samples = np.random.default_rng(0).standard_normal((3, 6, 6000)) + heard((13, 2.0))
    samples[1, 2] = 0.0
    before = samples.copy()
    together = without_early(samples, PROBE, lags=LAGS)
    for one, alone in zip(together, samples, strict=True):
        assert np.allclose(one, without_early(alone, PROBE, lags=LAGS))
    assert not together[1, 2].any()
    assert np.array_equal(samples, before)
