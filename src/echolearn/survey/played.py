"""The burst as the loudspeaker plays it: `played=calibration`, or `played=walk`.

A loudspeaker of response h plays s * h. The matched filter of that is the matched filter r of s,

    sum_n y(n + tau) (s * h)(n) = sum_k h(k) r(tau + k),

so recordings are filtered by the reversed response, y'(n) = sum_k h(k) y(n + k), and what comes
after them, probe, localizer, columns, bundle, stays what it is. In white noise this is the filter
of the largest signal-to-noise ratio (Turin 1960), and the time of an echo is where it was: the
filter undoes the phase of h. Noise that is known (`noise.wav`) is left as it was recorded, since
whitened recordings want the matched filter over the density of their own noise.

The response is that of the direct sound (`early.early_responses`), each microphone's moved back by
the way to it, in phase, times its distance; averaged over microphones and, of a walk, recordings,
what is not common to them, echoes, noise, the robot's body, fades. It ends before the first echo
can come.
"""

import numpy as np
from scipy import fft

from echolearn.acoustics.types import Array

AHEAD = 12
AFTER = 48
"""Samples of the response before and after the way from loudspeaker to microphone."""

FADE = 16
"""Samples at the end of a response over which it fades."""

LOOKED_AT = 64
"""Recordings of a walk, at most, that are averaged."""

WAYS = ("calibration", "walk")
"""Where the response is taken from."""


def as_played(samples: Array, response: Array) -> Array:
    """Return recordings (..., N) filtered by a reversed response, silence beyond their ends.

    Args:
        samples: shape (..., N).
        response: of the loudspeaker (`early.loudspeaker_response`).
    """
    length = samples.shape[-1]
    size = fft.next_fast_len(length + len(response), real=True)
    spectrum = fft.rfft(samples, size) * fft.rfft(response, size).conj()
    filtered: Array = np.roll(fft.irfft(spectrum, size), AHEAD, axis=-1)[..., :length]
    return filtered


def played_line(way: str, response: Array, *, recordings: int) -> str:
    """Return the line on what echoes are sought by.

    Args:
        way: one of `WAYS`.
        response: of the loudspeaker.
        recordings: number of those it was taken from.
    """
    crest = 100 * float(np.max(response**2))
    source = "calibration.wav" if way == "calibration" else f"{recordings} recordings"
    return (
        f"played={way}: echoes are sought by the burst as the loudspeaker plays it, of {source}; "
        f"the crest of its response holds {crest:.0f} % of the energy"
    )
