"""The paper's equations once more, slow and literal: oracles for the fast code, sharing none of it.

Delays are phase shifts Z(tau) over all N samples, with signed frequencies; sums are Python loops; matrices are
inverted by LAPACK. c is 343 m/s throughout.
"""

import math

import numpy as np

from echolearn.types import Array

SPEED = 343.0


def shift(samples: Array, delay: float) -> Array:
    """Delay real samples (..., N) circularly by a fractional number of samples: Z(tau) of Eq. 10."""
    size = samples.shape[-1]
    omega = 2 * np.pi * np.fft.rfftfreq(size)
    return np.fft.irfft(np.fft.rfft(samples) * np.exp(-1j * omega * delay), size)


def padded(burst: Array, length: int) -> Array:
    """Return the burst followed by silence, shape (length,)."""
    return np.concatenate([burst, np.zeros(length - len(burst))])


def snls(recording: Array, burst: Array, *, first: int, last: int) -> tuple[int, float]:
    """Return the lag and gain of Eqs. 10-13: least squares over every lag, positive gains only."""
    probe = padded(burst, len(recording))
    best = (math.inf, first, 0.0)
    for lag in range(first, last + 1):
        delayed = shift(probe, lag)
        gain = max(float(delayed @ recording / (delayed @ delayed)), 0.0)
        best = min(best, (float(np.sum((recording - gain * delayed) ** 2)), lag, gain))
    return best[1], best[2]


def delays(positions: Array, azimuth: float, elevation: float = math.pi / 2) -> Array:
    """Return a plane wave's delays at microphones (M, 3) relative to the origin: -(R/c) sin psi cos(theta - phi)."""
    ahead = [math.hypot(x, y) * math.sin(elevation) * math.cos(math.atan2(y, x) - azimuth) for x, y, _ in positions]
    return -(np.array(ahead) + positions[:, 2] * math.cos(elevation)) / SPEED


def plane_wave(source: Array, positions: Array, azimuth: float, *, rate: float) -> Array:
    """Return what microphones (M, 3) hear of a plane wave that passes the origin as `source` (N,), shape (M, N)."""
    return np.stack([shift(source, delay * rate) for delay in delays(positions, azimuth)])


def spectra(recording: Array, frame: int = 882) -> Array:
    """Return the STFT of (M, N) with Hann window and half overlap by the sum that defines it, shape (M, F, T)."""
    hop, count = frame // 2, 1 + (recording.shape[-1] - frame) // (frame // 2)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(frame) / frame)
    return np.stack([np.fft.rfft(recording[:, t * hop : t * hop + frame] * window) for t in range(count)], axis=-1)


def mpdr(recording: Array, positions: Array, azimuths: Array, *, rate: float, gamma: float = 0.1) -> Array:
    """Return the SRP-MPDR power of one recording (M, N) over azimuths (Eqs. 15-18): w^H R_bar w, summed over bins."""
    frames = spectra(recording)
    power = np.zeros(len(azimuths))
    microphones = len(positions)
    for frequency, bins in zip(np.fft.rfftfreq(882, 1 / rate), np.moveaxis(frames, 1, 0), strict=True):
        covariance = sum(np.outer(y, y.conj()) for y in bins.T) / bins.shape[-1]
        loaded = (1 - gamma) * covariance + gamma * np.trace(covariance) / microphones * np.eye(microphones)
        inverse = np.linalg.inv(loaded)
        for index, azimuth in enumerate(azimuths):
            steering = np.exp(-2j * np.pi * frequency * delays(positions, azimuth))
            weights = inverse @ steering / (steering.conj() @ inverse @ steering)
            power[index] += (weights.conj() @ loaded @ weights).real
    return power


def steered(recording: Array, burst: Array, positions: Array, azimuth: float, *, rate: float) -> Array:
    """Return J(tau, phi) at every lag: recordings (M, N) advanced by eta_m, summed, correlated, shape (N,)."""
    eta = (delays(positions, azimuth) - delays(positions, azimuth)[0]) * rate
    together = sum(shift(y, -lag) for y, lag in zip(recording, eta, strict=True))
    spectrum = np.fft.fft(together) * np.fft.fft(padded(burst, len(together))).conj()
    return np.fft.ifft(spectrum).real


def gated(recording: Array, burst: Array, positions: Array, azimuths: Array, *, lag: int, rate: float) -> Array:
    """Return sum_k J(lag + k, phi)^2 for |k| <= 2 over azimuths."""
    rows = (steered(recording, burst, positions, azimuth, rate=rate) for azimuth in azimuths)
    return np.array([np.sum(row[lag - 2 : lag + 3] ** 2) for row in rows])


def images(size: tuple[float, ...], position: Array) -> list[Array]:
    """Return the six first-order mirror images of a point in a shoebox spanning [0, size]."""
    found = []
    for axis in range(3):
        for wall in (0.0, size[axis]):
            image = np.array(position, dtype=float)
            image[axis] = 2 * wall - image[axis]
            found.append(image)
    return found


def microphones(positions: Array, place: Array, heading: float) -> Array:
    """Return microphones of the robot's frame in the room's frame, one by one."""
    cos, sin = math.cos(heading), math.sin(heading)
    turned = [[cos * x - sin * y, sin * x + cos * y, z] for x, y, z in positions]
    return np.array(turned) + place


def echo(burst: Array, image: Array, microphone: Array, *, strength: float, rate: float, length: int) -> Array:
    """Return the burst as it comes from one image to one microphone: strength / (4 pi d), d/c late, shape (length,)."""
    distance = float(np.linalg.norm(image - microphone))
    return strength / (4 * math.pi * distance) * shift(padded(burst, length), distance / SPEED * rate)
