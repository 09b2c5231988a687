"""WAV, read by numpy alone, as recorders leave it.

    RIFF, RIFX, RF64 or BW64  ->  chunks  ->  format, data  ->  float64, shape (M, N)

RIFX is big-endian; RF64 and BW64 have sizes of 64 bits in a chunk of their own, `ds64`. Whoever
writes to a pipe, or is killed, never writes the length: the data then go on to the end of the file.

PCM of B bits in words of W > B bits stands in the upper bits of a word, says the standard; what
ALSA calls S24_LE stands in the lower ones, the rest being zeros or copies of the sign. Headers
often do not tell, so the numbers do: where the lowest W - B bits are in use, those above are not.
What takes the numbers of a whole survey to tell is left to `containers`, by `undecided`.

References: Multimedia Programming Interface and Data Specifications 1.0 (IBM, Microsoft 1991);
Multiple Channel Audio Data and WAVE Files (Microsoft 2001); EBU Tech 3306 (RF64).
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from echolearn.acoustics.types import Array
from echolearn.survey.mistold import mistold
from echolearn.survey.other_formats import codec, other_format

KINDS = {b"RIFF": "<", b"RF64": "<", b"BW64": "<", b"RIFX": ">"}
"""Beginnings of files, each with its byte order."""

PCM = 1
FLOAT = 3
EXTENSIBLE = 0xFFFE

ENDLESS = 64 << 20
"""Bytes of data from which a length is a placeholder: sox writes 0x7FFFF000 into a pipe, arecord
0x80000000, ffmpeg 0xFFFFFFFF; no file that is read is so long."""

NARROW = (16, 20, 24)
"""Bits that converters have, which may stand in words of 32."""


class Format(NamedTuple):
    """What a chunk `fmt ` says.

    Attributes:
        kind: `PCM` or `FLOAT`.
        channels: number M.
        rate: in Hz.
        width: bytes of a sample.
        bits: bits of it that are in use.
        order: byte order, < or >.
    """

    kind: int
    channels: int
    rate: int
    width: int
    bits: int
    order: str


def read(content: bytes, *, start: int = 0, stop: int | None = None) -> tuple[int, Array]:
    """Return sample rate and samples of a WAV file, shape (M, N), PCM scaled to -1 ... 1.

    Args:
        content: of the file.
        start, stop: the first sample that is wanted, and the one after the last; to the end if
            None.

    Raises:
        ValueError: no WAV, or one that is damaged; says in one line what is wrong.
    """
    told, data = _chunks(content)
    width = told.width
    frame = width * told.channels
    data = data[start * frame : None if stop is None else stop * frame]
    if told.kind == FLOAT:
        # What is not finite is refused by whoever reads.
        with np.errstate(invalid="ignore"):
            samples = np.frombuffer(data, f"{told.order}f{width}").astype(float)
    else:
        whole = _whole(data, width, order=told.order)
        if reason := mistold(whole):
            raise ValueError(reason)
        samples = _scaled(whole.reshape(-1, told.channels), told.bits, word=8 * width).ravel()
    return told.rate, np.ascontiguousarray(samples.reshape(-1, told.channels).T)


def undecided(content: bytes) -> NDArray[Any] | None:
    """Return the words of a file that do not tell how many of their bits are in use; else None.

    Those of PCM that a header calls plain 32 bits, and floats that are whole numbers; a silent file
    tells nothing. `ValueError` as of `read`.
    """
    told, data = _chunks(content)
    if told.kind == FLOAT:
        floats = np.frombuffer(data, f"{told.order}f{told.width}")
        with np.errstate(invalid="ignore"):
            return floats if len(floats) and (np.rint(floats) == floats).all() else None
    if told.width != 4 or told.bits != 32:
        return None
    whole = _whole(data, 4, order=told.order).reshape(-1, told.channels)
    # What stands in the upper bits leaves the lowest empty.
    return whole if (whole & 0xFF).any() and not _zero_padded(whole) else None


def length(content: bytes) -> int:
    """Return the number of samples of each channel of a WAV file; ValueError as of `read`."""
    told, data = _chunks(content)
    return len(data) // (told.width * told.channels)


def _chunks(content: bytes) -> tuple[Format, bytes]:
    """Return the format of a file and its data, whole frames of it."""
    order = KINDS.get(content[:4])
    if order is None or content[8:12] != b"WAVE":
        known = other_format(content)
        raw = "it does not begin like one; is it raw, without a header?"
        reason = f"it is {known}" if known else raw
        raise ValueError(reason if content else "it is empty; was the recorder running?")

    told = None
    long = 0
    place = 12
    while place + 8 <= len(content):
        name = content[place : place + 4]
        size = _number(content[place + 4 : place + 8], order)
        place += 8
        if name == b"data":
            if told is None:
                raise ValueError("its data come before their format")
            return told, _data(content, place, size=long if size == 0xFFFFFFFF else size, told=told)
        body = content[place : place + size]
        if name == b"ds64":
            long = _number(body[8:16], order)
        elif name == b"fmt ":
            told = _format(body, order)
        place += size + _padding(content, place + size, size=size, order=order)
    raise ValueError("it ends before its data begin; was the recorder stopped at once?")


def _padding(content: bytes, place: int, *, size: int, order: str) -> int:
    """Return how many bytes, 0 or 1, fill up a chunk of an odd number of them.

    Args:
        content: of the whole file.
        place: where the chunk ends.
        size: bytes that it has.
        order: byte order, < or >.
    """
    # Some forget the byte, and some write another than zero.
    if size % 2 == 0 or content[place : place + 1] == b"\0":
        return size % 2
    following = _follows(content, place, order=order)
    return int(not following and _follows(content, place + 1, order=order))


def _follows(content: bytes, place: int, *, order: str) -> bool:
    """Tell whether a chunk begins at a place: a name in letters, and a length that fits."""
    name = content[place : place + 4]
    size = _number(content[place + 4 : place + 8], order)
    fits = size <= len(content) - place - 8 or name == b"data"
    return len(name) == 4 and name.isascii() and name.decode().isprintable() and fits


def _number(field: bytes, order: str) -> int:
    return int.from_bytes(field, "little" if order == "<" else "big")


def _format(body: bytes, order: str) -> Format:
    """Return what a chunk `fmt ` says."""
    if len(body) < 16:
        raise ValueError(f"its format has {len(body)} bytes instead of 16")
    kind, channels = (_number(body[at : at + 2], order) for at in (0, 2))
    rate = _number(body[4:8], order)
    frame, bits = (_number(body[at : at + 2], order) for at in (12, 14))
    if kind == EXTENSIBLE and len(body) >= 40:
        # Some leave the number of valid bits empty.
        bits = _number(body[18:20], order) or bits
        kind = _number(body[24:28], order)

    width = frame // max(channels, 1)
    known = {PCM: (1, 2, 3, 4, 8), FLOAT: (4, 8)}
    if kind not in known:
        raise ValueError(
            f"its format is number {codec(kind)}; it must be PCM or float, uncompressed"
        )
    sound = frame == channels * width and width in known[kind] and 0 < bits <= 8 * width
    if not sound:
        raise ValueError(f"it has {channels} channels of {bits} bits in frames of {frame} bytes")
    return Format(kind, channels, rate, width, bits, order)


def _data(content: bytes, start: int, *, size: int, told: Format) -> bytes:
    """Return the data from a place on, of that size if it was ever written.

    Args:
        content: of the whole file.
        start: where the data begin.
        size: their length in bytes, as the header has it.
        told: format, of whose frames they consist.
    """
    rest = len(content) - start
    frame = told.channels * told.width
    # A header that was never finished does not know the length of the file either; where it does,
    # what follows no samples is another chunk.
    complete = _number(content[4:8], told.order) == len(content) - 8
    following = rest == 0 or _follows(content, start, order=told.order)
    if size >= ENDLESS or (size == 0 and not (complete and following)):
        rest -= _trailing(content, told.order)
        return content[start : start + rest // frame * frame]
    if size > rest:
        there = f"{rest} of {size} bytes of data are there"
        raise ValueError(f"it is cut off, {there}; was the disk full, or the recorder killed?")
    if size % frame:
        torn = "was the recorder killed, or has it other channels than it says?"
        raise ValueError(f"its {size} bytes of data are no whole frames of {frame} bytes; {torn}")
    return content[start : start + size]


def _trailing(content: bytes, order: str) -> int:
    """Return the bytes of a chunk of texts behind data of unknown length; 0 if there is none."""
    for name in (b"LIST", b"id3 "):
        place = content.rfind(name)
        if place >= 0 and place + 8 + _number(content[place + 4 : place + 8], order) == len(
            content
        ):
            return len(content) - place
    return 0


def _whole(data: bytes, width: int, *, order: str) -> NDArray[Any]:
    """Return the words of PCM as signed whole numbers."""
    if width == 1:
        # Only bytes are unsigned, around 128.
        return np.frombuffer(data, np.uint8).astype(np.int16) - 128
    if width != 3:
        return np.frombuffer(data, f"{order}i{width}").astype(f"i{width}")
    packed = np.frombuffer(data, np.uint8).reshape(-1, 3)
    padded = np.zeros((len(packed), 4), np.uint8)
    padded[:, 1:] = packed if order == "<" else packed[:, ::-1]
    # Shifted back as signed numbers, which keeps their sign.
    return padded.view("<i4")[:, 0] >> 8


def _scaled(whole: NDArray[Any], bits: int, *, word: int) -> Array:
    """Return PCM scaled to -1 ... 1.

    Args:
        whole: words as signed whole numbers, shape (N, M).
        bits: bits of a word that the header calls valid.
        word: bits of a word.
    """
    narrow = _zero_padded(whole) if bits == word == 32 else 0
    if bits < word and (whole & ((1 << (word - bits)) - 1)).any():
        # Those above may be in use as well: then the header is wrong about them all.
        fits = -(1 << (bits - 1)) <= int(whole.min()) and int(whole.max()) < 1 << bits
        narrow = bits if fits else 0
    if narrow:
        whole = _extended(whole, narrow)
    scaled: Array = whole / 2.0 ** ((narrow or word) - 1)
    return scaled


def _extended(whole: NDArray[Any], bits: int) -> NDArray[Any]:
    """Return the lowest bits of words as signed numbers of so many bits."""
    half = 1 << (bits - 1)
    lower: NDArray[Any] = ((whole & (2 * half - 1)) ^ half) - half
    return lower


def _zero_padded(whole: NDArray[Any]) -> int:
    """Return in how many bits words of 32 hold numbers whose sign was cut off; 0 if they do not.

    The numbers below zero then stand at the upper end of the range, far from those above: without
    the sign they spread more. Those of a channel with an offset spread less.
    """
    if not whole.size or whole.min() < 0:
        return 0
    bits = int(whole.max()).bit_length()
    if bits not in NARROW:
        return 0
    spread = np.std(whole, axis=0).sum()
    return bits if np.std(_extended(whole, bits), axis=0).sum() < spread else 0
