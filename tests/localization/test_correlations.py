"""Correlations between their samples, against transforms over the whole recording."""

import numpy as np
from scipy import fft

from echolearn.acoustics import signals
from echolearn.bench import equations
from echolearn.localization import correlations
from echolearn.localization.correlations import PAD
from reference import FIRST, LAST, RATE, RING, loops, wave

PROBE = signals.noise_probe(length=6000)
SCALE = RATE / 343.0


def padded(recording):
    return signals.matched_filter(recording[None], PROBE, first=FIRST - PAD, last=LAST + PAD)


def steered(correlation, azimuth):
    plane = np.full(len(azimuth), np.pi / 2)
    return correlations.steered_response(
        correlation, RING, directions=(azimuth, plane), scale=SCALE
    )[0]


def pulse(lags):
    return np.exp(-0.5 * ((lags - 100) / 3) ** 2)


def test_what_lies_between_samples_is_band_limited():
    lags = np.arange(200)
    advanced = correlations.advance(pulse(lags)[None], np.array([[2.37]]))[0, 0]
    assert np.allclose(advanced, pulse(lags + 2.37), atol=1e-6)
    finer = correlations.interpolate(fft.rfft(pulse(lags)), size=200, finer=4)
    assert np.allclose(finer, pulse(np.arange(800) / 4), atol=1e-6)
    found = correlations.derivatives(fft.rfft(pulse(lags)), np.array([[40.6]]), size=200)[:, 0, 0]
    height, away = pulse(40.6 + PAD), (40.6 + PAD - 100) / 9
    assert np.allclose(found, height * np.array([1, -away, away**2 - 1 / 9]), atol=1e-6)


def test_the_steered_response_is_the_sum_of_literal_fractional_delays():
    """Padded by `PAD` lags, the short transform agrees with one over the whole recording to 1 % of
    the peak; single precision costs 1e-5 of it."""
    recording = wave(PROBE, 0.9, 180.0, 1.0)
    angles = np.array([-2.0, 0.0, 0.9, 2.4])
    found = steered(padded(recording), angles)
    assert found.shape == (4, LAST - FIRST + 1 + 2 * PAD)
    assert found.dtype == np.float32
    peak = 6 * PROBE.energy
    for row, angle in zip(found, angles, strict=True):
        whole = equations.steered(loops(PROBE, recording, angles), angle)
        assert np.abs(row[PAD:-PAD] - whole[FIRST : LAST + 1]).max() < 0.01 * peak
        eta = equations.relative(RING.positions, angle, rate=RATE)
        exact = correlations.advance(padded(recording), eta[None, None])[0, 0].sum(axis=0)
        assert np.abs(row - exact).max() < 1e-5 * peak


def test_an_echo_subtracted_from_its_correlations_leaves_nothing():
    """Between samples and directions too: the autocorrelation is tabled to 3e-4."""
    correlation = padded(wave(PROBE, 0.77, 190.37, 1.0))
    delays = 190.37 - FIRST + equations.relative(RING.positions, 0.77, rate=RATE)
    model = correlations.echo_model(PROBE.samples, delays[None], size=correlation.shape[-1])
    assert np.abs(correlation - model).max() < 1e-3 * np.abs(correlation).max()
