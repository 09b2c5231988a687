"""A model of what a microphone on a multirotor hears: lines of the rotors, gusty wash, and hiss.

    x(t) = sqrt(w / Q) sum_q sum_k a_k cos(k phi_q(t) + theta_qk) + sqrt(1 - w) (sqrt(1 - h) g(t)
    b(t) + sqrt(h) c(t)) dphi_q / dt = 2 pi rate (1 + u_q(t))

Q rotors turn for themselves: the relative speed u_q wanders as an Ornstein-Uhlenbeck process of
    deviation `jitter`
and time constant `wander`, so the lines of several rotors beat and the high ones blur. The power
a_k^2 / 2 of the harmonics falls as 1 / k^2, those of the blade-passing rate (every `blades`-th)
stand out by `blade_gain_db`. The wash, air that the rotors blow over the microphones, is Gaussian
noise b of density 1 / (1 + (f / corner)^3), nothing below 20 Hz, where microphones hear little; it
comes in gusts: the level of g wanders by `gust_db`, within `gust` seconds, at a mean power of 1.
The hiss c, of density 1 / (1 + (f / hiss_corner)^8), is steady.

The defaults are fitted to a recording from DREGON (four rotors at 70 revolutions/s; Strauss et al.,
"DREGON: dataset and methods for UAV-embedded sound source localization", 2018) as the paper's first
author keeps it with the program of
another paper: 90 % of the power below 459 Hz, the strongest line at 68 Hz, levels that wander by 6
    dB from 20 ms to
20 ms below 500 Hz and by 1.4 dB above 4 kHz. The model's third octaves, 50 Hz to 8 kHz, are within
3 dB of it.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft, signal

from echolearn.acoustics.types import Array
from echolearn.checks import check_number, check_whole

LOWEST = 20.0
"""Hz; wash and hiss begin here."""
STEP = 0.01
"""Seconds between changes of speed."""
TABLE = 8192
"""Points of one revolution; linear interpolation between them errs by less than -80 dB at the 30th
harmonic."""


@dataclass(frozen=True)
class Rotor:
    """A multirotor in hover, heard by one microphone.

    Attributes:
        rate: revolutions per second.
        blades: of each rotor.
        rotors: how many turn, each at its own speed and phase.
        jitter: standard deviation of a rotor's relative speed.
        wander: time constant of its changes, in s.
        harmonics: of the revolution that are heard, those below the Nyquist frequency.
        blade_gain_db: by how much harmonics of the blade-passing rate stand out.
        tonal: share w of the power that lies in lines.
        corner: of the wash, in Hz.
        gust_db: standard deviation of the wash's level.
        gust: time constant of its changes, in s.
        hiss: share h of the rest that is hiss; the other is wash.
        hiss_corner: in Hz.
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
        check_number(
            "diffuse.source.rate",
            self.rate,
            low=1.0,
            high=1000.0,
            unit="Hz",
            hint="revolutions per second",
        )
        check_whole("diffuse.source.blades", self.blades, low=1, high=20)
        check_whole("diffuse.source.rotors", self.rotors, low=1, high=32)
        check_number(
            "diffuse.source.jitter", self.jitter, low=0.0, high=0.2, hint="relative to the rate"
        )
        check_number("diffuse.source.wander", self.wander, low=2 * STEP, high=100.0, unit="s")
        check_whole("diffuse.source.harmonics", self.harmonics, low=1, high=1000)
        check_number(
            "diffuse.source.blade_gain_db", self.blade_gain_db, low=-100.0, high=100.0, unit="dB"
        )
        check_number("diffuse.source.tonal", self.tonal, low=0.0, high=1.0)
        check_number("diffuse.source.corner", self.corner, low=LOWEST, high=100_000.0, unit="Hz")
        check_number(
            "diffuse.source.gust_db",
            self.gust_db,
            low=0.0,
            high=20.0,
            unit="dB",
            hint="0 is steady wash",
        )
        check_number("diffuse.source.gust", self.gust, low=2 * STEP, high=100.0, unit="s")
        check_number("diffuse.source.hiss", self.hiss, low=0.0, high=1.0)
        check_number(
            "diffuse.source.hiss_corner", self.hiss_corner, low=LOWEST, high=100_000.0, unit="Hz"
        )

    def __call__(self, *, length: int, sample_rate: float, rng: np.random.Generator) -> Array:
        """Return `length` samples whose expected power is 1, shape (length,)."""
        lines = sum(self._rotor(length, sample_rate, rng) for _ in range(self.rotors))
        wash = self._gusts(length, sample_rate, rng) * _falling(
            length, sample_rate, self.corner, 3.0, rng
        )
        hiss = _falling(length, sample_rate, self.hiss_corner, 8.0, rng)
        shares = (
            self.tonal / self.rotors,
            (1.0 - self.tonal) * (1.0 - self.hiss),
            (1.0 - self.tonal) * self.hiss,
        )
        return sum(
            np.sqrt(share) * part for share, part in zip(shares, (lines, wash, hiss), strict=True)
        )

    def powers(self, sample_rate: float) -> Array:
        """Return the power of each harmonic that is heard at `sample_rate`, shape (harmonics or
        less,), of sum 1.
        """
        orders = np.arange(1, self.harmonics + 1)
        heard = orders[orders * self.rate * (1 + 5 * self.jitter) < sample_rate / 2]
        power = (
            np.where(heard % self.blades == 0, 10.0 ** (self.blade_gain_db / 10.0), 1.0) / heard**2
        )
        return power / power.sum()

    def _rotor(self, length: int, sample_rate: float, rng: np.random.Generator) -> Array:
        """Return the lines of one rotor: its waveform of one revolution, read at the angle it has
        turned to.
        """
        power = self.powers(sample_rate)
        spectrum = np.zeros(TABLE // 2 + 1, dtype=complex)
        spectrum[1 : len(power) + 1] = (
            np.sqrt(power / 2) * np.exp(2j * np.pi * rng.random(len(power))) * TABLE
        )
        revolution = fft.irfft(spectrum, TABLE)
        place = (rng.random() + self._turns(length, sample_rate, rng)) * TABLE
        point = place.astype(np.int64)
        slope = np.diff(revolution, append=revolution[0])
        return revolution[point % TABLE] + (place - point) * slope[point % TABLE]

    def _turns(self, length: int, sample_rate: float, rng: np.random.Generator) -> Array:
        """Return the revolutions done by each sample, shape (length,)."""
        steps = int(length / sample_rate / STEP) + 2
        speed = self.rate * (1.0 + self.jitter * _wandering(steps, self.wander, rng))
        done = np.concatenate([[0.0], np.cumsum(speed) * STEP])
        return np.interp(np.arange(length) / sample_rate, np.arange(steps + 1) * STEP, done)

    def _gusts(self, length: int, sample_rate: float, rng: np.random.Generator) -> Array:
        """Return g, the amplitude of the wash, of mean square 1: lognormal, shape (length,)."""
        steps = int(length / sample_rate / STEP) + 2
        spread = self.gust_db * np.log(10.0) / 20.0
        level = spread * _wandering(steps, self.gust, rng) - spread**2
        return np.exp(np.interp(np.arange(length) / sample_rate, np.arange(steps) * STEP, level))


def _wandering(steps: int, time: float, rng: np.random.Generator) -> Array:
    """Return an Ornstein-Uhlenbeck process of deviation 1 and time constant `time` in s, a value
    every `STEP`.
    """
    keep = np.exp(-STEP / time)
    kicks = rng.standard_normal(steps) * np.sqrt(1.0 - keep**2)
    kicks[0] /= np.sqrt(1.0 - keep**2)
    return signal.lfilter([1.0], [1.0, -keep], kicks)


def _falling(
    length: int, sample_rate: float, corner: float, order: float, rng: np.random.Generator
) -> Array:
    """Return Gaussian noise of power 1 and density 1 / (1 + (f / corner)^order) above `LOWEST`,
    shape (length,).
    """
    size = fft.next_fast_len(max(length, int(2 * sample_rate / LOWEST)), real=True)
    frequencies = fft.rfftfreq(size, 1.0 / sample_rate)
    density = np.where(frequencies < LOWEST, 0.0, 1.0 / (1.0 + (frequencies / corner) ** order))
    shaped = fft.irfft(
        np.sqrt(density / density.mean()) * fft.rfft(rng.standard_normal(size)), size
    )
    return shaped[:length]
