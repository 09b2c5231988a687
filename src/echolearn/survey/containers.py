"""How many bits the numbers of a survey have, where no header tells it.

    x = word / 2^(bits - 1)

A recorder that lays 24 bits, their sign extended, into words of 32 under a header of plain 32 bits
is read 48 dB too quiet; one that stores counts of its converter as floats, 90 to 190 dB too loud.
One file may be quiet, so all recordings of a survey decide together, and what they decide holds of
all: where no word goes beyond B bits, the lowest are in use, and the loudest come near the top. The
scales are powers of two, so nothing is rounded.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

from numpy.typing import NDArray

WORD = 32
"""Bits of the words that are looked at."""

CONVERTERS = (16, 24)
"""Bits that numbers in words of 32 may have, beside all of them; 20 are 24 of a soft sound."""

COUNTS = (16, 24, 32)
"""Bits of counts that are stored as floats."""

NEAR_TOP = 3
"""Bits by which the loudest sample of a survey falls short of the range at most, 18 dB: a sound
that is softer by so much and 48 dB more has hardly been recorded with 32 bits."""

LOUDEST = 1000.0
"""Count from which whole numbers among floats are counts of a converter."""


class Numbers(NamedTuple):
    """How the numbers of some files of a survey are stored.

    Attributes:
        bits: that they have; 0 if they are as their headers say.
        whole: whether those that need a scale are floats.
    """

    bits: int = 0
    floats: bool = False

    @property
    def scale(self) -> float:
        """Factor of samples that were read as the headers say."""
        if not self.bits:
            return 1.0
        return float(2.0 ** ((1 if self.floats else WORD) - self.bits))

    @property
    def line(self) -> str:
        """What there is to say of them."""
        if self.floats:
            return f"counts of {self.bits} bits, stored as floats"
        return f"{self.bits} bits in words of {WORD}, which no header tells"


class Containers(NamedTuple):
    """How the numbers of a survey's files are stored."""

    probe: Numbers = Numbers()
    recordings: Numbers = Numbers()
    noise: Numbers = Numbers()


def container_lines(containers: Containers) -> list[str]:
    """Return a line for the files whose numbers are not as their headers say, together."""
    names = dict(zip(("probe.wav", "all recordings", "noise.wav"), containers, strict=True))
    lines = []
    for numbers in dict.fromkeys(each for each in containers if each.bits):
        files = " and ".join(name for name, each in names.items() if each == numbers)
        lines.append(f"{files}: {numbers.line}; read so")
    return lines


AS_TOLD = Numbers()
"""Numbers that are as their headers say."""


def numbers_of(files: Iterable[NDArray[Any] | None], *, like: Numbers = AS_TOLD) -> Numbers:
    """Return how the numbers of files are stored, all of them alike.

    Args:
        files: words of each that does not tell their bits, None of all others
            (`audio.undecided_words`).
        like: how those of louder files beside them are, which count where these fit in as well.
    """
    peak = 0.0
    floats = None
    for words in files:
        alike = words is not None and floats in (None, words.dtype.kind == "f")
        if words is None or not alike:
            return AS_TOLD
        floats = words.dtype.kind == "f"
        # The lowest number of a range has no counterpart above zero.
        peak = max(peak, float(words.max()), -float(words.min()) - 1.0)
        if not floats and peak >= 1 << (CONVERTERS[-1] - 1):
            return AS_TOLD
    if like.bits and like.floats == floats and peak < 1 << (like.bits - 1):
        return like
    return Numbers(_bits(peak, floats=bool(floats)), bool(floats))


def _bits(peak: float, *, floats: bool) -> int:
    """Return the bits of numbers up to a peak, 0 if they are as their headers say."""
    if floats:
        fits = (bits for bits in COUNTS if LOUDEST <= peak < 1 << (bits - 1))
        return next(fits, 0)
    near = (bits for bits in CONVERTERS if 1 << (bits - 1 - NEAR_TOP) <= peak < 1 << (bits - 1))
    return next(near, 0)
