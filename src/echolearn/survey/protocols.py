"""How published responses become recordings: as a robot would have made them, or as they are.

`pose`: a robot carries its loudspeaker, these stand 1.5 to 3 m away. So the direct sound is gated
out, and with it the first metre of path after it; the recording begins `start` metres of path
after the emission, 0, 2 and 4 m, so that walls at other distances come into the same search window;
and it is amplified by (3 + start) / 3, as what comes later is weaker by about that. With s the
probe, h the gated response from the emission on, and a the start in s,

    y_m(n) = (3 + start) / 3 (h_m * s)(n + a fs) + w_m(n)

w is white noise at `snr_db` below the *direct* sound as it would be 0.2 m from the loudspeaker, as
loud as a ring of that radius hears its own: mean square over M microphones and N samples of the
direct sound times the probe, times (distance / 0.2 m)^2. Directions are those of the array as it
stood, so they tell of image sources; distances do not, and there is no map. True times are less a.

`none`: the response times the probe, direct sound and all, from the emission on, without noise
unless `snr_db` is given (then the same as above); the loudspeaker's places stand in `poses.csv`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from scipy import fft
from scipy.signal import resample_poly

from echolearn.acoustics import signals
from echolearn.acoustics.types import Array, Probe, Truth
from echolearn.checks import check
from echolearn.survey.measured import Measurements, Response

PROTOCOLS = ("pose", "none")

STARTS = (0.0, 2.0, 4.0)
"""m of path after the emission at which recordings begin."""

GATE = 1.0
"""m of path after the direct sound that go with it."""

REFERENCE = 3.0
"""m; what comes this much later is amplified twice."""

CARRIED = 0.2
"""m from the loudspeaker at which the direct sound is the reference of the SNR."""


@dataclass(frozen=True)
class Take:
    """A recording to be made of a response, which begins `start` m of path after the emission."""

    response: Response
    start: float
    gated: bool

    def truth(self, speed_of_sound: float) -> Truth:
        """Return the true echoes that come after the beginning."""
        full = self.response.truth
        times = full.toa - self.start / speed_of_sound
        later = times > 0
        return Truth(times[later], full.azimuth[later], full.elevation[later])


def takes(measured: Measurements, protocol: str) -> list[Take]:
    """Return the recordings that a protocol makes of measurements.

    Raises:
        BadValue: there is no such protocol, or no response has an echo where one is needed.
    """
    allowed = f"must be {' or '.join(PROTOCOLS)}"
    check(protocol in PROTOCOLS, "protocol", protocol, allowed=allowed)
    if protocol == "none":
        return [Take(response, 0.0, gated=False) for response in measured.responses]
    found = []
    for response in measured.responses:
        for start in STARTS:
            take = Take(response, start, gated=True)
            if _has_echo(take, measured):
                found.append(take)
    return found


def _has_echo(take: Take, measured: Measurements) -> bool:
    """Tell whether a take has a true echo where its source wants one."""
    if measured.within is None:
        return True
    nearest, farthest = measured.within
    path = take.truth(measured.speed_of_sound).toa * measured.speed_of_sound
    return bool(((path >= nearest) & (path <= farthest)).any())


def at_rate(measured: Measurements, samples: Array, *, rate: float) -> Array:
    """Return responses (..., K) at another rate: a polyphase filter without delay.

    Args:
        measured: tells the rate that they have.
        samples: the responses.
        rate: wanted, in Hz.
    """
    ratio = Fraction(rate / measured.sample_rate).limit_denominator(10_000)
    if ratio == 1:
        return samples
    found: Array = resample_poly(samples, *ratio.as_integer_ratio(), axis=-1)
    return found


def recorded_take(
    take: Take,
    measured: Measurements,
    *,
    probe: Probe,
    snr_db: float | None,
    rng: np.random.Generator,
) -> Array:
    """Return the recording of a take, shape (M, N).

    Args:
        take: the response, and when the recording begins.
        measured: tells sample rate and speed of sound.
        probe: burst s, its rate, and N.
        snr_db: level of the direct sound 0.2 m from the loudspeaker over the noise; None for none.
        rng: draws the noise.
    """
    response = take.response
    rate = probe.sample_rate
    speed = measured.speed_of_sound
    samples = at_rate(measured, response.samples, rate=rate)
    # Until then there is nothing but the direct sound.
    gate = (response.emitted + (response.distance + GATE) / speed) * rate
    direct = np.where(np.arange(samples.shape[-1]) < gate, samples, 0.0)

    late = samples - direct if take.gated else samples
    begun = (response.emitted + take.start / speed) * rate
    gain = (REFERENCE + take.start) / REFERENCE
    sound = gain * signals.convolve(probe.samples, moved(late, -begun), length=probe.length)
    if snr_db is None:
        return sound
    heard = signals.convolve(probe.samples, direct, length=probe.length)
    loud = float(np.mean(signals.power(heard))) * (response.distance / CARRIED) ** 2
    noise = math.sqrt(loud * 10.0 ** (-snr_db / 10.0)) * rng.standard_normal(sound.shape)
    found: Array = sound + noise
    return found


def moved(samples: Array, lag: float) -> Array:
    """Return responses (..., K) later by a lag in samples, fractions of one among them.

    What is moved before the first sample is lost; those moved later make the response longer.
    """
    length = samples.shape[-1] + max(math.ceil(lag), 0)
    # Room on both sides, so that nothing comes back at the other end.
    size = fft.next_fast_len(length + samples.shape[-1] + abs(math.floor(lag)), real=True)
    phase = np.exp(-2j * np.pi * lag * fft.rfftfreq(size))
    return fft.irfft(fft.rfft(samples, size) * phase, size)[..., :length]


def described(made: Sequence[Take]) -> dict[str, list[Any]]:
    """Return the further columns of `poses.csv`: place, condition, and start in m."""
    return {
        "place": [take.response.place for take in made],
        "condition": [take.response.condition for take in made],
        "start_m": [take.start for take in made],
    }
