"""Noise from files: rates, formats, channels, and everything a file can have wrong with it."""

from typing import Any

import numpy as np
import pytest
import soundfile

from echolearn.acoustics.geometry import circular_array
from echolearn.checks import BadValue
from echolearn.simulation.noise.diffuse import Diffuse
from echolearn.simulation.noise.recorded import Recorded, recorded

RATE = 22050


def tones(rate, *, seconds=8.0, hertz=300.0, channels=1):
    """Return a tone, a multiple of its frequency in each further channel, shape (K,) or (K,
    channels)."""
    time = np.arange(int(seconds * rate)) / rate
    waves = np.stack([np.sin(2 * np.pi * hertz * (n + 1) * time) for n in range(channels)], axis=1)
    return 0.1 * (waves if channels > 1 else waves[:, 0])


def pitch(noise):
    """Return the strongest frequency in Hz."""
    spectrum = np.abs(np.fft.rfft(noise.samples))
    return float(spectrum.argmax() * noise.sample_rate / len(noise.samples))


@pytest.mark.parametrize(("rate", "kind"), [(8000, "wav"), (48000, "flac"), (22050, "wav")])
def test_a_tone_keeps_its_pitch_and_length_at_any_rate(tmp_path, rate, kind):
    soundfile.write(tmp_path / f"tone.{kind}", tones(rate), rate)
    noise = recorded(str(tmp_path / f"tone.{kind}"))
    assert noise.sample_rate == RATE
    assert len(noise.samples) == pytest.approx(8 * RATE, abs=2)
    assert pitch(noise) == pytest.approx(300.0, abs=0.2)
    assert np.mean(noise.samples**2) == pytest.approx(1.0, abs=1e-3)


def test_what_lies_above_the_new_nyquist_frequency_is_gone(tmp_path):
    soundfile.write(tmp_path / "both.wav", tones(44100) + tones(44100, hertz=15000.0), 44100)
    spectrum = np.abs(np.fft.rfft(recorded(str(tmp_path / "both.wav")).samples))
    folded = round(7050 * 8)
    assert spectrum[folded - 20 : folded + 20].max() < 1e-3 * spectrum.max()


@pytest.mark.parametrize(("channel", "hertz"), [(1, 300.0), (2, 600.0), (3, 900.0)])
def test_channels_are_counted_from_one(tmp_path, channel, hertz):
    soundfile.write(tmp_path / "three.wav", tones(RATE, channels=3), RATE)
    assert pitch(recorded(str(tmp_path / "three.wav"), channel=channel)) == pytest.approx(
        hertz, abs=0.2
    )


def test_channels_can_be_mixed(tmp_path):
    soundfile.write(tmp_path / "two.flac", tones(RATE, channels=2), RATE)
    spectrum = np.abs(np.fft.rfft(recorded(str(tmp_path / "two.flac"), channel="mix").samples))
    assert spectrum[300 * 8] == pytest.approx(spectrum[600 * 8], rel=0.01)


def test_a_stretch_is_taken_from_anywhere_and_as_it_is():
    ramp = Recorded(np.arange(1000, dtype=np.float32), 22050.0)
    starts = set()
    for seed in range(50):
        stretch = ramp(length=900, sample_rate=22050.0, rng=np.random.default_rng(seed))
        assert np.array_equal(np.diff(stretch), np.ones(899))
        starts.add(int(stretch[0]))
    assert min(starts) >= 0
    assert max(starts) <= 100
    assert len(starts) > 20
    whole = ramp(length=1000, sample_rate=22050.0, rng=np.random.default_rng(0))
    assert np.array_equal(whole, ramp.samples)


def test_six_microphones_take_six_stretches(tmp_path):
    """6 x (20 000 + 1 024) samples are 5.72 s: 6 s suffice, 5.5 s do not."""
    field = {}
    for seconds in (5.5, 6.0):
        path = tmp_path / f"{seconds}.wav"
        soundfile.write(
            path, 0.1 * np.random.default_rng(0).standard_normal(int(seconds * RATE)), RATE
        )
        field[seconds] = Diffuse(recorded(str(path)))
    arguments: dict[str, Any] = {
        "length": 20000,
        "sample_rate": 22050.0,
        "rng": np.random.default_rng(1),
    }
    heard = field[6.0](circular_array(), **arguments)
    assert np.abs(np.corrcoef(heard[0], heard[3])[0, 1]) < 0.1
    with pytest.raises(
        BadValue,
        match=r"^diffuse.source.path=5.50 s of sound: must be at least 5.72 s; .* or more$",
    ):
        field[5.5](circular_array(), **arguments)


def test_another_rate_than_the_probes_is_refused():
    with pytest.raises(BadValue, match=r"^diffuse.source.sample_rate=8000 Hz: must be 22050 Hz"):
        Recorded(np.ones(100, dtype=np.float32), 8000.0)(
            length=10, sample_rate=22050.0, rng=np.random.default_rng(0)
        )


@pytest.mark.parametrize(
    ("samples", "channel", "message"),
    [
        (np.zeros(5000), None, "silence: must be a recording of noise"),
        (np.full(5000, 0.25), None, "silence"),
        (
            np.concatenate([tones(RATE), np.zeros(5000), tones(RATE)]),
            None,
            "silence at 8.0 s: must be noise throughout",
        ),
        (np.zeros(0), None, "no samples"),
        (np.append(tones(RATE), np.nan), None, "NaN or infinity: must be finite"),
        (np.append(tones(RATE), np.inf), None, "NaN or infinity"),
        (
            tones(RATE, channels=2),
            None,
            "channel=None: must be from 1 to 2, or mix; the file has 2 channels",
        ),
        (tones(RATE, channels=2), 3, "channel=3: must be from"),
        (tones(RATE, channels=2), 0, "channel=0: must be"),
        (tones(RATE, channels=2), "left", "channel=left: must be"),
        (tones(RATE, channels=2), True, "channel=True"),
    ],
)
def test_recordings_that_cannot_be_used_are_refused(tmp_path, samples, channel, message):
    soundfile.write(tmp_path / "bad.wav", samples, RATE, subtype="FLOAT")
    with pytest.raises(BadValue) as refused:
        recorded(str(tmp_path / "bad.wav"), channel=channel)
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("path", "message"),
    [
        (None, "diffuse.source.path=None: must be a WAV or FLAC file; give its name"),
        ("", "diffuse.source.path=: must be a WAV or FLAC file"),
        (5, "diffuse.source.path=5: must be a WAV or FLAC file"),
        ("nowhere.wav", "diffuse.source.path=nowhere.wav: must be a file; is it relative to "),
        (".", "diffuse.source.path=.: must be a file"),
    ],
)
def test_files_that_are_not_there_are_named(path, message):
    with pytest.raises(BadValue) as refused:
        recorded(path)
    assert str(refused.value).startswith(message)


@pytest.mark.parametrize(
    "content", [b"", b"not audio", b"RIFF\x00\x00\x00\x00WAVE", b"fLaC" + bytes(100)]
)
def test_files_that_are_no_audio_are_refused(tmp_path, content):
    (tmp_path / "text.wav").write_bytes(content)
    with pytest.raises(BadValue) as refused:
        recorded(str(tmp_path / "text.wav"))
    assert str(refused.value).startswith(f"diffuse.source.path={tmp_path / 'text.wav'}")
    assert "\n" not in str(refused.value)
