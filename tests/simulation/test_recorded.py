"""Noise from files: rates, formats, channels, and everything a file can have wrong with it."""

import numpy as np
import pytest
import soundfile

from echolearn.simulation.noise.diffuse import Diffuse
from echolearn.simulation.noise.recorded import Recorded, recorded
from reference import RATE
from refusals import refused
from sounds import draw


def tones(rate=22050, *, hertz=300.0, channels=1):
    """Return 8 s of a tone, a multiple of its frequency in each further channel, shape (K, C)."""
    time = np.arange(8 * rate) / rate
    return 0.1 * np.sin(2 * np.pi * hertz * np.outer(time, np.arange(1, channels + 1)))


@pytest.fixture
def read(tmp_path):
    """Return a function that writes samples into a file, and reads a channel of it."""

    def through(samples, *, rate=22050, kind="wav", channel=None, **written):
        path = tmp_path / f"noise.{kind}"
        soundfile.write(path, samples, rate, **written)
        return recorded(str(path), channel=channel)

    return through


def spectrum(noise):
    """Return amplitudes at multiples of 1/8 Hz."""
    return np.abs(np.fft.rfft(noise.samples, 8 * 22050))


@pytest.mark.parametrize(("rate", "kind"), [(8000, "wav"), (48000, "flac"), (22050, "wav")])
def test_a_tone_keeps_its_pitch_and_length_at_any_rate(read, rate, kind):
    noise = read(tones(rate), rate=rate, kind=kind)
    assert noise.sample_rate == RATE
    assert len(noise.samples) == pytest.approx(8 * RATE, abs=2)
    assert spectrum(noise).argmax() == pytest.approx(300 * 8, abs=1)
    assert np.mean(noise.samples**2) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("channel", [1, 2, 3])
def test_channels_are_counted_from_one(read, channel):
    noise = read(tones(channels=3), channel=channel)
    assert spectrum(noise).argmax() == channel * 300 * 8


def test_channels_can_be_mixed(read):
    found = spectrum(read(tones(channels=2), kind="flac", channel="mix"))
    assert found[300 * 8] == pytest.approx(found[600 * 8], rel=0.01)


def test_a_stretch_is_taken_from_anywhere_and_as_it_is():
    ramp = Recorded(np.arange(1000, dtype=np.float32), RATE)

    def stretch(seed, length):
        return ramp(length=length, sample_rate=RATE, rng=np.random.default_rng(seed))

    starts = set()
    for seed in range(50):
        found = stretch(seed, 900)
        assert np.array_equal(found, found[0] + np.arange(900))
        starts.add(int(found[0]))
    assert starts <= set(range(101))
    assert len(starts) > 20
    assert np.array_equal(stretch(0, 1000), ramp.samples)


def test_six_microphones_take_six_stretches(read):
    """6 x (20 000 + 1 024) samples are 5.72 s: 6 s suffice, 5.5 s do not."""
    noise = 0.1 * np.random.default_rng(0).standard_normal(6 * 22050)
    field = draw(Diffuse(read(noise)), seed=1)
    assert np.abs(np.corrcoef(field[0], field[3])[0, 1]) < 0.1
    with refused("diffuse.source.path=5.50 s of sound: must be at least 5.72 s;"):
        draw(Diffuse(read(noise[: int(5.5 * 22050)])))


def test_another_rate_than_the_probes_is_refused():
    slow = Recorded(np.ones(100, dtype=np.float32), 8000.0)
    with refused("diffuse.source.sample_rate=8000 Hz: must be 22050 Hz"):
        slow(length=10, sample_rate=RATE, rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        (np.zeros(5000), "silence: must be a recording of noise"),
        (np.full(5000, 0.25), "silence"),
        (
            np.concatenate([tones(), np.zeros((5000, 1)), tones()]),
            "silence at 8.0 s: must be noise throughout",
        ),
        (np.zeros(0), "no samples"),
        (np.append(tones(), np.nan), "NaN or infinity: must be finite"),
        (np.append(tones(), np.inf), "NaN or infinity"),
    ],
)
def test_recordings_that_cannot_be_used_are_refused(read, tmp_path, samples, message):
    with refused(f"diffuse.source.path={tmp_path / 'noise.wav'}, {message}"):
        read(samples, subtype="FLOAT")


@pytest.mark.parametrize("channel", [None, 3, 0, "left", True])
def test_channels_that_are_not_there_are_refused(read, channel):
    message = "must be a whole number from 1 to 2; that many has the file; mix is"
    with refused(f"diffuse.source.channel={channel}: {message}"):
        read(tones(channels=2), channel=channel)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (None, "must be a WAV or FLAC file; give its name"),
        ("", "must be a WAV or FLAC file"),
        (5, "must be a WAV or FLAC file"),
        ("nowhere.wav", "must be a file; is it relative to "),
        (".", "must be a file"),
    ],
)
def test_files_that_are_not_there_are_named(path, message):
    with refused(f"diffuse.source.path={path}: {message}"):
        recorded(path)


@pytest.mark.parametrize(
    "content", [b"", b"not audio", b"RIFF\x00\x00\x00\x00WAVE", b"fLaC" + bytes(100)]
)
def test_files_that_are_no_audio_are_refused(tmp_path, content):
    path = tmp_path / "text.wav"
    path.write_bytes(content)
    with refused(f"diffuse.source.path={path}"):
        recorded(str(path))
