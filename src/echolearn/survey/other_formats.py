"""Files that are called WAV and are not: what they are, by how they begin.

A sentence that names the format spares a search: recordings get the name of a WAV file by hand, and
a download that was refused, or a pointer of Git LFS, has the name of what should be there.
"""

from typing import NamedTuple


class Beginning(NamedTuple):
    """How files of a format begin.

    Attributes:
        start: place in the file.
        mark: bytes there.
        name: of the format, and what to do.
    """

    start: int
    mark: bytes
    name: str


PULL = "a pointer of Git LFS; git lfs pull brings the recording"

BEGINNINGS = (
    Beginning(0, b"fLaC", "FLAC; let its name end in .flac"),
    Beginning(0, b"OggS", "Ogg"),
    Beginning(0, b"FORM", "AIFF"),
    Beginning(0, b".snd", "AU"),
    Beginning(0, b"caff", "CAF"),
    Beginning(0, b"riff", "Wave64"),
    Beginning(0, b"ID3", "MP3"),
    # Frames of MP3 without a title before them: MPEG 1, 2 and 2.5, with checksums and without.
    *(Beginning(0, bytes((0xFF, kind)), "MP3") for kind in (0xFB, 0xFA, 0xF3, 0xF2, 0xE3, 0xE2)),
    Beginning(0, b"\xff\xf1", "AAC"),
    Beginning(0, b"\xff\xf9", "AAC"),
    Beginning(4, b"ftyp", "MP4, as of M4A"),
    Beginning(0, b"\x1aE\xdf\xa3", "Matroska or WebM"),
    Beginning(8, b"AVI ", "AVI"),
    Beginning(0, b"PK\x03\x04", "a ZIP archive; unpack it"),
    Beginning(0, b"\x1f\x8b", "packed by gzip; unpack it"),
    Beginning(0, b"\x93NUMPY", "an array of NumPy"),
    Beginning(0, b"version https://git-lfs", PULL),
    Beginning(0, b"<!", "a web page; was a download refused?"),
    Beginning(0, b"<html", "a web page; was a download refused?"),
)

CODECS = {
    0x02: "ADPCM",
    0x06: "A-law",
    0x07: "mu-law",
    0x11: "ADPCM",
    0x31: "GSM",
    0x50: "MPEG",
    0x55: "MP3",
    0xFF: "AAC",
}
"""Numbers of compressed formats that a WAV file may hold."""


def other_format(content: bytes) -> str:
    """Return the format of a file that is no WAV; "" if that is not known."""
    for start, mark, name in BEGINNINGS:
        if content.startswith(mark, start):
            return name
    return ""


def codec(kind: int) -> str:
    """Return the number of a compressed format, and its name where it is known."""
    name = CODECS.get(kind)
    return f"{kind:#x} ({name})" if name else f"{kind:#x}"
