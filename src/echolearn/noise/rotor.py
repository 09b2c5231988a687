"""A model of what a multirotor sounds like: lines at the harmonics of its rotors, and low-passed air noise.

    x(t) = sqrt(w / Q) sum_q sum_k a_k cos(k phi_q(t) + theta_qk) + sqrt(1 - w) b(t)
    dphi_q / dt = 2 pi rate (1 + u_q(t))

Q rotors turn for themselves: the relative speed u_q wanders as an Ornstein-Uhlenbeck process of deviation `jitter`
and time constant `wander`, so the lines of several rotors beat and the high ones blur. The power a_k^2 / 2 of the
harmonics falls as 1 / k^2, those of the blade-passing rate (every `blades`-th) stand out by `blade_gain_db`. The air
noise b is Gaussian with density 1 / (1 + (f / corner)^2), and nothing below 20 Hz, where microphones hear little.

With its defaults the model agrees with what is known of the paper's recordings (DREGON, 70 revolutions/s): 90 % of the
power lies below 463 Hz, and the strongest line at 70 Hz (Strauss et al., "DREGON: dataset and methods for
UAV-embedded sound source localization", 2018). Everything else about it is invented.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft, signal

from echolearn.types import Array, check_number, check_whole

LOWEST = 20.0
"""Hz; the air noise begins here."""
STEP = 0.01
"""Seconds between changes of speed."""
TABLE = 8192
"""Points of one revolution; linear interpolation between them errs by less than -80 dB at the 30th harmonic."""


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
        tonal: share of the power that lies in lines.
        corner: of the air noise, in Hz.
    """

    rate: float = 70.0
    blades: int = 2
    rotors: int = 4
    jitter: float = 0.01
    wander: float = 0.5
    harmonics: int = 40
    blade_gain_db: float = 3.0
    tonal: float = 0.6
    corner: float = 70.0

    def __post_init__(self) -> None:
        check_number("diffuse.source.rate", self.rate, low=1.0, high=1000.0, unit="Hz", hint="revolutions per second")
        check_whole("diffuse.source.blades", self.blades, low=1, high=20)
        check_whole("diffuse.source.rotors", self.rotors, low=1, high=32)
        check_number("diffuse.source.jitter", self.jitter, low=0.0, high=0.2, hint="relative to the rate")
        check_number("diffuse.source.wander", self.wander, low=2 * STEP, high=100.0, unit="s")
        check_whole("diffuse.source.harmonics", self.harmonics, low=1, high=1000)
        check_number("diffuse.source.blade_gain_db", self.blade_gain_db, low=-100.0, high=100.0, unit="dB")
        check_number("diffuse.source.tonal", self.tonal, low=0.0, high=1.0)
        check_number("diffuse.source.corner", self.corner, low=LOWEST, high=100_000.0, unit="Hz")

    def __call__(self, *, length: int, sample_rate: float, rng: np.random.Generator) -> Array:
        """Return `length` samples whose expected power is 1, shape (length,)."""
        lines = sum(self._rotor(length, sample_rate, rng) for _ in range(self.rotors))
        air = self._air(length, sample_rate, rng)
        return np.sqrt(self.tonal / self.rotors) * lines + np.sqrt(1.0 - self.tonal) * air

    def powers(self, sample_rate: float) -> Array:
        """Return the power of each harmonic that is heard at `sample_rate`, shape (harmonics or less,), of sum 1."""
        orders = np.arange(1, self.harmonics + 1)
        heard = orders[orders * self.rate * (1 + 5 * self.jitter) < sample_rate / 2]
        power = np.where(heard % self.blades == 0, 10.0 ** (self.blade_gain_db / 10.0), 1.0) / heard**2
        return power / power.sum()

    def _rotor(self, length: int, sample_rate: float, rng: np.random.Generator) -> Array:
        """Return the lines of one rotor: its waveform of one revolution, read at the angle it has turned to."""
        power = self.powers(sample_rate)
        spectrum = np.zeros(TABLE // 2 + 1, dtype=complex)
        spectrum[1 : len(power) + 1] = np.sqrt(power / 2) * np.exp(2j * np.pi * rng.random(len(power))) * TABLE
        revolution = fft.irfft(spectrum, TABLE)
        place = (rng.random() + self._turns(length, sample_rate, rng)) * TABLE
        point = place.astype(np.int64)
        slope = np.diff(revolution, append=revolution[0])
        return revolution[point % TABLE] + (place - point) * slope[point % TABLE]

    def _turns(self, length: int, sample_rate: float, rng: np.random.Generator) -> Array:
        """Return the revolutions done by each sample, shape (length,)."""
        steps = int(length / sample_rate / STEP) + 2
        keep = np.exp(-STEP / self.wander)
        kicks = rng.standard_normal(steps) * np.sqrt(1.0 - keep**2)
        kicks[0] /= np.sqrt(1.0 - keep**2)
        speed = self.rate * (1.0 + self.jitter * signal.lfilter([1.0], [1.0, -keep], kicks))
        done = np.concatenate([[0.0], np.cumsum(speed) * STEP])
        return np.interp(np.arange(length) / sample_rate, np.arange(steps + 1) * STEP, done)

    def _air(self, length: int, sample_rate: float, rng: np.random.Generator) -> Array:
        size = fft.next_fast_len(length, real=True)
        frequencies = fft.rfftfreq(size, 1.0 / sample_rate)
        density = np.where(frequencies < LOWEST, 0.0, 1.0 / (1.0 + (frequencies / self.corner) ** 2))
        shaped = fft.irfft(np.sqrt(density / density.mean()) * fft.rfft(rng.standard_normal(size)), size)
        return shaped[:length]
