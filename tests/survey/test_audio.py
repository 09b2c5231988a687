"""Audio files: FLAC is WAV packed, and what is damaged is said in one line."""

import sys
import tracemalloc

import numpy as np
import pytest
import soundfile
from hypothesis import given, settings
from hypothesis import strategies as st

from echolearn.checks import BadValue
from echolearn.survey import audio

SHAPE = (3, 400)
SAMPLES = 0.1 * np.random.default_rng(0).standard_normal(SHAPE)


@pytest.fixture
def flac(tmp_path):
    """Return a FLAC file of 16 bits, written by another library."""
    soundfile.write(tmp_path / "a.flac", SAMPLES.T, 22050, subtype="PCM_16")
    return tmp_path / "a.flac"


def refusal(path, shape=SHAPE):
    """Return the one line with which a file is refused."""
    with pytest.raises(BadValue) as refused:
        audio.read_recording(path, 22050.0, shape=shape)
    assert str(refused.value).isprintable() and str(refused.value).startswith(str(path))
    return str(refused.value).removeprefix(str(path))


# ---------------------------------------------------------------- WAV


@given(st.integers(1, 4), st.integers(1, 50), st.integers(0, 2**32))
@settings(max_examples=20)
def test_float_recordings_survive_bit_by_bit(tmp_path, channels, length, seed):
    samples = np.random.default_rng(seed).standard_normal((channels, length)).astype(np.float32)
    (tmp_path / "any.wav").write_bytes(audio.wav_bytes(samples, 22050.0))
    assert np.array_equal(audio.read_wav(tmp_path / "any.wav", 22050.0), samples)


@pytest.mark.parametrize("frames", [1, 399])
def test_a_file_that_was_cut_is_refused(tmp_path, frames):
    """Where a disk was full, say: frames of 3 channels of 4 bytes are missing at the end."""
    data = audio.wav_bytes(SAMPLES, 22050.0)
    (tmp_path / "cut.wav").write_bytes(data[: len(data) - 12 * frames])
    there = f"it is cut off, {4800 - 12 * frames} of 4800 bytes of data are there"
    reason = f"{there}; was the disk full, or the recorder killed?"
    assert refusal(tmp_path / "cut.wav") == f": cannot be read as WAV ({reason})"


@pytest.mark.parametrize("length", [399, 400])
def test_other_chunks_and_odd_sizes_are_no_damage(tmp_path, length):
    """An odd number of bytes is padded, and whoever recorded may have left a note."""
    note = b"note" + (5).to_bytes(4, "little") + b"rain\0\0"
    soundfile.write(tmp_path / "a.wav", SAMPLES[0, :length], 22050, subtype="PCM_24")
    data = (tmp_path / "a.wav").read_bytes() + note
    size = (len(data) - 8).to_bytes(4, "little")
    (tmp_path / "b.wav").write_bytes(data[:4] + size + data[8:])
    read = audio.read_wav(tmp_path / "b.wav", 22050.0)
    assert np.array_equal(read, audio.read_wav(tmp_path / "a.wav", 22050.0)) and read.shape == (
        1,
        length,
    )


# ---------------------------------------------------------------- FLAC


@pytest.mark.parametrize(("width", "microphones"), [(16, 3), (24, 3), (16, 1)])
def test_flac_is_the_same_as_wav(tmp_path, width, microphones):
    samples = SAMPLES[:microphones]
    whole = np.rint(samples.T * 2 ** (width - 1)).astype(np.int32) << (32 - width)
    for name in ("a.wav", "a.FLAC"):
        soundfile.write(tmp_path / name, whole, 22050, subtype=f"PCM_{width}")
    wav, held = (
        audio.read_recording(tmp_path / name, 22050.0, shape=samples.shape)
        for name in ("a.wav", "a.FLAC")
    )
    assert held.dtype == np.float64 and held.flags.c_contiguous
    assert np.array_equal(wav, held) and np.abs(held - samples).max() <= 2.0 ** (1 - width)


@pytest.mark.parametrize("broken", [None, OSError("sndfile library not found")])
def test_without_soundfile_one_line_tells_what_to_install(flac, monkeypatch, broken):
    """It may also be there without its library, which it says by another kind of error."""
    if broken is None:
        monkeypatch.setitem(sys.modules, "soundfile", None)
    else:
        (flac.parent / "soundfile.py").write_text(f"raise OSError({str(broken)!r})")
        monkeypatch.syspath_prepend(flac.parent)
        monkeypatch.delitem(sys.modules, "soundfile")
    # The name of a stranger's file is no part of the advice.
    advice = "pip install soundfile, or unpack it, flac -d, and name the WAV in poses.csv"
    assert refusal(flac.rename(flac.with_name("a b.flac"))) == f": FLAC needs soundfile; {advice}"


