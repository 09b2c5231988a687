"""WAV as recorders leave it: every container of the same numbers is read to the same samples."""

import gzip
import struct
from io import BytesIO

import numpy as np
import pytest
import soundfile
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import wavfile

from echolearn.survey import wav

QUIET = np.random.default_rng(0).normal(0.0, 0.02, (200, 3))
WHOLE = np.rint(QUIET * 2**23).astype(np.int64)
"""Numbers of 24 bits, frames first."""

GUID = bytes.fromhex("000000001000800000aa00389b71")


def words(whole, width, order="<"):
    """Return whole numbers as words of so many bytes, those that do not fit cut off."""
    plain = np.ascontiguousarray(whole.reshape(-1), dtype=f"{order}i8").view(np.uint8)
    cut = slice(None, width) if order == "<" else slice(-width, None)
    return bytes(plain.reshape(-1, 8)[:, cut])


def chunk(name, body, order="<", size=None):
    length = len(body) if size is None else size
    return name + struct.pack(f"{order}I", length) + body + bytes(len(body) % 2)


def file(
    data,
    *,
    width=2,
    bits=None,
    kind=1,
    begin=b"RIFF",
    valid=None,
    before=b"",
    after=b"",
    sizes=(None, None),
):
    """Return a file of three channels; `sizes` are those that the header has of file and data."""
    order = ">" if begin == b"RIFX" else "<"
    layout = (kind, 3, 8000, 8000 * 3 * width, 3 * width, 8 * width if bits is None else bits)
    about = struct.pack(f"{order}HHIIHH", *layout)
    if valid is not None:
        about += struct.pack(f"{order}HHIH", 22, valid, 0, 1) + GUID
    body = before + chunk(b"fmt ", about, order) + chunk(b"data", data, order, sizes[1]) + after
    length = len(body) + 4 if sizes[0] is None else sizes[0]
    return begin + struct.pack(f"{order}I", length) + b"WAVE" + body


def whole_of(content, bits=24):
    """Return what is read as whole numbers of so many bits, frames first."""
    rate, samples = wav.read(content)
    assert rate == 8000 and samples.dtype == float and samples.flags.c_contiguous
    return samples.T * 2.0 ** (bits - 1)


BE = {"begin": b"RIFX"}
PLACES = {
    "24 packed": file(words(WHOLE, 3), width=3),
    "24 packed, big-endian": file(words(WHOLE, 3, ">"), width=3, **BE),
    "upper bits": file(words(WHOLE << 8, 4), width=4),
    "upper bits, told": file(words(WHOLE << 8, 4), width=4, kind=wav.EXTENSIBLE, valid=24),
    "upper bits, 24 of ALSA": file(words(WHOLE << 8, 4), width=4, bits=24),
    "upper bits, big-endian": file(words(WHOLE << 8, 4, ">"), width=4, **BE),
    "zero-padded": file(words(WHOLE & 0xFFFFFF, 4), width=4),
    "zero-padded, told": file(words(WHOLE & 0xFFFFFF, 4), width=4, kind=wav.EXTENSIBLE, valid=24),
    "zero-padded, 24 of ALSA": file(words(WHOLE & 0xFFFFFF, 4), width=4, bits=24),
    "zero-padded, big-endian": file(words(WHOLE & 0xFFFFFF, 4, ">"), width=4, **BE),
    "sign-extended, told": file(words(WHOLE, 4), width=4, kind=wav.EXTENSIBLE, valid=24),
    "sign-extended, 24 of ALSA": file(words(WHOLE, 4), width=4, bits=24),
    "extensible, no bits told": file(words(WHOLE, 3), width=3, kind=wav.EXTENSIBLE, valid=0),
    "64 bits": file(words(WHOLE << 40, 8), width=8),
}


@pytest.mark.parametrize("name", PLACES)
def test_24_bits_are_the_same_wherever_they_stand(name):
    assert np.array_equal(whole_of(PLACES[name]), WHOLE)


def test_words_of_32_that_are_zero_padded_no_more_are_left_alone():
    """An offset, whole numbers of 32 bits, a header that is wrong: nothing was cut off there."""
    offset = WHOLE // 16 + (1 << 23)
    for whole in (offset, WHOLE, np.abs(WHOLE) + 1, WHOLE << 8 | 1):
        assert np.array_equal(whole_of(file(words(whole, 4), width=4), 32), whole)
    full = WHOLE << 8 | 1
    assert np.array_equal(whole_of(file(words(full, 4), width=4, bits=24), 32), full)


@pytest.mark.parametrize("bits", wav.NARROW)
@pytest.mark.parametrize("loudness", [0.01, 0.3])
def test_other_converters_are_zero_padded_alike(bits, loudness):
    signal = np.random.default_rng(1).normal(0.0, loudness, (500, 3)).clip(-1, 0.99)
    whole = np.rint(signal * 2 ** (bits - 1)).astype(np.int64)
    cut = whole & ((1 << bits) - 1)
    assert np.array_equal(whole_of(file(words(cut, 4), width=4), bits), whole)


