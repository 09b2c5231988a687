"""What is mended in a recording before anything else looks at it.

    y -> y - mean -> y - mains -> sign g_m y -> y(n + latency) -> silence at microphones left out

Each step is done only where a survey's health asks for it, so that sound recordings stay what they
are, bit by bit.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array


@dataclass(frozen=True)
class Mending:
    """What is done to the P recordings of a survey by M microphones.

    Attributes:
        latency: samples that each recording is late, shape (P,); they are taken off its beginning.
        calibration: samples that `calibration.wav` is late.
        gains: factors of the microphones, shape (M,); -1 turns one that is wired the other way, 0
            leaves one out.
        offset: whether each recording's mean is subtracted from a microphone, shape (P, M), bool.
        hum: frequency of the mains in Hz, whose tones are subtracted; 0 if there are none.
    """

    latency: Array
    calibration: float
    gains: Array
    offset: Array
    hum: float = 0.0


def advance(samples: Array, latency: float) -> Array:
    """Return samples (..., N) so many samples earlier, silence at the end.

    Whole samples are moved; what is left is a phase in the frequency domain.
    """
    whole = int(np.floor(latency))
    length = samples.shape[-1]
    moved = np.zeros_like(samples)
    if whole >= 0:
        moved[..., : max(length - whole, 0)] = samples[..., whole:]
    else:
        moved[..., -whole:] = samples[..., :whole]
    rest = latency - whole
    if not rest:
        return moved
    # Twice the length, so that the beginning does not come back at the end.
    size = fft.next_fast_len(2 * length, real=True)
    phase = np.exp(2j * np.pi * rest * fft.rfftfreq(size))
    earlier: Array = fft.irfft(fft.rfft(moved, size) * phase, size)
    return earlier[..., :length]
