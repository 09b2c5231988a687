"""Signals against the sums that define them."""

import numpy as np
import pytest
from scipy.signal import ShortTimeFFT
from scipy.signal.windows import hann

from echolearn.acoustics import signals
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.streams import KEYS, stream
from echolearn.acoustics.types import Probe
from echolearn.bench import equations
from refusals import refused

SHORT = noise_probe(burst=50, length=300)
WINDOWS = pytest.mark.parametrize(("first", "last"), [(0, 0), (7, 120), (240, 299), (100, 400)])


def test_the_probe_is_white_gaussian_always_the_same_and_exact_in_single_precision():
    samples = noise_probe().samples
    assert samples.shape == (1500,)
    assert abs(samples.mean()) < 4 / np.sqrt(1500)
    assert samples.var() == pytest.approx(1.0, abs=4 * np.sqrt(2 / 1500))
    correlation = np.correlate(samples, samples, "full") / noise_probe().energy
    assert np.abs(np.delete(correlation, 1499)).max() < 5 / np.sqrt(1500)
    assert np.array_equal(samples, noise_probe().samples)
    assert not np.array_equal(samples, noise_probe(seed=1).samples)
    assert np.array_equal(samples, samples.astype(np.float32).astype(float))


@WINDOWS
def test_correlation_and_energy_are_their_loops(first, last):
    """Samples beyond the recording count as zero."""
    recording = np.random.default_rng(1).standard_normal((2, 3, 300))
    found = signals.matched_filter(recording, SHORT, first=first, last=last)
    energy = signals.energy_under_probe(recording, SHORT, first=first, last=last)
    assert found.shape == energy.shape == (2, 3, last - first + 1)
    longer = np.pad(recording, [(0, 0), (0, 0), (0, last + 50)])
    for row in np.ndindex(2, 3):
        under = [longer[row][lag : lag + 50] for lag in range(first, last + 1)]
        assert np.allclose(found[row], np.array(under) @ SHORT.samples)
        assert np.allclose(energy[row], np.sum(np.square(under), axis=-1))


def test_energy_stays_that_of_a_quiet_part_after_a_loud_one():
    """A running sum must not lose the quiet part to rounding."""
    recording = np.repeat([[1e3, 1e-3]], 150, axis=-1)
    found = signals.energy_under_probe(recording, SHORT, first=100, last=240)
    assert found[0, -1] == pytest.approx(50 * 1e-6, rel=0.01)


def test_frames_are_scipys_and_keep_single_precision():
    recording = np.random.default_rng(3).standard_normal((2, 6, 5000))
    found = signals.stft(recording)
    peer = ShortTimeFFT(hann(882, sym=False), hop=441, fs=1.0, phase_shift=None)
    assert found.shape == (2, 6, 442, 10)
    assert np.allclose(found, peer.stft(recording, p0=1, p1=11))
    assert np.allclose(found[0], equations.spectra(recording[0]))
    assert signals.stft(recording.astype(np.float32)).dtype == np.complex64


@pytest.mark.parametrize("length", [20, 50, 129, 200])
def test_convolution_is_numpys_cut_or_filled_up(length):
    rng = np.random.default_rng(4)
    burst, responses = rng.standard_normal(30), rng.standard_normal((2, 3, 100))
    found = signals.convolve(burst, responses, length=length)
    assert found.shape == (2, 3, length)
    for row in np.ndindex(2, 3):
        full = np.pad(np.convolve(burst, responses[row]), (0, length))
        assert np.allclose(found[row], full[:length])


def test_powers_and_decibels_by_hand():
    """Two equal noises cost 3 dB, one 20 dB below the other 0.04 dB, one that is absent nothing."""
    assert np.allclose(signals.power(np.sin(2 * np.pi * np.arange(1000) / 50)[None]), 0.5)
    decibel = signals.decibel(np.array([1.0, 100.0, 0.5, 0.0]))
    assert np.allclose(decibel, [0.0, 20.0, -3.0103, -300.0])
    both = signals.joint_db(np.array([0.0, -10.0]), np.array([0.0, 10.0]))
    assert np.allclose(both, [-3.0103, -10.0432])
    assert signals.joint_db(None, -7.0) == pytest.approx(-7.0)
    assert signals.joint_db(np.inf, 4.0) == pytest.approx(4.0)
    assert signals.joint_db(None) == np.inf


def test_streams_of_different_purposes_are_different_and_those_of_observations_numpys():
    draws = {purpose: stream(3, purpose, 5).standard_normal() for purpose in KEYS}
    assert len(set(draws.values())) == len(KEYS)
    sequence = np.random.SeedSequence(3, spawn_key=(5,))
    assert draws["observation"] == np.random.default_rng(sequence).standard_normal()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: noise_probe(seed=-1), "probe.seed=-1: must be a whole number from 0"),
        (lambda: noise_probe(burst=0), "probe.burst=0 samples"),
        (lambda: noise_probe(length=1000), "probe.length=1000 samples"),
        (lambda: noise_probe(sample_rate=22.05), "probe.sample_rate=22.05 Hz"),
        (lambda: Probe(np.ones(20), 22050.0, 10), "probe.length=10 samples"),
        (
            lambda: Probe(np.ones((1, 20)), 22050.0, 40),
            "probe.samples=shape (1, 20): must be finite",
        ),
        (lambda: Probe(np.full(20, np.inf), 22050.0, 40), "probe.samples=NaN or infinity"),
        (lambda: signals.noise_psd(np.ones(5000, complex)), "noise.recording=complex numbers"),
    ],
)
def test_bad_probes_are_refused_in_one_line(make, message):
    with refused(message):
        make()
