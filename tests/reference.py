"""The paper's equations once more, slow and literal: oracles for the fast code, sharing none of it.

Delays are phase shifts Z(tau) over all N samples, with signed frequencies; sums are Python loops; matrices are
inverted by LAPACK. c is 343 m/s throughout.
"""

import math

import numpy as np

SPEED = 343.0


def shift(samples: np.ndarray, delay: float) -> np.ndarray:
    """Delay real samples (..., N) circularly by a fractional number of samples: Z(tau) of Eq. 10."""
    size = samples.shape[-1]
    omega = 2 * np.pi * np.fft.rfftfreq(size)
    return np.fft.irfft(np.fft.rfft(samples) * np.exp(-1j * omega * delay), size)


def padded(burst: np.ndarray, length: int) -> np.ndarray:
    """Return the burst followed by silence, shape (length,)."""
    return np.concatenate([burst, np.zeros(length - len(burst))])


def snls(recording: np.ndarray, burst: np.ndarray, *, first: int, last: int) -> tuple[int, float]:
    """Return the lag and gain of Eqs. 10-13: least squares over every lag, positive gains only."""
    probe = padded(burst, len(recording))
    best = (math.inf, first, 0.0)
    for lag in range(first, last + 1):
        delayed = shift(probe, lag)
        gain = max(float(delayed @ recording / (delayed @ delayed)), 0.0)
        best = min(best, (float(np.sum((recording - gain * delayed) ** 2)), lag, gain))
    return best[1], best[2]


def delays(positions: np.ndarray, azimuth: float, elevation: float = math.pi / 2) -> np.ndarray:
    """Return a plane wave's delays at microphones (M, 3) relative to the origin, in s: -(R/c) sin psi cos(theta - phi)."""
    return np.array(
        [
            -math.hypot(x, y) / SPEED * math.sin(elevation) * math.cos(math.atan2(y, x) - azimuth) - z / SPEED * math.cos(elevation)
            for x, y, z in positions
        ]
    )


def plane_wave(source: np.ndarray, positions: np.ndarray, azimuth: float, *, rate: float) -> np.ndarray:
    """Return what microphones (M, 3) hear of a plane wave that passes the origin as `source` (N,), shape (M, N)."""
    return np.stack([shift(source, delay * rate) for delay in delays(positions, azimuth)])


def spectra(recording: np.ndarray, frame: int = 882) -> np.ndarray:
    """Return the STFT of (M, N) with Hann window and half overlap by the sum that defines it, shape (M, F, T)."""
    hop, count = frame // 2, 1 + (recording.shape[-1] - frame) // (frame // 2)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(frame) / frame)
    return np.stack([np.fft.rfft(recording[:, t * hop : t * hop + frame] * window) for t in range(count)], axis=-1)


def mpdr(recording: np.ndarray, positions: np.ndarray, azimuths: np.ndarray, *, rate: float, gamma: float = 0.1) -> np.ndarray:
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


def steered(recording: np.ndarray, burst: np.ndarray, positions: np.ndarray, azimuth: float, *, rate: float) -> np.ndarray:
    """Return J(tau, phi) at every lag: recordings (M, N) advanced by eta_m, summed, correlated with the burst, shape (N,)."""
    eta = (delays(positions, azimuth) - delays(positions, azimuth)[0]) * rate
    together = sum(shift(y, -lag) for y, lag in zip(recording, eta, strict=True))
    spectrum = np.fft.fft(together) * np.fft.fft(padded(burst, len(together))).conj()
    return np.fft.ifft(spectrum).real


def gated(recording: np.ndarray, burst: np.ndarray, positions: np.ndarray, azimuths: np.ndarray, *, lag: int, rate: float) -> np.ndarray:
    """Return sum_k J(lag + k, phi)^2 for |k| <= 2 over azimuths."""
    rows = (steered(recording, burst, positions, azimuth, rate=rate) for azimuth in azimuths)
    return np.array([np.sum(row[lag - 2 : lag + 3] ** 2) for row in rows])


def images(size: tuple[float, ...], position: np.ndarray) -> list[np.ndarray]:
    """Return the six first-order mirror images of a point in a shoebox spanning [0, size]."""
    found = []
    for axis in range(3):
        for wall in (0.0, size[axis]):
            image = np.array(position, dtype=float)
            image[axis] = 2 * wall - image[axis]
            found.append(image)
    return found


def microphones(positions: np.ndarray, place: np.ndarray, heading: float) -> np.ndarray:
    """Return microphones of the robot's frame in the room's frame, one by one."""
    cos, sin = math.cos(heading), math.sin(heading)
    return np.array([[place[0] + cos * x - sin * y, place[1] + sin * x + cos * y, place[2] + z] for x, y, z in positions])


def echo(burst: np.ndarray, image: np.ndarray, microphone: np.ndarray, *, strength: float, rate: float, length: int) -> np.ndarray:
    """Return the burst as it comes from one image to one microphone: strength / (4 pi d), d/c late, shape (length,)."""
    distance = float(np.linalg.norm(image - microphone))
    return strength / (4 * math.pi * distance) * shift(padded(burst, length), distance / SPEED * rate)
