"""Noise of a multirotor at a microphone: lines of the rotors, gusty wash, and hiss.

    x(t) = sqrt(w / Q) sum_q sum_k a_k cos(k phi_q(t) + theta_qk)
           + sqrt(1 - w) (sqrt(1 - h) g(t) b(t) + sqrt(h) c(t)),
    dphi_q / dt = 2 pi rate (1 + u_q(t))

Q rotors turn for themselves: the relative speed u_q wanders as an Ornstein-Uhlenbeck process of
deviation `jitter` and time constant `wander`, so the lines of several rotors beat and the high ones
blur. The power a_k^2 / 2 of the harmonics falls as 1 / k^2; those of the blade-passing rate (every
`blades`-th) stand out by `blade_gain_db`. The wash, air that the rotors blow over the microphones,
is Gaussian noise b of density 1 / (1 + (f / corner)^3), nothing below 20 Hz, where microphones
record little; it comes in gusts: the level of g wanders by `gust_db`, within `gust` seconds, at a
mean power of 1. The hiss c, of density 1 / (1 + (f / hiss_corner)^8), is steady.

The defaults are fitted to a recording from DREGON (four rotors at 70 revolutions/s; Strauss et al.,
"DREGON: dataset and methods for UAV-embedded sound source localization", 2018) as the paper's first
author keeps it with the program of another paper: 90 % of the power below 459 Hz, the strongest
line at 68 Hz, levels that wander by 6 dB from 20 ms to 20 ms below 500 Hz and by 1.4 dB above
4 kHz. The model's third octaves, 50 Hz to 8 kHz, are within 3 dB of it.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft, signal

from echolearn.acoustics.types import Array
from echolearn.checks import check_fields

LOWEST = 20.0
"""Frequency in Hz at which wash and hiss begin."""

STEP = 0.01
"""Seconds between changes of speed."""

TABLE = 8192
"""Points of one revolution; linear interpolation between them errs by less than -80 dB at the 30th
harmonic."""

RANGES = {
    "rate": (1.0, 1000.0, "Hz"),
    "blades": (1, 20, ""),
    "rotors": (1, 32, ""),
    "jitter": (0.0, 0.2, ""),
    "wander": (2 * STEP, 100.0, "s"),
    "harmonics": (1, 1000, ""),
    "blade_gain_db": (-100.0, 100.0, "dB"),
    "tonal": (0.0, 1.0, ""),
    "corner": (LOWEST, 100_000.0, "Hz"),
    "gust_db": (0.0, 20.0, "dB"),
    "gust": (2 * STEP, 100.0, "s"),
    "hiss": (0.0, 1.0, ""),
    "hiss_corner": (LOWEST, 100_000.0, "Hz"),
}
"""Least and largest value of each number, with its unit."""


@dataclass(frozen=True)
class Rotor:
    """A multirotor in hover, as one microphone records it.

    Attributes:
        rate: revolutions per second.
        blades: number of blades of each rotor.
        rotors: number Q of rotors, each with a speed and a phase of its own.
        jitter: standard deviation of a rotor's relative speed.
        wander: time constant of its changes, in s.
        harmonics: number of harmonics of the revolution; those below the Nyquist frequency are
            there.
        blade_gain_db: gain of the harmonics of the blade-passing rate.
        tonal: share w of the power that lies in lines.
        corner: corner frequency of the wash, in Hz.
        gust_db: standard deviation of the wash's level; 0 is steady wash.
        gust: time constant of its changes, in s.
        hiss: share h of the rest that is hiss; the other is wash.
        hiss_corner: corner frequency of the hiss, in Hz.
    """

    rate: float = 70.0
    blades: int = 2
    rotors: int = 4
    jitter: float = 0.03
    wander: float = 0.5
    harmonics: int = 40
    blade_gain_db: float = 3.0
    tonal: float = 0.12
    corner: float = 170.0
    gust_db: float = 6.0
    gust: float = 0.1
    hiss: float = 0.035
    hiss_corner: float = 6500.0

    def __post_init__(self) -> None:
        check_fields("diffuse.source", self, ranges=RANGES)

    def __call__(self, *, length: int, sample_rate: float, rng: np.random.Generator) -> Array:
        """Return `length` samples whose expected power is 1, shape (length,)."""
        times = np.arange(length) / sample_rate
        steps = int(length / sample_rate / STEP) + 2
        power = self.powers(sample_rate)
        lines = sum(
            self._rotor(times, steps=steps, power=power, rng=rng) for _ in range(self.rotors)
        )

        # The amplitude of the wash is lognormal, of mean square 1.
        spread = self.gust_db * np.log(10.0) / 20.0
        level = spread * _wandering(steps, self.gust, rng=rng) - spread**2
        gusts = np.exp(np.interp(times, np.arange(steps) * STEP, level))
        wash = gusts * _falling(length, sample_rate, corner=self.corner, order=3.0, rng=rng)
        hiss = _falling(length, sample_rate, corner=self.hiss_corner, order=8.0, rng=rng)
        return (
            np.sqrt(self.tonal / self.rotors) * lines
            + np.sqrt((1.0 - self.tonal) * (1.0 - self.hiss)) * wash
            + np.sqrt((1.0 - self.tonal) * self.hiss) * hiss
        )

    def powers(self, sample_rate: float) -> Array:
        """Return the powers of the harmonics at a sample rate, of sum 1, shape (`harmonics`,).

        Fewer where the last ones, at the rotor's highest speed, lie above the Nyquist frequency.
        """
        orders = np.arange(1, self.harmonics + 1)
        present = orders[orders * self.rate * (1 + 5 * self.jitter) < sample_rate / 2]
        gain = 10.0 ** (self.blade_gain_db / 10.0)
        power = np.where(present % self.blades == 0, gain, 1.0) / present**2
        return power / power.sum()

    def _rotor(self, times: Array, *, steps: int, power: Array, rng: np.random.Generator) -> Array:
        """Return the lines of one rotor at `times` in s, shape (N,).

        Args:
            times: shape (N,), in s.
            steps: changes of speed until the last of them.
            power: of each harmonic.
            rng: draws phases and speeds.
        """
        # The waveform of one revolution, harmonics of random phase.
        spectrum = np.zeros(TABLE // 2 + 1, dtype=complex)
        phases = np.exp(2j * np.pi * rng.random(len(power)))
        spectrum[1 : len(power) + 1] = np.sqrt(power / 2) * phases * TABLE
        revolution = fft.irfft(spectrum, TABLE)

        # It is read at the angle to which the rotor has turned.
        angle = rng.random()
        speed = self.rate * (1.0 + self.jitter * _wandering(steps, self.wander, rng=rng))
        turns = np.concatenate([[0.0], np.cumsum(speed) * STEP])
        place = (angle + np.interp(times, np.arange(steps + 1) * STEP, turns)) * TABLE
        point = place.astype(np.int64)
        slope = np.diff(revolution, append=revolution[0])
        return revolution[point % TABLE] + (place - point) * slope[point % TABLE]


def _wandering(steps: int, time: float, *, rng: np.random.Generator) -> Array:
    """Return an Ornstein-Uhlenbeck process of deviation 1, a value every `STEP`, shape (steps,).

    Args:
        steps: number of values.
        time: time constant, in s.
        rng: draws it.
    """
    keep = np.exp(-STEP / time)
    kicks = rng.standard_normal(steps) * np.sqrt(1.0 - keep**2)
    # The first value has the deviation of all others: the process has been going on for ever.
    kicks[0] /= np.sqrt(1.0 - keep**2)
    return signal.lfilter([1.0], [1.0, -keep], kicks)


def _falling(
    length: int, sample_rate: float, *, corner: float, order: float, rng: np.random.Generator
) -> Array:
    """Return Gaussian noise of power 1 and density 1 / (1 + (f / corner)^order) above `LOWEST`."""
    size = fft.next_fast_len(max(length, int(2 * sample_rate / LOWEST)), real=True)
    frequencies = fft.rfftfreq(size, 1.0 / sample_rate)
    density = np.where(frequencies < LOWEST, 0.0, 1.0 / (1.0 + (frequencies / corner) ** order))
    white = fft.rfft(rng.standard_normal(size))
    return fft.irfft(np.sqrt(density / density.mean()) * white, size)[:length]
