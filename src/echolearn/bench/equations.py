"""The equations as printed, loop by loop: the tests' oracle and the benchmark's peer.

Plain NumPy, slow and literal, sharing nothing with the fast estimators. Delays are phase shifts
Z(tau) over all N samples (Eq. 10), with signed frequencies; sums are Python loops; matrices are
inverted by LAPACK; c is 343 m/s.

Everything takes one recording:

| argument            | meaning                                                     |
|---------------------|-------------------------------------------------------------|
| recording           | samples of microphone 1, shape (N,), or all, shape (M, N)   |
| burst               | probe as emitted, without the silence after it, shape (L,)  |
| positions           | microphones, shape (M, 3), in m                             |
| azimuths            | grid of directions, shape (A,), in rad                      |
| first, last         | limits of the search window, lags at microphone 1         |
| rate                | sample rate, Hz                                             |
"""

import math

import numpy as np

from echolearn.acoustics.types import SPEED_OF_SOUND, Array


def shift(samples: Array, delay: float) -> Array:
    """Delay real samples (..., N) circularly by a fraction of samples: Z(tau) of Eq. 10."""
    size = samples.shape[-1]
    omega = 2 * np.pi * np.fft.rfftfreq(size)
    return np.fft.irfft(np.fft.rfft(samples) * np.exp(-1j * omega * delay), size)


def padded(burst: Array, length: int) -> Array:
    """Return the burst followed by silence, shape (length,)."""
    return np.concatenate([burst, np.zeros(length - len(burst))])


def snls(recording: Array, burst: Array, *, first: int, last: int) -> tuple[int, float]:
    """Return the lag and gain of Eqs. 10-13: least squares over every lag, positive gains only.

    Args:
        recording, burst, first, last: see the header; microphone 1.
    """
    probe = padded(burst, len(recording))
    # The first of equal costs wins, as in a loop that looks for a smaller one.
    best = (math.inf, first, 0.0)
    for lag in range(first, last + 1):
        delayed = shift(probe, lag)
        gain = max(float(delayed @ recording / (delayed @ delayed)), 0.0)
        best = min(best, (float(np.sum((recording - gain * delayed) ** 2)), lag, gain))
    return best[1], best[2]


def relative(positions: Array, azimuth: float, *, rate: float) -> Array:
    """Return eta_m of Eq. 3, the delays relative to microphone 1, in samples, shape (M,)."""
    late = delays(positions, azimuth)
    return (late - late[0]) * rate


def delays(positions: Array, azimuth: float, elevation: float = math.pi / 2) -> Array:
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


def mpdr(
    recording: Array, positions: Array, azimuths: Array, *, rate: float, gamma: float = 0.1
) -> Array:
    """Return the SRP-MPDR power over azimuths (Eqs. 15-18): w^H R_bar w, summed over bins.

    Args:
        recording, positions, azimuths, rate: see the header; all microphones.
        gamma: share of the diagonal loading in R_bar.
    """
    frames = spectra(recording)
    power = np.zeros(len(azimuths))
    microphones = len(positions)
    for frequency, bins in zip(
        np.fft.rfftfreq(882, 1 / rate), np.moveaxis(frames, 1, 0), strict=True
    ):
        covariance: Array = sum(
            (np.outer(y, y.conj()) for y in bins.T), np.zeros((microphones, microphones))
        ) / len(bins.T)
        loaded = (1 - gamma) * covariance + gamma * np.trace(covariance) / microphones * np.eye(
            microphones
        )
        inverse = np.linalg.inv(loaded)
        for index, azimuth in enumerate(azimuths):
            steering = np.exp(-2j * np.pi * frequency * delays(positions, azimuth))
            weights = inverse @ steering / (steering.conj() @ inverse @ steering)
            power[index] += (weights.conj() @ loaded @ weights).real
    return power


