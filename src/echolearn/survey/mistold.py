"""Words of PCM that are not what their header says: the numbers themselves tell it.

Sound spreads less over the range than numbers without a meaning do: words whose bytes stand in the
other order, or are moved by one, fill it evenly, and those without a sign lie at its ends. Read as
they were written they spread less. Floating-point numbers, read as such, all have magnitudes that
sound has; words of PCM, read so, have not.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

EVEN = 0.42
"""Root mean square, in full scales, from which words fill their range; noise that is not clipped
stays below 0.3."""

CLIPPED = 0.02
"""Share of words at the rails from which they are clipped."""

LESS = 0.5
"""Spread of words as they were written over that of those that were read."""

SMALLEST, LARGEST = 1e-12, 1e4
"""Magnitudes of samples, 0 besides, that are floating-point numbers."""


def mistold(words: NDArray[Any]) -> str:
    """Return what words of PCM (N,) are instead; "" if they are what their header says."""
    width = words.dtype.itemsize
    if width not in (2, 4) or not len(words):
        return ""
    full = float(1 << (8 * width - 1))
    if float(np.sqrt(np.mean(np.square(words / full)))) < EVEN:
        return ""
    # Clipped sound is loud, too; numbers without a meaning are seldom at the rails.
    if np.mean((words == words.max()) | (words == words.min())) > CLIPPED:
        return ""
    if width == 4 and _are_floats(words.view(np.float32)):
        return "its numbers are floating-point ones, though its header says PCM"
    spread = LESS * float(np.std(words / full))
    if np.std(words.byteswap() / full) < spread:
        return "the bytes of its numbers stand in the other order, or are moved by one"
    unsigned = np.bitwise_xor(words, words.dtype.type(-(1 << (8 * width - 1))))
    if np.std(unsigned / full) < spread:
        return "its numbers have no sign, which those of WAV have beyond 8 bits"
    return ""


def _are_floats(values: NDArray[np.float32]) -> bool:
    """Tell whether floating-point numbers are all those of sound."""
    with np.errstate(invalid="ignore"):
        size = np.abs(values)
        likely = (size == 0) | ((size > SMALLEST) & (size < LARGEST))
    return bool(likely.all())
