"""PNG images by zlib alone, for a robot has no library that draws.

An image is levels, shape (H, W): 0 is the lowest, `LEVELS` - 1 the highest. Its palette goes from
night blue over red to pale yellow, its lightness rising evenly, so that it reads in grey and by
colour-blind readers, too.
"""

import struct
import zlib
from base64 import b64encode

import numpy as np

from echolearn.acoustics.types import Array

LEVELS = 64
"""Colours; more are not seen, and take room in the file."""

STOPS = ((10, 12, 34), (52, 24, 88), (122, 32, 108), (190, 55, 82), (238, 115, 48), (252, 243, 178))
"""Red, green and blue at even steps of the scale."""


def palette() -> Array:
    """Return the colours, shape (LEVELS, 3), uint8."""
    place = np.linspace(0.0, len(STOPS) - 1.0, LEVELS)
    channels = [np.interp(place, range(len(STOPS)), channel) for channel in np.array(STOPS).T]
    return np.stack(channels, axis=-1).round().astype(np.uint8)


def png_bytes(levels: Array, colours: Array | None = None) -> bytes:
    """Return levels (H, W) as a PNG file, in colours (any, 3), uint8; those of `palette` if none.

    Each level is the place of its colour.
    """
    height, width = levels.shape
    # Every line of pixels begins with the number of its filter, 0 for none.
    lines = np.pad(levels.astype(np.uint8), ((0, 0), (1, 0)))
    # 8 bits a pixel, colour type 3: each is a place in the palette.
    header = struct.pack(">2I5B", width, height, 8, 3, 0, 0, 0)
    body = _chunk(b"IHDR", header) + _chunk(
        b"PLTE", (palette() if colours is None else colours).tobytes()
    )
    body += _chunk(b"IDAT", zlib.compress(lines.tobytes(), 9)) + _chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + body


def data_url(levels: Array) -> str:
    """Return levels (H, W) as an address that holds the image itself."""
    return "data:image/png;base64," + b64encode(png_bytes(levels)).decode()


def _chunk(kind: bytes, content: bytes) -> bytes:
    checksum = zlib.crc32(kind + content)
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", checksum)
