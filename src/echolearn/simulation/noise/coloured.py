"""Coloured sensor noise: part of it is white, the rest falls by 6 dB an octave above a corner.

    x = sqrt(1 - s) w(n) + sqrt(s) v(n),     v(n) = a v(n - 1) + sqrt(1 - a^2) w'(n),
    a = exp(-2 pi corner / fs)

Both are Gaussian and independent, so one recursion from one white draw has the same distribution:
by spectral factorisation x(n) = a x(n - 1) + g (w(n) - b w(n - 1)), where the numerator's density
g^2 |1 - b z^-1|^2 is (1 - s) |1 - a z^-1|^2 + s (1 - a^2). So it costs one draw, as white noise
does, and is the same for the same generator but for its colour.
"""

import math
from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.types import Array, MicArray
from echolearn.checks import check_fields


@dataclass(frozen=True)
class Coloured:
    """Noise of each microphone for itself, part white, part falling.

    Attributes:
        share: s, part of the power that falls.
        corner: in Hz.
    """

    share: float = 0.5
    corner: float = 200.0

    def __post_init__(self) -> None:
        ranges = {"share": (0.0, 1.0, ""), "corner": (0.0, 100_000.0, "Hz")}
        check_fields("noise", self, ranges=ranges)

    def __call__(
        self, array: MicArray, *, length: int, sample_rate: float, rng: np.random.Generator
    ) -> Array:
        """Return noise of unit variance, shape (M, length)."""
        from echolearn.simulation.normal_loops import coloured, standard_normal

        white = standard_normal(rng, (len(array), length))
        a, b, gain = self.recursion(sample_rate)
        # What came before the first sample is drawn as well: the variance is 1 from the start.
        start = rng.standard_normal((len(array), 1))
        before = start * math.sqrt(max(0.0, 1.0 - gain**2))
        return coloured(white, before, falls=a, taps=(gain, -gain * b))

    def recursion(self, sample_rate: float) -> tuple[float, float, float]:
        """Return a, b and g of the module's header."""
        a = math.exp(-2.0 * math.pi * self.corner / sample_rate)
        power = (1.0 - self.share) * (1.0 + a**2) + self.share * (1.0 - a**2)
        product = a * (1.0 - self.share)
        # The root that keeps b at 1 or less: the recursion can be inverted.
        twice = power + math.sqrt(max(0.0, power**2 - 4.0 * product**2))
        return a, 2.0 * product / twice, math.sqrt(twice / 2.0)