def test_every_damage_is_an_error_or_harmless(flac):
    """FLAC has checksums: whatever bit is flipped, the samples are never others. Wherever it ends,
    it is refused."""
    data, whole = flac.read_bytes(), audio.read_recording(flac, 22050.0, shape=SHAPE)
    said = 0
    for place in range(0, 8 * len(data), 41):
        torn = bytearray(data)
        torn[place // 8] ^= 1 << place % 8
        flac.write_bytes(bytes(torn))
        try:
            assert np.array_equal(audio.read_recording(flac, 22050.0, shape=SHAPE), whole)
        except BadValue as refused:
            assert str(refused).isprintable()
            said += 1
    assert said > 0.9 * len(range(0, 8 * len(data), 41))
    for end in range(0, len(data) - 1, 211):
        flac.write_bytes(data[:end])
        refusal(flac)


@pytest.mark.parametrize(
    ("shape", "rate", "message"),
    [
        ((2, 400), 22050, "=(2, 400): must be 3 channels of 400 samples; are files of some mic"),
        ((3, 399), 22050, "=(3, 399): must be 3 channels of 400 samples; did the recorder stop"),
        ((4, 400), 22050, "=(4, 400): must be 3 channels of 400 samples; are loopbacks or un"),
        ((3, 400), 44100, " sample_rate=44100 Hz: must be 22050 Hz; resample the recording"),
    ],
)
@pytest.mark.parametrize("name", ["a.flac", "a.wav"])
def test_a_recording_that_does_not_fit_is_refused(tmp_path, shape, rate, message, name):
    soundfile.write(tmp_path / name, np.zeros(shape[::-1]), rate)
    assert refusal(tmp_path / name).startswith(message)


def test_what_is_declared_is_compared_before_anything_is_unpacked(tmp_path):
    """Twelve million samples of silence, 100 MB, in some kilobytes."""
    with soundfile.SoundFile(tmp_path / "bomb.flac", "w", 22050, 8) as file:
        for _ in range(15):
            file.write(np.zeros((100_000, 8), dtype=np.int16))
    assert (tmp_path / "bomb.flac").stat().st_size < 20_000
    tracemalloc.start()
    said = "=(8, 1500000): must be 3 channels of 400 samples; are loopbacks"
    assert refusal(tmp_path / "bomb.flac").startswith(said)
    assert tracemalloc.get_traced_memory()[1] < 1 << 20
    tracemalloc.stop()


def test_flac_of_unknown_length_is_refused(flac):
    """As an encoder leaves it that could not go back to its header."""
    data = bytearray(flac.read_bytes())
    data[21] &= 0xF0
    data[22:26] = bytes(4)
    flac.write_bytes(bytes(data))
    assert "3 channels of 400 samples" in refusal(flac)


@pytest.mark.parametrize("kind", ["OGG", "WAV", "AIFF"])
def test_another_format_is_not_read_for_its_name(tmp_path, kind):
    """Of all that soundfile could read nothing but FLAC reaches it."""
    soundfile.write(tmp_path / "a.flac", SAMPLES.T, 22050, format=kind)
    assert (
        refusal(tmp_path / "a.flac") == "=no FLAC: must be a FLAC file; other names are read as WAV"
    )


def test_flac_that_is_absent_or_too_large_is_named(tmp_path):
    assert refusal(tmp_path / "a.flac") == ": cannot be read as FLAC (there is no such file)"
    (tmp_path / "observations").mkdir()
    (tmp_path / "observations" / "a.flac").touch()
    there = tmp_path / "observations" / "a.flac"
    for name in ("a.flac", "a"):
        assert refusal(tmp_path / name).endswith(f"(there is no such file; is it {there}?)")
    for name in ("A.FLAC", " a.flac "):
        assert refusal(tmp_path / "observations" / name).endswith(f"is it {there}?)")
    assert refusal(tmp_path / "observations\\a.wav").endswith("with / between folders)")
    (tmp_path / "b.flac").write_bytes(bytes(100_000))
    said = "=100000 bytes: must be at most 75136 bytes; has it more channels"
    assert refusal(tmp_path / "b.flac").startswith(said)
