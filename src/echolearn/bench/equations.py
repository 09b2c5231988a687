"""The equations as printed, loop by loop: the tests' oracle and the benchmark's peer.

Plain NumPy, slow and literal, sharing nothing with the fast estimators. Delays are phase shifts
Z(tau) over all N samples (Eq. 10), with signed frequencies; sums are Python loops; matrices are
inverted by LAPACK; c is 343 m/s.
Everything takes one recording: `recording` (N,) of microphone 1 or (M, N) of all, `burst` (L,) as
    emitted,
`positions` (M, 3) in m, `azimuths` (A,) in rad, `first` and `last` lag of the search window, `rate`
in Hz. Lags are delays to microphone 1, in samples.
"""

import math

import numpy as np

from echolearn.acoustics.types import SPEED_OF_SOUND, Array

Component = tuple[float, float, float]
"""Lag in samples, azimuth in rad, gain."""


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


def relax(
    recording: Array, burst: Array, *, first: int, last: int, echoes: int, epsilon: float = 1e-4
) -> list[tuple[float, float]]:
    """Return lag and gain of several echoes by RELAX: S-NLS on what the others leave, again until
    nothing changes.

    An echo is added where the residual of those before it is best explained; then all are estimated
    again in turn until the residual's energy changes by less than `epsilon` of itself (Li, Stoica
    1996).
    """
    probe = padded(burst, len(recording))
    found: list[tuple[float, float]] = []
    for count in range(1, echoes + 1):
        found.append((float(first), 0.0))
        before = math.inf
        for _ in range(50):
            for r in reversed(range(count)):
                others = sum(
                    (gain * shift(probe, lag) for lag, gain in found[:r] + found[r + 1 :]),
                    np.zeros(1),
                )
                found[r] = snls(recording - others, burst, first=first, last=last)
            modelled = sum((gain * shift(probe, lag) for lag, gain in found), np.zeros(1))
            rest = float(np.sum((recording - modelled) ** 2))
            if before - rest < epsilon * before:
                break
            before = rest
    return sorted(found, key=lambda echo: -echo[1])


def relative(positions: Array, azimuth: float, *, rate: float) -> Array:
    """Return eta_m of Eq. 3, the delays relative to microphone 1, in samples, shape (M,)."""
    late = delays(positions, azimuth)
    return (late - late[0]) * rate


def delays(positions: Array, azimuth: float, elevation: float = math.pi / 2) -> Array:
    """Return a plane wave's delays at microphones (M, 3) relative to the origin: -(R/c) sin psi
    cos(theta - phi).
    """
    ahead = [
        math.hypot(x, y) * math.sin(elevation) * math.cos(math.atan2(y, x) - azimuth)
        for x, y, _ in positions
    ]
    return -(np.array(ahead) + positions[:, 2] * math.cos(elevation)) / SPEED_OF_SOUND


def spectra(recording: Array, frame: int = 882) -> Array:
    """Return the STFT of (M, N) with Hann window and half overlap by the sum that defines it, shape
    (M, F, T).
    """
    hop, count = frame // 2, 1 + (recording.shape[-1] - frame) // (frame // 2)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(frame) / frame)
    return np.stack(
        [np.fft.rfft(recording[:, t * hop : t * hop + frame] * window) for t in range(count)],
        axis=-1,
    )


def mpdr(
    recording: Array, positions: Array, azimuths: Array, *, rate: float, gamma: float = 0.1
) -> Array:
    """Return the SRP-MPDR power of one recording (M, N) over azimuths (Eqs. 15-18): w^H R_bar w,
    summed over bins.
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
    """Return J(tau, phi) at every lag: recordings (M, N) advanced by eta_m, summed, correlated,
    shape (N,).
    """
    together = np.zeros(recording.shape[-1])
    for y, eta in zip(recording, relative(positions, azimuth, rate=rate), strict=True):
        together += shift(y, -eta)
    spectrum = np.fft.fft(together) * np.fft.fft(padded(burst, len(together))).conj()
    return np.fft.ifft(spectrum).real


def gated(
    recording: Array, burst: Array, positions: Array, azimuths: Array, *, lag: int, rate: float
) -> Array:
    """Return sum_k J(lag + k, phi)^2 for |k| <= 2 over azimuths."""
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
    """Return J(tau, phi) = sum_m w_m <y_m(n + eta_m(phi)), s(n - tau)> over azimuths and lags,
    shape (A, L).
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


