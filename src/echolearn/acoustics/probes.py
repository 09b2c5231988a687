"""Bursts of known shape: a maximum length sequence, sweeps of linear and exponential frequency.

A maximum length sequence of a shift register of B bits is 2^B - 1 signs whose cyclic copies are
orthogonal but for -1 (Golomb 1967; for rooms Schroeder, JASA 66, 1979): of all bursts of one
amplitude it has the most energy. A sweep x(t) = sin(phi(t)) passes from frequency f1 to f2 in T,

    linear:       phi = 2 pi (f1 t + (f2 - f1) t^2 / 2 T)
    exponential:  phi = 2 pi f1 T / ln(f2 / f1) (exp(t / T ln(f2 / f1)) - 1),

the latter with 3 dB less power per octave, and distortion before all linear responses (Farina, AES
108, 2000). Short ramps of raised cosine keep its ends from clicking. The burst of white noise is
`signals.noise_probe`. All are silent after their burst, up to N, and exact in a float32 WAV.
"""

import numpy as np

from echolearn.acoustics.types import Array, Probe
from echolearn.checks import check_choice, check_number, check_whole

LAWS = {"linear": "linear", "exponential": "logarithmic"}
"""How frequency grows, and what scipy calls it."""


def mls_probe(*, bits: int = 11, length: int = 20000, sample_rate: float = 22050.0) -> Probe:
    """Return a maximum length sequence of 2^bits - 1 samples, each 1 or -1, zero-padded.

    Args:
        bits: B of the shift register.
        length: N, samples recorded.
        sample_rate: in Hz.

    Raises:
        BadValue: sizes that are not whole, or a sequence longer than the recording.
    """
    # They take a third of a second to import, which who emits noise need not wait for.
    from scipy.signal import max_len_seq

    check_whole("probe.bits", bits, low=5, high=18)
    return _probe(2.0 * max_len_seq(bits)[0] - 1.0, length=length, sample_rate=sample_rate)


def sweep_probe(
    *,
    law: str = "linear",
    low: float = 200.0,
    high: float = 10000.0,
    seconds: float = 0.068,
    ramp: float = 0.002,
    length: int = 20000,
    sample_rate: float = 22050.0,
) -> Probe:
    """Return a sweep of amplitude 1, zero-padded.

    Args:
        law: how the frequency grows, linear or exponential.
        low, high: frequencies f1 and f2 in Hz.
        seconds: T.
        ramp: length of the raised cosine at either end, in s.
        length: N, samples recorded.
        sample_rate: in Hz.

    Raises:
        BadValue: frequencies that do not grow up to half the sample rate, or a sweep longer than
            the recording.
    """
    from scipy.signal import chirp
    from scipy.signal.windows import tukey

    check_choice("probe.law", law, *LAWS)
    check_number("probe.sample_rate", sample_rate, low=1000.0, high=400_000.0, unit="Hz")
    check_number("probe.high", high, low=10.0, high=sample_rate / 2, unit="Hz")
    check_number("probe.low", low, low=1.0, high=high / 1.1, unit="Hz", hint="low is below high")
    check_number("probe.seconds", seconds, low=0.001, high=60.0, unit="s")
    check_number("probe.ramp", ramp, low=0.0, high=seconds / 2, unit="s")
    count = round(seconds * sample_rate)
    time = np.arange(count) / sample_rate
    # A sine begins at 0, a cosine with a click.
    wave = chirp(time, low, seconds, high, method=LAWS[law], phi=-90.0)
    return _probe(wave * tukey(count, 2 * ramp / seconds), length=length, sample_rate=sample_rate)


def _probe(burst: Array, *, length: int, sample_rate: float) -> Probe:
    """Return a burst as what is emitted, rounded before anything else sees it."""
    # Nobody who reads a file can tell a last sample of 0 from the silence that follows.
    return Probe(np.trim_zeros(burst, "b").astype(np.float32), sample_rate, length)
