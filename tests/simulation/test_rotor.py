"""The rotor model against a recording from DREGON, and against its own formula.

The recording is no part of echolearn. Tests that need it are skipped without ECHOLEARN_DREGON, the
path of allMotors_70_mic1.wav: the paper's first author keeps it under
experiments/qualitativeExperiment in
github.com/irtiq7/Detecting-acoustic-reflector-localization-using-robot-ego-noise.
"""

import os
from dataclasses import fields

import numpy as np
import pytest
from scipy import signal

from echolearn.simulation.noise.recorded import recorded
from echolearn.simulation.noise.rotor import Rotor
from reference import RATE
from refusals import refused

CENTRES = 1000.0 * 2.0 ** (np.arange(-13, 10) / 3)
"""Hz, of third octaves from 50 Hz to 8 kHz."""
DREGON = np.array([
    4.462, 18.894, 8.662, 10.402, 9.861, 8.345, 7.564, 6.658, 5.059, 3.809, 2.446, 1.705,
    1.013, 1.451, 0.392, 0.322, 0.256, 0.260, 0.709, 0.465, 0.617, 0.523, 0.141,
]) / 100  # fmt: skip
"""Shares of the power in them: microphone 1, all motors at 70 revolutions/s (measured below)."""


def sound(*, seconds=10.0, seed=0, rate=RATE, **changes):
    """Return what is recorded of a rotor."""
    rng = np.random.default_rng(seed)
    return Rotor(**changes)(length=int(seconds * rate), sample_rate=rate, rng=rng)


def density(**changes):
    """Return frequencies from 0 Hz in steps of 1 Hz, and the power in each, mean of ten draws."""
    sounds = np.array([sound(seed=seed, **changes) for seed in range(10)])
    frequencies, power = signal.welch(sounds, RATE, nperseg=int(RATE))
    return frequencies, power.mean(axis=0)


def bands(frequencies, power):
    """Return the shares of the power in third octaves."""
    low, high = CENTRES * 2 ** (-1 / 6), CENTRES * 2 ** (1 / 6)
    inside = (frequencies[:, None] >= low) & (frequencies[:, None] < high)
    return power @ inside / power.sum()


