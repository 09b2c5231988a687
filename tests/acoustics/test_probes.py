"""Every probe: what it is made of, and what it cannot be."""

from functools import cache

import numpy as np
import pytest
from scipy.io import wavfile

from echolearn.acoustics.probes import mls_probe, sweep_probe
from echolearn.acoustics.signals import convolve, matched_filter, noise_probe
from echolearn.acoustics.types import Probe
from echolearn.checks import BadValue
from echolearn.cli.compose import compose
from echolearn.cli.config import build
from echolearn.cli.own import folder
from echolearn.simulation.probe_file import probe_file
from echolearn.survey.audio import wav_bytes

NAMES = sorted(path.stem for path in (folder() / "scene" / "probe").glob("*.yaml"))
RATE = 22050.0
SWEEPS = pytest.mark.parametrize("law", ["linear", "exponential"])


@pytest.fixture(scope="module")
def probes(tmp_path_factory):
    """Return the probe of each file of the group, as the command line has it."""
    path = tmp_path_factory.mktemp("probes") / "played.wav"
    burst = np.random.default_rng(0).uniform(-1, 1, 900)
    path.write_bytes(wav_bytes(np.pad(burst, (0, 300)), RATE))
    found = {}
    for name in NAMES:
        words = [f"scene/probe={name}", *([f"scene.probe.path={path}"] if name == "file" else [])]
        found[name] = build(compose("survey", words)[0][1]["scene"]["probe"], "scene.probe")
    return found


@cache
def density(probe):
    """Return frequencies in Hz, and the share of a burst's energy below each."""
    samples = np.frombuffer(probe)
    power = np.abs(np.fft.rfft(samples, 8 * len(samples))) ** 2
    frequency = np.fft.rfftfreq(8 * len(samples), 1 / RATE)
    return frequency, np.cumsum(power) / power.sum()


@pytest.mark.parametrize("name", NAMES)
def test_a_probe_is_a_burst_that_tells_where_an_echo_is(name, probes):
    """All come after one another, as the matched filter has them; a WAV holds them exactly."""
    probe = probes[name]
    samples = probe.samples
    assert (probe.sample_rate, probe.length) == (RATE, 20_000)
    assert 500 < len(samples) < 2500
    assert samples[-1] != 0
    assert np.array_equal(samples, samples.astype(np.float32).astype(float))
    assert 0.4 < probe.energy / len(samples) * (3 if name == "file" else 1) < 1.1

    # One peak, at the echo: nothing 10 lags from it and beyond is half as high.
    response = np.zeros(400)
    response[200] = -0.5
    heard = convolve(samples, response, length=probe.length)
    r = matched_filter(heard, probe, first=0, last=399) / probe.energy
    assert np.abs(r).argmax() == 200
    assert r[200] == pytest.approx(-0.5)
    beside = np.abs(np.delete(r, np.arange(190, 211)))
    assert beside.max() < 0.2


@pytest.mark.parametrize("name", ["mls", "noise"])
def test_what_is_white_has_energy_everywhere(name, probes):
    frequency, below = density(probes[name].samples.tobytes())
    assert np.abs(below - frequency / frequency[-1]).max() < 0.03


@SWEEPS
def test_a_sweep_has_its_energy_in_its_band(law):
    """Per octave the exponential one has as much in each; per Hz the linear one."""
    probe = sweep_probe(law=law, low=500.0, high=8000.0, seconds=0.2)
    frequency, below = density(probe.samples.tobytes())
    inside = np.diff(np.interp([500.0, 8000.0], frequency, below))
    assert inside > 0.98
    middle = 2000.0 if law == "exponential" else 4250.0
    assert np.interp(middle, frequency, below) == pytest.approx(0.5, abs=0.02)


