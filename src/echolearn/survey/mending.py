"""What is mended in a recording before anything else looks at it.

    y -> y - offset - tones of the mains -> sign_m y -> y(n + latency)

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
        sign: -1 where a microphone is wired the other way, else 1, shape (P, M).
        offset: whether a recording has an offset at a microphone, shape (P, M), bool.
        tones: frequencies of the mains in each recording, in cycles per sample; () if none.
        calibration_offset: whether `calibration.wav` has an offset, shape (M,), bool.
        calibration_tones: frequencies of the mains in it.
    """

    latency: Array
    calibration: float
    sign: Array
    offset: Array
    tones: tuple[tuple[float, ...], ...]
    calibration_offset: Array
    calibration_tones: tuple[float, ...] = ()

    @property
    def nothing(self) -> bool:
        """Whether there is nothing to mend."""
        moved = self.latency.any() or self.calibration
        steady = self.offset.any() or any(self.tones)
        beside = self.calibration_offset.any() or self.calibration_tones
        return not (moved or steady or beside or (self.sign < 0).any())

    def __call__(self, samples: Array, pose: int) -> Array:
        """Return the recording of a pose, samples (M, N), as it should have been."""
        samples = steadied(samples, self.offset[pose], tones=self.tones[pose])
        return taken_off(self.sign[pose][:, None] * samples, float(self.latency[pose]))


def steadied(samples: Array, offset: Array, *, tones: tuple[float, ...]) -> Array:
    """Return a recording without what does not belong to its sound.

    Args:
        samples: shape (M, N).
        offset: microphones whose mean is subtracted, shape (M,), bool.
        tones: frequencies that are fitted and subtracted, in cycles per sample.
    """
    if not tones:
        return samples - np.where(offset, samples.mean(axis=-1), 0.0)[:, None]
    time = 2 * np.pi * np.arange(samples.shape[-1])
    waves = [wave(frequency * time) for frequency in tones for wave in (np.cos, np.sin)]
    # Fitted together with the mean, which a broken period of a tone would shift.
    model = np.stack([np.ones_like(time), *waves], axis=-1)
    parts = np.linalg.lstsq(model, samples.T, rcond=None)[0]
    parts[0] *= offset
    return samples - (model @ parts).T


def taken_off(samples: Array, latency: float) -> Array:
    """Return samples (..., N) so many samples earlier, silence where nothing was recorded.

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
