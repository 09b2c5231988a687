"""Signals against the sums that define them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import ShortTimeFFT
from scipy.signal.windows import hann

from echolearn.acoustics import signals
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Probe
from echolearn.bench import equations
from echolearn.checks import BadValue

SHORT = noise_probe(burst=50, length=300)


def test_the_probe_is_white_gaussian_and_always_the_same() -> None:
    samples = noise_probe().samples
    assert samples.shape == (1500,)
    assert abs(samples.mean()) < 4 / np.sqrt(1500)
    assert samples.var() == pytest.approx(1.0, abs=4 * np.sqrt(2 / 1500))
    correlation = np.correlate(samples, samples, "full") / (samples @ samples)
    assert np.abs(np.delete(correlation, 1499)).max() < 5 / np.sqrt(1500)
    assert np.array_equal(samples, noise_probe().samples)
    assert not np.array_equal(samples, noise_probe(seed=1).samples)


def test_the_probe_survives_a_float32_file() -> None:
    samples = noise_probe(seed=3).samples
    assert np.array_equal(samples, samples.astype(np.float32).astype(float))


@pytest.mark.parametrize(("first", "last"), [(0, 0), (0, 40), (7, 120), (240, 299), (100, 400)])
def test_the_matched_filter_is_the_correlation(first: int, last: int) -> None:
    recording = np.random.default_rng(1).standard_normal((2, 3, 300))
    found = signals.matched_filter(recording, SHORT, first=first, last=last)
    assert found.shape == (2, 3, last - first + 1)
    silence = np.zeros(last + 50)
    for batch in range(2):
        for microphone in range(3):
            full = np.correlate(
                np.concatenate([recording[batch, microphone], silence]), SHORT.samples, "valid"
            )
            assert np.allclose(found[batch, microphone], full[first : last + 1])


@given(st.integers(10, 200))
def test_a_probe_delayed_by_k_samples_peaks_at_lag_k(delay: int) -> None:
    recording = np.roll(equations.padded(SHORT.samples, 300), delay)
    found = signals.matched_filter(recording[None], SHORT, first=10, last=200)[0]
    assert 10 + found.argmax() == delay
    assert found.max() == pytest.approx(SHORT.samples @ SHORT.samples)


@pytest.mark.parametrize(("first", "last"), [(0, 0), (3, 90), (240, 299), (260, 320)])
def test_energy_is_that_of_the_samples_under_the_burst(first: int, last: int) -> None:
    recording = np.random.default_rng(2).standard_normal((2, 300))
    found = signals.energy_under_probe(recording, SHORT, first=first, last=last)
    loop = [
        [np.sum(row[lag : lag + 50] ** 2) for lag in range(first, last + 1)] for row in recording
    ]
    assert np.allclose(found, loop)


def test_energy_stays_that_of_a_quiet_part_after_a_loud_one() -> None:
    """A running sum must not lose the quiet part to rounding."""
    recording = np.concatenate([np.full(150, 1e3), np.full(150, 1e-3)])[None]
    found = signals.energy_under_probe(recording, SHORT, first=100, last=240)
    assert found[0, -1] == pytest.approx(50 * 1e-6, rel=0.01)


def test_frames_are_scipys() -> None:
    recording = np.random.default_rng(3).standard_normal((2, 6, 5000))
    found = signals.stft(recording)
    peer = ShortTimeFFT(hann(882, sym=False), hop=441, fs=1.0, phase_shift=None)
    expected = peer.stft(recording, p0=1, p1=1 + found.shape[-1])
    assert found.shape == (2, 6, 442, 10)
    assert np.allclose(found, expected)
    assert np.allclose(found[0], equations.spectra(recording[0]))


def test_frames_keep_single_precision() -> None:
    assert signals.stft(np.zeros((1, 2000), dtype=np.float32)).dtype == np.complex64


@pytest.mark.parametrize("length", [20, 50, 129, 200])
def test_convolution_is_numpys_cut_or_filled_up(length: int) -> None:
    rng = np.random.default_rng(4)
    burst, responses = rng.standard_normal(30), rng.standard_normal((2, 3, 100))
    found = signals.convolve(burst, responses, length)
    assert found.shape == (2, 3, length)
    for batch in range(2):
        for microphone in range(3):
            full = np.concatenate(
                [np.convolve(burst, responses[batch, microphone]), np.zeros(length)]
            )[:length]
            assert np.allclose(found[batch, microphone], full)


def test_power_of_a_sine_is_a_half() -> None:
    assert np.allclose(signals.power(np.sin(2 * np.pi * np.arange(1000) / 50)[None]), 0.5)


def test_decibels_by_hand() -> None:
    assert np.allclose(
        signals.decibel(np.array([1.0, 100.0, 0.5, 0.0])), [0.0, 20.0, -3.0103, -300.0]
    )


def test_noises_add_up_to_one_ratio() -> None:
    """Two equal noises cost 3 dB, one 20 dB below the other 0.04 dB; what is absent costs nothing."""
    assert np.allclose(
        signals.joint_db(np.array([0.0, -10.0]), np.array([0.0, 10.0])), [-3.0103, -10.0432]
    )
    assert signals.joint_db(None, -7.0) == pytest.approx(-7.0)
    assert signals.joint_db(np.inf, 4.0) == pytest.approx(4.0)
    assert signals.joint_db(None) == np.inf


@pytest.mark.parametrize(
    ("make", "name"),
    [
        (lambda: noise_probe(seed=-1), "probe.seed=-1"),
        (lambda: noise_probe(burst=0), "probe.burst=0 samples"),
        (lambda: noise_probe(length=1000), "probe.length=1000 samples"),
        (lambda: noise_probe(length=20000.5), "probe.length=20000.5 samples"),
        (lambda: noise_probe(sample_rate=22.05), "probe.sample_rate=22.05 Hz"),
        (lambda: noise_probe(sample_rate="fast"), "probe.sample_rate=fast Hz"),
        (lambda: Probe(np.ones(20), 22050.0, 10), "probe.length=10 samples"),
        (
            lambda: Probe(np.ones((1, 20)), 22050.0, 40),
            "probe.samples=shape (1, 20): finite numbers, shape (L,)",
        ),
        (lambda: Probe(np.full(20, np.inf), 22050.0, 40), "probe.samples=NaN or infinity"),
        (lambda: Probe(None, 22050.0, 40), "probe.samples=dtype object"),
        (
            lambda: signals.noise_psd(np.ones(5000, complex)),
            "noise.recording=dtype complex128: real samples",
        ),
    ],
)
def test_bad_probes_are_refused_in_one_line(make: object, name: str) -> None:
    with pytest.raises(BadValue) as refused:
        make()
    assert str(refused.value).startswith(name)
    assert "\n" not in str(refused.value)
