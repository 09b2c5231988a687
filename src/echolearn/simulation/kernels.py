"""Short filters of walls, microphones and loudspeakers, drawn at random.

- A **rough wall** spreads an echo: a pulse of energy 1 - s, then noise of energy s that decays
  within the spread, s the scattering coefficient (ISO 17497-1: the share of the reflected energy
  that is not reflected like by a mirror). The energy is 1 whatever is drawn.
- **Two bands**: sound above `CROSSOVER` keeps a share of its amplitude, G(f) + share (1 - G(f)),
  G(f) = 2^-(f / CROSSOVER)^2. It has phase zero, so it moves no arrival.
- A **response** has a magnitude and the least delay that goes with it: its phase is the Hilbert
  transform of its log magnitude, which the folded cepstrum gives (Oppenheim and Schafer,
  Discrete-Time Signal Processing, section 13.5).
"""

from functools import lru_cache

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array

CROSSOVER = 3000.0
"""Hz, where high frequencies begin: half way down."""

LOWEST = 10.0
"""Hz, below which a response does not wander."""

OCTAVES = 12
"""Octaves above `LOWEST` in which it does."""

FLOOR_DB = -60.0
"""Least level of a response, so that its logarithm is finite."""


def clusters(count: int, *, spread: float, scattering: float, rng: np.random.Generator) -> Array:
    """Draw what rough walls make of a pulse, each of energy 1, shape (count, spread + 1).

    Args:
        count: number of walls.
        spread: in samples.
        scattering: share of the energy that is spread.
        rng: draws them.
    """
    taps = round(spread)
    # It has fallen by 26 dB where the spread ends.
    decay = np.exp(-3.0 * np.arange(1, taps + 1) / max(taps, 1))
    tail = decay * rng.standard_normal((count, taps))
    energy = np.sum(tail**2, axis=1, keepdims=True)
    # Where there is no tail, all energy arrives at once.
    share = scattering if taps else 0.0
    scaled = tail * np.sqrt(share / np.maximum(energy, 1e-30))
    return np.hstack([np.full((count, 1), np.sqrt(1.0 - share)), scaled])


def low_band(frequencies: Array) -> Array:
    """Return G(f) of the module's header for frequencies in Hz."""
    return np.exp2(-((frequencies / CROSSOVER) ** 2))


@lru_cache
def low_pass(sample_rate: float) -> Array:
    """Return the taps of G, odd in number and symmetric, of sum 1."""
    # The transform of a Gaussian is one; cut where it is below 1e-4 of its middle.
    sharpness = (np.pi * CROSSOVER / sample_rate) ** 2 / np.log(2.0)
    half = int(np.ceil(np.sqrt(4.0 * np.log(10.0) / sharpness)))
    taps = np.exp(-sharpness * np.arange(-half, half + 1) ** 2)
    return taps / taps.sum()


def ripple(
    frequencies: Array, deviation_db: float, *, count: int, rng: np.random.Generator
) -> Array:
    """Draw levels that wander over frequency, independent from half octave to half octave.

    Args:
        frequencies: shape (F,), in Hz.
        deviation_db: standard deviation, in dB.
        count: number of responses.
        rng: draws them.

    Returns:
        Levels in dB, shape (count, F).
    """
    knots = rng.standard_normal((count, 2 * OCTAVES))
    return deviation_db * (knots @ _between(frequencies.tobytes()))


@lru_cache
def _between(frequencies: bytes) -> Array:
    """Return the weights that read levels at frequencies from those at knots, (2 OCTAVES, F)."""
    hertz = np.frombuffer(frequencies)
    place = 2.0 * np.log2(np.maximum(hertz, LOWEST) / LOWEST)
    each = np.eye(2 * OCTAVES)
    return np.stack([np.interp(place, np.arange(2 * OCTAVES), knot) for knot in each])


def band_db(frequencies: Array, *, low: float, high: float) -> Array:
    """Return the level of a band-pass of second order at either end, in dB, shape (F,).

    Args:
        frequencies: shape (F,), in Hz.
        low, high: corners in Hz; 0 is none.
    """
    above = np.maximum(frequencies, 1.0)
    level = np.zeros(len(frequencies))
    if low > 0:
        level -= 10.0 * np.log10(1.0 + (low / above) ** 4)
    if high > 0:
        level -= 10.0 * np.log10(1.0 + (above / high) ** 4)
    return level


def minimum_phase(level_db: Array) -> Array:
    """Return the responses of least delay with levels (..., F) in dB, shape (..., F - 1).

    The levels are those at F evenly spaced frequencies from 0 to half the sample rate.
    """
    size = 2 * (level_db.shape[-1] - 1)
    level = np.maximum(level_db, level_db.max(axis=-1, keepdims=True) + FLOOR_DB)
    cepstrum = fft.irfft(level * (np.log(10.0) / 20.0), size)
    # Folding what lies before time 0 onto what lies after it leaves the magnitude as it is.
    cepstrum[..., 1 : size // 2] *= 2.0
    cepstrum[..., size // 2 + 1 :] = 0.0
    return fft.irfft(np.exp(fft.rfft(cepstrum)), size)[..., : size // 2]