def steered(
    recording: Array, burst: Array, positions: Array, azimuth: float, *, rate: float
) -> Array:
    """Return J(tau, phi) at every lag, shape (N,): advanced by eta_m, summed, correlated.

    Args:
        recording, burst, positions, rate: see the header; all microphones.
        azimuth: phi, in rad.
    """
    together = np.zeros(recording.shape[-1])
    for y, eta in zip(recording, relative(positions, azimuth, rate=rate), strict=True):
        together += shift(y, -eta)
    spectrum = np.fft.fft(together) * np.fft.fft(padded(burst, len(together))).conj()
    return np.fft.ifft(spectrum).real


def gated(
    recording: Array, burst: Array, positions: Array, azimuths: Array, *, lag: int, rate: float
) -> Array:
    """Return sum_k J(lag + k, phi)^2 for |k| <= 2 over azimuths.

    Args:
        recording, burst, positions, azimuths, rate: see the header; all microphones.
        lag: of the echo.
    """
    rows = (steered(recording, burst, positions, azimuth, rate=rate) for azimuth in azimuths)
    return np.array([np.sum(row[lag - 2 : lag + 3] ** 2) for row in rows])


def joint(
    recording: Array,
    burst: Array,
    positions: Array,
    azimuths: Array,
    *,
    first: int,
    last: int,
    rate: float,
    weights: Array | None = None,
) -> Array:
    """Return J(tau, phi) over azimuths and lags, shape (A, last - first + 1).

    J = sum_m w_m <y_m(n + eta_m(phi)), s(n - tau)>, which EM-MC with one echo maximises as well.

    Args:
        recording, burst, positions, azimuths, first, last, rate: see the header; all microphones.
        weights: w_m, one over each microphone's noise variance, shape (M,); 1 unless given.
    """
    weights = np.ones(len(recording)) if weights is None else weights
    surface = np.zeros((len(azimuths), last - first + 1))
    for index, azimuth in enumerate(azimuths):
        for y, eta, weight in zip(
            recording, relative(positions, azimuth, rate=rate), weights, strict=True
        ):
            ahead = shift(y, -eta)
            for lag in range(first, last + 1):
                surface[index, lag - first] += weight * float(ahead[lag : lag + len(burst)] @ burst)
    return surface


def mclam(
    recording: Array,
    burst: Array,
    positions: Array,
    azimuths: Array,
    *,
    first: int,
    last: int,
    rate: float,
) -> tuple[int, float]:
    """Return lag and azimuth of McLAM as reconstructed.

    SRP-MPDR gives the direction, S-NLS on the sum of the costs aligned to it the time.

    Args:
        recording, burst, positions, azimuths, first, last, rate: see the header; all microphones.
    """
    azimuth = float(azimuths[mpdr(recording, positions, azimuths, rate=rate).argmax()])
    cost = np.zeros(last - first + 1)
    probe = padded(burst, recording.shape[-1])
    for y, eta in zip(recording, relative(positions, azimuth, rate=rate), strict=True):
        for lag in range(first, last + 1):
            cost[lag - first] += float(shift(probe, lag + eta) @ y)
    return first + int(cost.argmax()), azimuth


def peaks(recording: Array, burst: Array, *, first: int, last: int, loading: float = 0.0) -> int:
    """Return the lag of RIR-PP: the peak of the response H1 in the window.

    H1 = G_xy / (G_xx + loading * mean G_xx).

    Args:
        recording, burst, first, last: see the header; microphone 1.
        loading: share of the burst's mean power that is added to each bin.
    """
    response = np.zeros(len(recording), dtype=complex)
    emitted = np.fft.fft(padded(burst, len(recording)))
    received = np.fft.fft(recording)
    level = loading * float(np.mean(np.abs(emitted) ** 2))
    for k, (x, y) in enumerate(zip(emitted, received, strict=True)):
        response[k] = x.conjugate() * y / (abs(x) ** 2 + level)
    return first + int(np.fft.ifft(response).real[first : last + 1].argmax())
