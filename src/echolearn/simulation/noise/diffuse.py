"""Diffuse noise from one channel: M stretches of it, mixed until microphones agree as they should.

    x(f) = A(f) s(f),     A(f) A(f)^T = J(f),     J_pq(f) = J0(2 pi f d_pq / c)

s are M stretches of one recording, as good as independent of each other; J is the coherence of a
cylindrically isotropic field, sound from all sides in the plane, between microphones d_pq apart
(Habets, Cohen and Gannot, "Generating nonstationary multisensor signals under a spatial coherence
constraint", JASA 124(5), 2008). They factor J by Cholesky or eigenvalues, bin by bin; any
A = J^(1/2) U with orthogonal U will do. Here U = 1: the principal root V sqrt(D) V^T is smooth over
frequency whatever the order of the eigenvalues, treats all microphones alike, and is real, hence a
short filter of phase zero. It acts in frames by overlap-add, so it is one linear filter that leaves
no trace of the frames.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from scipy import fft
from scipy.special import j0

from echolearn.acoustics.types import SPEED_OF_SOUND, Array, MicArray
from echolearn.checks import check_speed, check_whole


class Source(Protocol):
    """One channel of noise."""

    def __call__(self, *, length: int, sample_rate: float, rng: np.random.Generator) -> Array:
        """Return successive samples, shape (length,), of any level."""


@dataclass(frozen=True)
class Diffuse:
    """A cylindrically diffuse field of some noise (the paper's f1).

    Attributes:
        source: the noise at a single point.
        speed_of_sound: in m/s.
        frame: samples filtered together; the filter reaches half as far to either side.
    """

    source: Source
    speed_of_sound: float = SPEED_OF_SOUND
    frame: int = 1024

    def __post_init__(self) -> None:
        check_speed("diffuse.speed_of_sound", self.speed_of_sound)
        check_whole("diffuse.frame", self.frame, low=64, high=65536, unit="samples")

    def __call__(
        self, array: MicArray, *, length: int, sample_rate: float, rng: np.random.Generator
    ) -> Array:
        """Return noise of unit power, mean over time and microphones, shape (M, length)."""
        drawn = self.source(
            length=len(array) * (length + self.frame), sample_rate=sample_rate, rng=rng
        )
        root = _mixing(
            array,
            bins=self.frame + 1,
            sample_rate=sample_rate,
            speed_of_sound=self.speed_of_sound,
        )
        # What the filter makes of the silence before the first frame is left out.
        field = mix(drawn.reshape(len(array), -1), root)[:, self.frame // 2 :][:, :length]
        return field / np.sqrt(np.mean(np.square(field)))


def coherence(places: Array, frequencies: Array, *, speed_of_sound: float) -> Array:
    """Return the coherence J0(2 pi f d_pq / c), shape (F, M, M).

    Args:
        places: microphones, shape (M, 3), in m.
        frequencies: in Hz, shape (F,).
        speed_of_sound: in m/s.
    """
    distance = np.linalg.norm(places[:, None] - places, axis=-1)
    return j0(2 * np.pi * frequencies[:, None, None] * distance / speed_of_sound)


@lru_cache(maxsize=16)
def _mixing(array: MicArray, *, bins: int, sample_rate: float, speed_of_sound: float) -> Array:
    """Return principal square roots of the coherence from 0 to the Nyquist frequency, (F, M, M)."""
    frequencies = np.linspace(0.0, sample_rate / 2, bins)
    matrices = coherence(array.positions, frequencies, speed_of_sound=speed_of_sound)
    values, vectors = np.linalg.eigh(matrices)
    root = (vectors * np.sqrt(np.maximum(values, 0.0))[:, None]) @ vectors.mT
    # Every caller gets this array itself.
    root.setflags(write=False)
    return root


def mix(segments: Array, root: Array) -> Array:
    """Filter M signals (M, N) into M others by matrices (F, M, M) of F = frame + 1 bins."""
    frame = len(root) - 1
    microphones, length = segments.shape
    frames = -(-length // frame)
    whole = np.pad(segments, [(0, 0), (0, frames * frame - length)])

    # Half a frame of silence on either side is room for the filter's two ends.
    blocks = np.zeros((microphones, frames, 2 * frame))
    blocks[..., frame // 2 : frame // 2 + frame] = whole.reshape(microphones, frames, frame)
    spectra = np.moveaxis(fft.rfft(blocks), -1, 0)
    mixed = fft.irfft(np.moveaxis(root @ spectra, 0, -1), 2 * frame)

    # Overlap-add: the second half of a block lies on the first half of the next one.
    total = np.zeros((microphones, frames + 1, frame))
    total[:, :-1] += mixed[..., :frame]
    total[:, 1:] += mixed[..., frame:]
    return total.reshape(microphones, -1)[:, frame // 2 :][:, :length]
