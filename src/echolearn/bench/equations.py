"""The equations as printed, loop by loop: the tests' oracle and the benchmark's peer.

Plain NumPy, slow and literal, sharing nothing with the fast estimators. Delays are phase shifts
Z(tau) over all N samples (Eq. 10), with signed frequencies; sums are Python loops; matrices are
inverted by LAPACK; c is 343 m/s.
"""

import math
from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.types import SPEED_OF_SOUND, Array


@dataclass(frozen=True)
class Recording:
    """One recording, and what is known about it.

    Attributes:
        samples: recorded by all microphones, shape (M, N).
        burst: probe as emitted, without the silence after it, shape (L,).
        positions: microphones, shape (M, 3), in m.
        azimuths: grid of directions, shape (A,), in rad.
        first, last: limits of the search window, lags at microphone 1.
        rate: sample rate, Hz.
    """

    samples: Array
    burst: Array
    positions: Array
    azimuths: Array
    first: int
    last: int
    rate: float

    @property
    def lags(self) -> range:
        """Lags of the search window."""
        return range(self.first, self.last + 1)

    @property
    def probe(self) -> Array:
        """Burst followed by silence, shape (N,)."""
        return padded(self.burst, self.samples.shape[-1])

    def ahead(self, azimuth: float) -> Array:
        """Return y_m(n + eta_m): all microphones as if at microphone 1, shape (M, N)."""
        eta = relative(self.positions, azimuth, rate=self.rate)
        return np.stack([shift(y, -late) for y, late in zip(self.samples, eta, strict=True)])


def shift(samples: Array, delay: float) -> Array:
    """Delay real samples (..., N) circularly by a fraction of samples: Z(tau) of Eq. 10."""
    size = samples.shape[-1]
    omega = 2 * np.pi * np.fft.rfftfreq(size)
    return np.fft.irfft(np.fft.rfft(samples) * np.exp(-1j * omega * delay), size)


def padded(burst: Array, length: int) -> Array:
    """Return the burst followed by silence, shape (length,)."""
    return np.concatenate([burst, np.zeros(length - len(burst))])


def snls(recording: Recording) -> tuple[int, float]:
    """Return the lag and gain of Eqs. 10-13 at microphone 1: least squares over every lag.

    Only positive gains count.
    """
    received = recording.samples[0]
    probe = recording.probe
    # The first of equal costs wins, as in a loop that looks for a smaller one.
    best = (math.inf, recording.first, 0.0)
    for lag in recording.lags:
        delayed = shift(probe, lag)
        gain = max(float(delayed @ received / (delayed @ delayed)), 0.0)
        best = min(best, (float(np.sum((received - gain * delayed) ** 2)), lag, gain))
    return best[1], best[2]


def relative(positions: Array, azimuth: float, *, rate: float) -> Array:
    """Return eta_m of Eq. 3, the delays relative to microphone 1, in samples, shape (M,).

    Args:
        positions: microphones, shape (M, 3), in m.
        azimuth: direction in the plane that the wave comes from, in rad.
        rate: sample rate, Hz.
    """
    late = delays(positions, azimuth)
    return (late - late[0]) * rate


def delays(positions: Array, azimuth: float, *, elevation: float = math.pi / 2) -> Array:
    """Return a plane wave's delays at microphones relative to the origin, in s, shape (M,).

    In a ring of radius R they are -(R/c) sin(psi) cos(theta - phi).

    Args:
        positions: microphones, shape (M, 3), in m.
        azimuth, elevation: direction that the wave comes from, in rad.
    """
    ahead = [
        math.hypot(x, y) * math.sin(elevation) * math.cos(math.atan2(y, x) - azimuth)
        for x, y, _ in positions
    ]
    return -(np.array(ahead) + positions[:, 2] * math.cos(elevation)) / SPEED_OF_SOUND


def spectra(recording: Array, frame: int = 882) -> Array:
    """Return the STFT of (M, N), Hann window and half overlap, by its definition: (M, F, T)."""
    hop = frame // 2
    count = 1 + (recording.shape[-1] - frame) // hop
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(frame) / frame)
    return np.stack(
        [np.fft.rfft(recording[:, t * hop : t * hop + frame] * window) for t in range(count)],
        axis=-1,
    )


