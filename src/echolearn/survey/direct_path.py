"""The direct path from the loudspeaker to the microphones, and recordings without it.

    direct_m(n) = g_m a_m(n)

The arrival a_m is the burst delayed by geometry, s(n - |p_m| fs / c), in the frequency domain, so
fractions of a sample count; or what was recorded in a free room, which holds whatever loudspeaker
and microphones do to the burst. The gain is fitted to each recording and microphone by least
squares, g_m = <y_m, a_m> / ||a_m||^2: it holds whatever amplifiers did, and since a burst of noise
is nearly orthogonal to its own later copies, echoes hardly disturb it. Or it is that of the free
field of a loudspeaker of gain 1, 1 / (4 pi |p_m|), as simulations have it.
"""

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array, MicArray, Probe
from echolearn.checks import check

REMOVALS = ("calibration", "fir", "fitted", "analytic")
"""Ways to remove a direct path: as it was recorded; as responses fitted to each recording have it
(`early`); or as geometry delays it, with a gain that is fitted or that of the free field."""


def delayed(probe: Probe, array: MicArray, *, speed_of_sound: float) -> Array:
    """Return the burst as it reaches each microphone directly, gain 1, shape (M, N).

    Args:
        probe: the burst, and N.
        array: the microphones around the loudspeaker.
        speed_of_sound: in m/s.

    Raises:
        BadValue: a microphone that the burst reaches after the end of the recording.
    """
    distance = np.linalg.norm(array.positions, axis=1)
    delay = distance * probe.sample_rate / speed_of_sound
    inside = bool((delay < probe.length).all())
    check(inside, "microphones", f"{distance.max():g} m", allowed="must be within the recording")
    # Twice the length, so that what is delayed past the end does not come back at the beginning.
    size = fft.next_fast_len(2 * probe.length, real=True)
    phase = np.exp(-2j * np.pi * delay[:, None] * fft.rfftfreq(size))
    arrived: Array = fft.irfft(fft.rfft(probe.samples, size) * phase, size)
    return arrived[:, : probe.length]


def free_field(array: MicArray) -> Array:
    """Return the gains of the free field, shape (M,)."""
    gain: Array = 1.0 / (4.0 * np.pi * np.maximum(np.linalg.norm(array.positions, axis=1), 1e-3))
    return gain


def remove(samples: Array, arrived: Array, *, gain: Array | None = None) -> Array:
    """Return recordings without their direct path.

    Args:
        samples: shape (..., M, N).
        arrived: the direct path at each microphone up to its gain, shape (M, N).
        gain: shape (M,); None fits one to each recording and microphone.
    """
    if gain is None:
        # A microphone that is left out may hold nothing at all.
        energy = np.maximum(np.sum(arrived**2, axis=-1), 1e-300)
        gain = np.sum(samples * arrived, axis=-1) / energy
    without: Array = samples - gain[..., None] * arrived
    return without