def em(
    recording: Array,
    burst: Array,
    positions: Array,
    azimuths: Array,
    *,
    first: int,
    last: int,
    rate: float,
    starts: list[Component] | None = None,
    weights: Array | None = None,
    iterations: int = 30,
) -> list[Component]:
    """Return lag, azimuth and gain of each component by EM-MC (Saqib, Gannot, Jensen 2020), beta =
    1 / R.

    E: x_{r,m} = g_r s(n - tau_r - eta_m(phi_r)) + beta (y_m - sum_q g_q s(n - tau_q -
        eta_m(phi_q))).
    M: (tau, phi)_r = argmax sum_m w_m <x_{r,m}(n + eta_m(phi)), s(n - tau)>, g_r that sum over ||s||^2 sum_m w_m.

    Args:
        starts: R components to begin with; one of gain 0 unless given, and then each iteration is
            the same search.
        weights: w_m, one over each microphone's noise variance, shape (M,); 1 unless given.
    """
    components = list(starts or [(float(first), 0.0, 0.0)])
    weights = np.ones(len(recording)) if weights is None else weights
    for _ in range(iterations):
        heard = [
            component(burst, positions, c, rate=rate, length=recording.shape[-1])
            for c in components
        ]
        rest = (recording - sum(heard)) / len(components)
        for r, own in enumerate(heard):
            surface = joint(
                own + rest,
                burst,
                positions,
                azimuths,
                first=first,
                last=last,
                rate=rate,
                weights=weights,
            )
            best, lag = np.unravel_index(surface.argmax(), surface.shape)
            gain = float(surface.max() / (burst @ burst * np.sum(weights)))
            components[r] = (float(first + lag), float(azimuths[best]), gain)
    return components


def component(
    burst: Array, positions: Array, echo: Component, *, rate: float, length: int
) -> Array:
    """Return what microphones (M, 3) hear of one echo: g s(n - tau - eta_m(phi)), shape (M, N)."""
    lag, azimuth, gain = echo
    eta = relative(positions, azimuth, rate=rate)
    return np.stack([gain * shift(padded(burst, length), lag + late) for late in eta])


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
    """Return lag and azimuth of McLAM as reconstructed: SRP-MPDR's direction, S-NLS on the aligned
    costs' sum.
    """
    azimuth = float(azimuths[mpdr(recording, positions, azimuths, rate=rate).argmax()])
    cost = np.zeros(last - first + 1)
    probe = padded(burst, recording.shape[-1])
    for y, eta in zip(recording, relative(positions, azimuth, rate=rate), strict=True):
        for lag in range(first, last + 1):
            cost[lag - first] += float(shift(probe, lag + eta) @ y)
    return first + int(cost.argmax()), azimuth


def is_detected(recording: Array, *, variance: float, log_gamma: float) -> bool:
    """Tell whether ||y - x_direct||^2 > 2 sigma^2 ln gamma, for recordings without their direct path."""
    energy = 0.0
    for y in np.ravel(recording):
        energy += float(y) ** 2
    return energy > 2 * variance * log_gamma


def peaks(recording: Array, burst: Array, *, first: int, last: int, loading: float = 0.0) -> int:
    """Return the lag of RIR-PP: the peak of the response H1 = G_xy / (G_xx + loading * mean G_xx)
    in the window.
    """
    response = np.zeros(len(recording), dtype=complex)
    emitted, heard = np.fft.fft(padded(burst, len(recording))), np.fft.fft(recording)
    level = loading * float(np.mean(np.abs(emitted) ** 2))
    for k, (x, y) in enumerate(zip(emitted, heard, strict=True)):
        response[k] = x.conjugate() * y / (abs(x) ** 2 + level)
    return first + int(np.fft.ifft(response).real[first : last + 1].argmax())
