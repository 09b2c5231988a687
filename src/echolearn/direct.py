"""The direct path from the loudspeaker to the microphones, and recordings without it.

    direct_m(n) = g_m s(n - |p_m| fs / c),      g_m = <y_m, s_m> / ||s_m||^2,   s_m the delayed burst

The delay is known from the array's geometry and is applied in the frequency domain, so fractions of a sample count.
The gain is fitted to each recording and microphone by least squares: it holds whatever amplifiers and microphones did,
and since a burst of noise is nearly orthogonal to its own later copies, echoes hardly disturb it. `analytic` takes
g_m = 1 / (4 pi |p_m|) instead, the free field of a loudspeaker of gain 1, as simulations have it.
"""

import numpy as np
from scipy import fft

from echolearn.types import Array, MicArray, Probe, check


def delayed(probe: Probe, array: MicArray, *, speed_of_sound: float) -> Array:
    """Return the burst as it reaches each microphone directly, gain 1, shape (M, N)."""
    distance = np.linalg.norm(array.positions, axis=1)
    delay = distance * probe.sample_rate / speed_of_sound
    check(bool((delay < probe.length).all()), "microphones", f"{distance.max():g} m", allowed="within the recording")
    size = fft.next_fast_len(2 * probe.length, real=True)
    phase = np.exp(-2j * np.pi * delay[:, None] * fft.rfftfreq(size))
    arrived: Array = fft.irfft(fft.rfft(probe.samples, size) * phase, size)[:, : probe.length]
    return arrived


def remove(samples: Array, probe: Probe, array: MicArray, *, speed_of_sound: float, analytic: bool = False) -> Array:
    """Return recordings without their direct path.

    Args:
        samples: shape (..., M, N).
        probe: what was emitted, at sample 0.
        array: where the microphones are, the loudspeaker at the origin.
        speed_of_sound: in m/s.
        analytic: take the free field's gain rather than the fitted one.
    """
    arrived = delayed(probe, array, speed_of_sound=speed_of_sound)
    if analytic:
        gain = 1.0 / (4.0 * np.pi * np.maximum(np.linalg.norm(array.positions, axis=1), 1e-3))
    else:
        gain = np.sum(samples * arrived, axis=-1) / np.sum(arrived**2, axis=-1)
    without: Array = samples - gain[..., None] * arrived
    return without