@SWEEPS
def test_the_frequency_of_a_sweep_grows_by_its_law(law):
    """Read off the zeros of the wave, Farina's formula for the exponential one."""
    low, high, seconds = 500.0, 8000.0, 0.5
    samples = sweep_probe(
        law=law, low=low, high=high, seconds=seconds, sample_rate=48000.0, length=30_000
    ).samples
    up = np.flatnonzero((samples[:-1] < 0) & (samples[1:] >= 0))
    crossings = (up + samples[up] / (samples[up] - samples[up + 1])) / 48000.0
    period = np.diff(crossings)
    at = (crossings[:-1] + crossings[1:]) / 2 / seconds
    expected = low + (high - low) * at if law == "linear" else low * (high / low) ** at
    assert np.median(np.abs(period * expected - 1)) < 2e-3


def test_cyclic_copies_of_a_maximum_length_sequence_are_orthogonal_but_for_one():
    samples = mls_probe(bits=9).samples
    assert len(samples) == 511
    assert set(samples) == {1.0, -1.0}
    cyclic = np.fft.irfft(np.abs(np.fft.rfft(samples)) ** 2, 511)
    assert np.allclose(cyclic, [511.0] + 510 * [-1.0])


def test_a_file_gives_the_burst_that_is_in_it(probes):
    played = np.random.default_rng(0).uniform(-1, 1, 900)
    assert np.allclose(probes["file"].samples, played, atol=1e-7)


def written(tmp_path, samples, rate=RATE):
    """Return the path of a WAV file."""
    path = tmp_path / "played.wav"
    wavfile.write(path, int(rate), samples.astype(np.float32))
    return str(path)


BURST = np.ones(100)
FAULTS = {
    "none": (lambda _: probe_file(None), "probe.path=None: must be a WAV file; scene.probe.path="),
    "silence": (
        lambda place: probe_file(written(place, 0 * BURST)),
        "/played.wav=silence: must be the burst that was emitted",
    ),
    "another rate": (
        lambda place: probe_file(written(place, BURST, 48000.0)),
        "/played.wav sample_rate=48000 Hz: must be 22050 Hz; resample",
    ),
    "two channels": (
        lambda place: probe_file(written(place, np.ones((100, 2)))),
        "probe.path=2 channels: must have one channel; sox",
    ),
    "longer than the recording": (
        lambda place: probe_file(written(place, BURST), length=50),
        "probe.length=50 samples: must be a whole number from 100 .* must hold the burst",
    ),
    "no file": (lambda place: probe_file(str(place / "none.wav")), "cannot be read as WAV"),
    "a long sequence": (lambda _: mls_probe(bits=15), "probe.length=20000 samples: must"),
    "bits": (lambda _: mls_probe(bits=40), "probe.bits=40: must be a whole number from 5 to 18"),
    "a long recording": (
        lambda _: noise_probe(length=10**9),
        "probe.length=1000000000 samples: must be a whole number from 1500 to 1048576 samples",
    ),
    "a long sweep": (lambda _: sweep_probe(seconds=2.0), "probe.length=20000 samples: must be"),
    "a falling sweep": (
        lambda _: sweep_probe(low=5000.0, high=500.0),
        "probe.low=5000.0 Hz: must be a number from 1 to 454.545 Hz; low is below high",
    ),
    "beyond half the rate": (
        lambda _: sweep_probe(high=16000.0),
        "probe.high=16000.0 Hz: must be a number from 10 to 11025 Hz",
    ),
    "all ramp": (lambda _: sweep_probe(ramp=0.1), "probe.ramp=0.1 s: must be a number from 0 to"),
    "a law": (lambda _: sweep_probe(law="log"), "probe.law=log: must be linear or exponential"),
    "nothing": (
        lambda _: Probe(np.zeros(50), RATE, 100),
        "probe.samples=silence: must be a burst; is a file empty",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_no_probe_is_said_in_one_line(fault, tmp_path):
    make, message = FAULTS[fault]
    with pytest.raises(BadValue, match=message) as error:
        make(tmp_path)
    assert "\n" not in str(error.value)