def level(samples, low, high, *, seconds=0.02, rate=RATE):
    """Return the level of a band in successive blocks, in dB."""
    band = signal.butter(4, [low, high], "bandpass", fs=rate, output="sos")
    block = int(seconds * rate)
    blocks = signal.sosfiltfilt(band, samples)[: len(samples) // block * block].reshape(-1, block)
    return 10 * np.log10(np.mean(blocks**2, axis=1))


def test_its_spectrum_is_that_of_a_recording():
    """90 % below 463 Hz, the strongest line at 70 Hz, and third octaves, but for whines of the
    motors, within 3 dB."""
    frequencies, power = density()
    assert power[frequencies < 463].sum() / power.sum() == pytest.approx(0.90, abs=0.01)
    assert frequencies[power.argmax()] == pytest.approx(70.0, abs=1.0)
    assert np.abs(10 * np.log10(bands(frequencies, power) / DREGON)).max() < 3.0


def test_the_wash_comes_in_gusts_and_the_hiss_is_steady_as_in_the_recording():
    """In the recording levels of 20 ms wander by 5 to 7 dB in bands below 500 Hz, and by 1.4 dB
    above 4 kHz."""
    gusty, calm = (sound(seconds=60.0, gust_db=gust_db) for gust_db in (6.0, 0.0))
    assert 4.0 < level(gusty, 200, 500).std() < 7.0
    assert level(calm, 200, 500).std() < 2.5
    assert level(gusty, 4000, 11000).std() < 1.5


def test_gusts_are_as_strong_and_as_long_as_they_are_told():
    wash = {"seconds": 150.0, "rate": 2205.0, "tonal": 0.0, "hiss": 0.0, "gust": 2.0}
    found = [level(sound(seed=n, **wash), 60, 1000, seconds=0.2, rate=2205.0) for n in range(6)]
    assert np.std(found, axis=1).mean() == pytest.approx(6.0, rel=0.1)
    after = [np.corrcoef(each[:-10], each[10:])[0, 1] for each in found]
    assert np.mean(after) == pytest.approx(np.exp(-1), abs=0.1)


def test_lines_stand_at_the_harmonics_of_the_rotor_and_the_blades_stand_out():
    _, power = density(jitter=0.001, tonal=0.99)
    orders = np.arange(1, 11)
    near = np.arange(-4, 5)
    lines = power[70 * orders[:, None] + near].sum(axis=1)
    between = power[70 * orders[:, None] + 35 + near].sum(axis=1)
    assert (lines > 10 * between).all()
    expected = np.where(orders % 2 == 0, 10**0.3, 1.0) / orders**2
    assert np.allclose(10 * np.log10(lines / lines[0] / expected), 0.0, atol=0.7)
    three = Rotor(blades=3).powers(RATE)
    assert three[2] / three[0] == pytest.approx(10**0.3 / 9)


def test_the_wash_falls_by_9_db_per_octave_above_its_corner_and_begins_at_20_hz():
    _, power = density(tonal=0.0, hiss=0.0, gust_db=0.0)
    octaves = [power[f : 2 * f].mean() for f in (700, 1400, 2800, 5600)]
    assert np.allclose(np.diff(10 * np.log10(octaves)), -9.0, atol=0.4)
    assert power[:18].max() < 1e-2 * power[23:40].mean()


def test_the_hiss_is_flat_and_ends_at_its_corner():
    _, power = density(tonal=0.0, hiss=1.0)
    low, high, above = (power[f : f + 500].mean() for f in (500, 4000, 9500))
    assert high / low == pytest.approx(1.0, abs=0.1)
    assert above / low == pytest.approx(1 / (1 + (9750 / 6500) ** 8), rel=0.2)


@pytest.mark.parametrize(
    ("seconds", "rate", "draws", "error"), [(60.0, 2205.0, 40, 0.08), (1 / RATE, RATE, 800, 0.3)]
)
def test_it_has_unit_power(seconds, rate, draws, error):
    """Gusts scatter the power of ten seconds by a quarter, hence 40 sounds of a minute; the
    shortest sound is a single sample."""
    sounds = [sound(seconds=seconds, rate=rate, seed=seed) for seed in range(draws)]
    assert np.mean(np.square(sounds)) == pytest.approx(1.0, abs=error)


def test_speed_wanders_as_much_as_it_is_told():
    """One rotor, one line: its instantaneous frequency has the deviation and the time constant that
    were asked for."""
    about = {"rotors": 1, "harmonics": 1, "tonal": 1.0, "jitter": 0.02, "wander": 0.5}
    one = sound(seconds=200.0, rate=2205.0, **about)
    phase = np.unwrap(np.angle(signal.hilbert(one)))
    speed = np.diff(phase[::44]) * 2205 / 44 / (2 * np.pi)  # 50 a second
    assert speed.mean() == pytest.approx(70.0, abs=0.4)
    centred = speed[50:-50] - speed[50:-50].mean()
    assert centred.std() == pytest.approx(1.4, rel=0.2)
    kept = np.mean(centred[25:] * centred[:-25]) / centred.var()
    assert kept == pytest.approx(np.exp(-1), abs=0.15)


def test_waves_are_continuous_and_exact():
    """Without jitter a single line is a sine of amplitude sqrt(2), from beginning to end."""
    one = sound(seconds=1.0, rotors=1, harmonics=1, tonal=1.0, jitter=0.0)
    angle = 2 * np.pi * 70.0 * np.arange(len(one)) / RATE
    basis = np.stack([np.cos(angle), np.sin(angle)])
    weights = np.linalg.lstsq(basis.T, one, rcond=None)[0]
    assert np.hypot(*weights) == pytest.approx(np.sqrt(2), rel=1e-5)
    assert np.abs(one - weights @ basis).max() < 1e-5


def test_harmonics_stop_at_the_nyquist_frequency():
    assert len(Rotor(jitter=0.0).powers(1000.0)) == 7
    low = sound(seconds=20.0, rate=1000.0, jitter=0.0, tonal=1.0)
    frequencies, power = signal.welch(low, 1000.0, nperseg=1000)
    folded = power[(frequencies % 70 > 5) & (frequencies % 70 < 65)].sum()
    assert folded < 1e-3 * power.sum()


@pytest.mark.parametrize("name", [field.name for field in fields(Rotor)])
@pytest.mark.parametrize("value", [-101.0, 1e9, "fast", float("nan")])
def test_bad_rotors_are_refused(name, value):
    with refused(f"diffuse.source.{name}={value}"):
        Rotor(**{name: value})


# ---------------------------------------------------------------- the recording itself


@pytest.fixture(scope="module")
def samples():
    """Return the whole recording, of unit power."""
    path = os.environ.get("ECHOLEARN_DREGON")
    if path is None:
        pytest.skip("needs ECHOLEARN_DREGON, the path of the recording")
    return recorded(path).samples.astype(float)


def test_the_recording_has_the_spectrum_and_the_gusts_that_the_model_is_held_against(samples):
    frequencies, power = signal.welch(samples, RATE, nperseg=int(RATE))
    assert np.allclose(100 * bands(frequencies, power), 100 * DREGON, atol=0.001)
    below = frequencies[np.searchsorted(np.cumsum(power) / power.sum(), 0.9)]
    assert below == pytest.approx(459, abs=5)
    assert frequencies[power.argmax()] == pytest.approx(68, abs=1)
    wandering = [level(samples, *band).std() for band in ((80, 200), (200, 500), (4000, 11000))]
    assert np.round(wandering, 1).tolist() == [6.0, 7.0, 1.4]