NEVER = {
    "ffmpeg": (0xFFFFFFFF, 0xFFFFFFFF),
    "arecord": (0x80000024, 0x80000000),
    "sox": (0x7FFFF024, 0x7FFFF000),
    "arecord of an hour": (36 + 8000 * 18 * 3600, 8000 * 18 * 3600),
    "zeros": (0, 0),
    "only the file's is zero": (0, None),
    "python": (36, 0),
}


@pytest.mark.parametrize("order", [{}, BE])
@pytest.mark.parametrize("torn", [0, 1, 17])
@pytest.mark.parametrize("name", NEVER)
def test_a_length_that_was_never_written_is_that_of_the_file(name, torn, order):
    """Of a recorder that was killed the last frame may be torn."""
    data = words(WHOLE, 3, ">" if order else "<")
    content = file(data, width=3, sizes=NEVER[name], **order)[: -torn or None]
    if torn and NEVER[name][1] is None:
        with pytest.raises(ValueError, match="^it is cut off, "):
            wav.read(content)
    else:
        assert np.array_equal(whole_of(content), WHOLE[: 200 - -(-torn // 9)])


def test_sizes_of_64_bits_stand_in_a_chunk_of_their_own():
    data = words(WHOLE, 3)
    for begin in (b"RF64", b"BW64"):
        for told in (len(data), 0):
            long = chunk(b"ds64", struct.pack("<QQQI", 0, told, 0, 0))
            note = chunk(b"note", b"rain") if told else b""
            endless = (0xFFFFFFFF, 0xFFFFFFFF)
            content = file(data, width=3, begin=begin, before=long, after=note, sizes=endless)
            assert np.array_equal(whole_of(content), WHOLE)


SUBTYPES = ["PCM_U8", "PCM_16", "PCM_24", "PCM_32", "FLOAT", "DOUBLE"]


@given(
    st.sampled_from(SUBTYPES),
    st.sampled_from(["WAV", "WAVEX", "RF64", "WAV BIG"]),
    st.integers(1, 9),
    st.integers(0, 60),
    st.integers(0, 2**32),
)
@settings(max_examples=150)
def test_what_libsndfile_writes_is_read_as_it_reads_it(subtype, format, channels, length, seed):
    signal = np.random.default_rng(seed).uniform(-1, 1, (length, channels))
    kind, _, big = format.partition(" ")
    buffer = BytesIO()
    endian = "BIG" if big else "FILE"
    soundfile.write(buffer, signal, 22050, subtype=subtype, format=kind, endian=endian)
    expected, _ = soundfile.read(BytesIO(buffer.getvalue()), always_2d=True)
    rate, samples = wav.read(buffer.getvalue())
    assert rate == 22050 and np.array_equal(samples, expected.T)


@given(st.sampled_from(["u1", "i2", "i4", "i8", "f4", "f8", ">i2", ">f4"]), st.integers(0, 40))
@settings(max_examples=40)
def test_what_scipy_writes_is_read_back(kind, length):
    signal = (100 + 20 * np.random.default_rng(length).standard_normal((length, 2))).astype(kind)
    buffer = BytesIO()
    wavfile.write(buffer, 8000, signal)
    half = 1.0 if signal.dtype.kind == "f" else 2.0 ** (8 * signal.itemsize - 1)
    expected = signal / half - (kind == "u1")
    assert np.array_equal(wav.read(buffer.getvalue())[1], expected.T)


GOOD = words(WHOLE, 3)
TEXTS = chunk(b"LIST", b"INFOISFT\x06\0\0\0Lavf58")
ODD = b"JUNK" + struct.pack("<I", 5) + b"abcde"
LEFT = {
    "a length of 0 in a file that knows its own": file(GOOD, width=3, sizes=(None, 0)),
    "texts behind data of unknown length": file(
        GOOD, width=3, sizes=(2**32 - 1, 2**32 - 1), after=TEXTS
    ),
    "an odd chunk that is filled up by a blank": file(GOOD, width=3, before=ODD + b" "),
    "an odd chunk that is filled up by a letter": file(GOOD, width=3, before=ODD + b"e"),
    "an odd chunk that is not filled up": file(GOOD, width=3, before=ODD),
}


@pytest.mark.parametrize("name", LEFT)
def test_what_recorders_leave_around_the_data_is_no_sound(name):
    assert np.array_equal(whole_of(LEFT[name]), WHOLE)


def test_data_of_no_length_before_another_chunk_are_none():
    assert wav.read(file(b"", width=3, after=TEXTS))[1].shape == (3, 0)


REFUSED = {
    "it is empty; was the recorder running?": b"",
    "it does not begin like one": b"\0" * 99,
    "it is FLAC; let its name end in .flac": b"fLaC" + bytes(99),
    "it is AIFF": b"FORM" + bytes(99),
    "it ends before its data begin; was the recorder stopped at once?": file(GOOD)[:40],
    "its data come before their format": file(GOOD).replace(b"fmt ", b"tmf "),
    "its format is number 0x11 (ADPCM); it must be PCM or float, uncompressed": file(GOOD, kind=17),
    "its format is number 0x6 (A-law); it must be": file(bytes(600), width=1, kind=6),
    "its format is number 0x55 (MP3); it must be": file(bytes(600), width=1, kind=0x55),
    "it is MP3": b"ID3\2" + bytes(99),
    "it is MP3 ": b"\xff\xfb\x90d" + bytes(99),
    "it is MP4": bytes(4) + b"ftypM4A " + bytes(99),
    "it is AVI": file(GOOD).replace(b"WAVE", b"AVI "),
    "it is packed by gzip": gzip.compress(file(GOOD)),
    "it is a pointer of Git LFS; git lfs pull": b"version https://git-lfs.github.com/spec/v1\n",
    "it is a web page": b"<!DOCTYPE html><title>404</title>",
    "its format is number 0xfffe; it must be": file(GOOD, kind=wav.EXTENSIBLE),
    "it has 3 channels of 24 bits in frames of 6 bytes": file(GOOD, bits=24),
    "it has 3 channels of 0 bits in frames of 9 bytes": file(GOOD, width=3, bits=0),
    "it has 3 channels of 40 bits in frames of 15 bytes": file(GOOD, width=5),
    "its 1799 bytes of data are no whole frames of 9 bytes": file(GOOD[:-1], width=3),
    "its format has 14 bytes instead of 16": b"RIFF\0\0\0\0WAVE" + chunk(b"fmt ", bytes(14)),
    "it is cut off, 1791 of 1800 bytes of data are there; was the disk": file(GOOD, width=3)[:-9],
}


@pytest.mark.parametrize("said", REFUSED)
def test_what_cannot_be_read_is_said_in_one_line(said):
    with pytest.raises(ValueError) as refused:
        wav.read(REFUSED[said])
    assert str(refused.value).startswith(said.strip()) and str(refused.value).isprintable()


@given(
    st.sampled_from([*PLACES.values()]),
    st.lists(st.tuples(st.integers(0, 80), st.integers(0, 255)), max_size=5),
    st.integers(0, 1900),
)
@settings(max_examples=300)
def test_any_header_is_read_or_refused(content, changes, cut):
    """Wherever the file ends, whatever its first bytes are: no other error, no more samples."""
    torn = bytearray(content)
    for place, value in changes:
        torn[place] = value
    try:
        samples = wav.read(bytes(torn[: len(torn) - cut]))[1]
    except ValueError as refused:
        assert str(refused).isprintable() and len(str(refused)) < 200
    else:
        assert samples.ndim == 2 and samples.size <= len(content)


SOUND = np.random.default_rng(2).normal(0.0, 0.1, (4000, 3))


@pytest.mark.parametrize(
    ("data", "width", "said"),
    [
        ((SOUND * 2**15).astype(">i2").tobytes(), 2, "stand in the other order, or are moved by"),
        ((SOUND * 2**31).astype(">i4").tobytes(), 4, "stand in the other order, or are moved by"),
        (b"\0" + (SOUND * 2**15).astype("<i2").tobytes()[:-1], 2, "order, or are moved by one"),
        ((SOUND * 2**15 + 2**15).astype("<u2").tobytes(), 2, "its numbers have no sign"),
        (SOUND.astype("<f4").tobytes(), 4, "floating-point ones, though its header says PCM"),
    ],
)
def test_numbers_that_are_not_what_the_header_says_are_refused(data, width, said):
    with pytest.raises(ValueError, match=said):
        wav.read(file(data, width=width))


@pytest.mark.parametrize("crest", [0.1, 0.3, 10.0])
@pytest.mark.parametrize("width", [2, 4])
def test_loud_sound_is_what_its_header_says(width, crest):
    """Also a tone at full scale, and sound that is clipped nearly everywhere."""
    top = 2 ** (8 * width - 1) - 1
    tone = np.sin(np.arange(12000) / 7.0).reshape(-1, 3)
    for sound in (tone, np.clip(SOUND / crest * 3, -1, 1)):
        _, read = wav.read(file((sound * top).astype(f"<i{width}").tobytes(), width=width))
        assert np.abs(read.T - sound).max() < 1e-4


def test_a_chunk_of_odd_length_may_lack_its_zero():
    whole = WHOLE[:20] >> 8
    odd = b"LIST" + struct.pack("<I", 5) + b"title"
    for before in (odd, odd + b"\0"):
        assert (whole_of(file(words(whole, 2), before=before), 16) == whole).all()