def mpdr(recording: Recording, gamma: float = 0.1) -> Array:
    """Return the SRP-MPDR power over azimuths (Eqs. 15-18): w^H R_bar w, summed over bins.

    R_bar is loaded diagonally with the share gamma.
    """
    frames = spectra(recording.samples)
    power = np.zeros(len(recording.azimuths))
    identity = np.eye(len(frames))
    for frequency, bins in zip(
        np.fft.rfftfreq(882, 1 / recording.rate), np.moveaxis(frames, 1, 0), strict=True
    ):
        covariance: Array = sum((np.outer(y, y.conj()) for y in bins.T), 0 * identity)
        covariance = covariance / len(bins.T)
        loading = np.trace(covariance) / len(frames) * identity
        loaded = (1 - gamma) * covariance + gamma * loading
        inverse = np.linalg.inv(loaded)
        for index, azimuth in enumerate(recording.azimuths):
            late = delays(recording.positions, azimuth)
            steering = np.exp(-2j * np.pi * frequency * late)
            weights = inverse @ steering / (steering.conj() @ inverse @ steering)
            power[index] += (weights.conj() @ loaded @ weights).real
    return power


def steered(recording: Recording, azimuth: float) -> Array:
    """Return J(tau, phi) at every lag, shape (N,): advanced by eta_m, summed, correlated."""
    together = recording.ahead(azimuth).sum(axis=0)
    spectrum = np.fft.fft(together) * np.fft.fft(recording.probe).conj()
    return np.fft.ifft(spectrum).real


def gated(recording: Recording, lag: int) -> Array:
    """Return sum_k J(lag + k, phi)^2 for |k| <= 2 over azimuths."""
    rows = (steered(recording, azimuth) for azimuth in recording.azimuths)
    return np.array([np.sum(row[lag - 2 : lag + 3] ** 2) for row in rows])


def joint(recording: Recording, weights: Array | None = None) -> Array:
    """Return J(tau, phi) over azimuths and lags, shape (A, last - first + 1).

    J = sum_m w_m <y_m(n + eta_m(phi)), s(n - tau)>, which EM-MC with one echo maximises as well;
    w_m, one over each microphone's noise variance, shape (M,), is 1 unless given.
    """
    weights = np.ones(len(recording.samples)) if weights is None else weights
    burst = recording.burst
    surface = np.zeros((len(recording.azimuths), len(recording.lags)))
    for index, azimuth in enumerate(recording.azimuths):
        for y, weight in zip(recording.ahead(azimuth), weights, strict=True):
            for column, lag in enumerate(recording.lags):
                surface[index, column] += weight * float(y[lag : lag + len(burst)] @ burst)
    return surface


def mclam(recording: Recording) -> tuple[int, float]:
    """Return lag and azimuth of McLAM as reconstructed.

    SRP-MPDR gives the direction, S-NLS on the sum of the costs aligned to it the time.
    """
    azimuth = float(recording.azimuths[mpdr(recording).argmax()])
    cost = np.zeros(len(recording.lags))
    probe = recording.probe
    etas = relative(recording.positions, azimuth, rate=recording.rate)
    for y, eta in zip(recording.samples, etas, strict=True):
        for column, lag in enumerate(recording.lags):
            cost[column] += float(shift(probe, lag + eta) @ y)
    return recording.first + int(cost.argmax()), azimuth


def peaks(recording: Recording, loading: float = 0.0) -> int:
    """Return the lag of RIR-PP: the peak of the response H1 of microphone 1 in the window.

    H1 = G_xy / (G_xx + loading * mean G_xx), the loading a share of the burst's mean power.
    """
    emitted = np.fft.fft(recording.probe)
    received = np.fft.fft(recording.samples[0])
    response = np.zeros_like(emitted)
    level = loading * float(np.mean(np.abs(emitted) ** 2))
    for k, (x, y) in enumerate(zip(emitted, received, strict=True)):
        response[k] = x.conjugate() * y / (abs(x) ** 2 + level)
    return recording.first + int(
        np.fft.ifft(response).real[recording.first : recording.last + 1].argmax()
    )
