"""Rooms and waves once more, slow and literal: oracles for the fast code, sharing none of it.

Estimators of one echo are in `echolearn.bench.equations`, those of several here; delays are its
phase shifts. c is 343 m/s throughout.
"""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.types import Array, MicArray, Observation, Probe
from echolearn.bench.equations import Recording, delays, joint, padded, relative, shift, snls

SPEED = 343.0

Component = tuple[float, float, float]
"""Lag in samples, azimuth in rad, gain."""

RATE = 22050.0
RING = circular_array()
FIRST, LAST = SearchWindow().lags(RING, RATE)


def plane_wave(source: Array, positions: Array, azimuth: float, *, rate: float) -> Array:
    """Return what microphones (M, 3) record of a plane wave that passes the origin as `source`."""
    return np.stack([shift(source, delay * rate) for delay in delays(positions, azimuth)])


def wave(probe: Probe, azimuth: float, lag: float, gain: float = 0.1) -> Array:
    """Return the ring's recordings (M, N) of an echo that reaches microphone 1 after `lag`."""
    early = delays(RING.positions, azimuth)[0] * RATE
    source = gain * shift(padded(probe.samples, probe.length), lag - early)
    return plane_wave(source, RING.positions, azimuth, rate=RATE)


def white(probe: Probe, level: float, seed: int = 0) -> Array:
    """Return white noise at the ring, as long as a recording, shape (M, N)."""
    return level * np.random.default_rng(seed).standard_normal((len(RING), probe.length))


def loops(probe: Probe, samples: Array, azimuths: Array) -> Recording:
    """Return what the ring's recordings (M, N) are to the equations."""
    return Recording(samples, probe.samples, RING.positions, azimuths, FIRST, LAST, RATE)


def observed(probe: Probe, *samples: Array, array: MicArray = RING, **known: Any) -> Observation:
    """Return recordings (M, N) as a batch."""
    return Observation(np.stack(samples), probe, array, **known)


def turn(angle: Array | float) -> Array:
    """Return angles between -pi and pi."""
    return np.angle(np.exp(1j * np.asarray(angle)))


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


def echo(
    burst: Array, image: Array, microphone: Array, *, strength: float, rate: float, length: int
) -> Array:
    """Return the burst from one image at one microphone: strength / (4 pi d), d/c late."""
    distance = float(np.linalg.norm(image - microphone))
    late = shift(padded(burst, length), distance / SPEED * rate)
    return strength / (4 * math.pi * distance) * late


def relax(recording: Recording, *, echoes: int, epsilon: float = 1e-4) -> list[tuple[float, float]]:
    """Return lag and gain of several echoes at microphone 1 by RELAX: S-NLS on the others' rest.

    An echo is added where the residual of those before it is best explained; then all are estimated
    again in turn until the residual's energy changes by less than `epsilon` of itself (Li, Stoica
    1996).
    """
    probe = recording.probe
    received = recording.samples[0]
    found: list[tuple[float, float]] = []
    for count in range(1, echoes + 1):
        found.append((float(recording.first), 0.0))
        before = math.inf
        for _ in range(50):
            for r in reversed(range(count)):
                others = sum(
                    (gain * shift(probe, lag) for lag, gain in found[:r] + found[r + 1 :]),
                    np.zeros(1),
                )
                found[r] = snls(replace(recording, samples=(received - others)[None]))
            modelled = sum((gain * shift(probe, lag) for lag, gain in found), np.zeros(1))
            rest = float(np.sum((received - modelled) ** 2))
            if before - rest < epsilon * before:
                break
            before = rest
    return sorted(found, key=lambda echo: -echo[1])


def em(
    recording: Recording,
    *,
    starts: list[Component] | None = None,
    weights: Array | None = None,
    iterations: int = 30,
) -> list[Component]:
    """Return lag, azimuth and gain of each component by EM-MC (Saqib, Gannot, Jensen 2020).

    With beta = 1 / R and h_{r,m} = g_r s(n - tau_r - eta_m(phi_r)),
    E: x_{r,m} = h_{r,m} + beta (y_m - sum_q h_{q,m});
    M: (tau, phi)_r = argmax sum_m w_m <x_{r,m}(n + eta_m(phi)), s(n - tau)>,
    g_r is that sum over ||s||^2 sum_m w_m.

    Args:
        starts: R components to begin with; one of gain 0 unless given, and then each iteration is
            the same search.
        weights: w_m, one over each microphone's noise variance, shape (M,); 1 unless given.
    """
    components = list(starts or [(float(recording.first), 0.0, 0.0)])
    weights = np.ones(len(recording.samples)) if weights is None else weights
    for _ in range(iterations):
        received = [component(recording, echo) for echo in components]
        rest = (recording.samples - sum(received)) / len(components)
        for r, own in enumerate(received):
            surface = joint(replace(recording, samples=own + rest), weights)
            best, lag = np.unravel_index(surface.argmax(), surface.shape)
            gain = float(surface.max() / (recording.burst @ recording.burst * np.sum(weights)))
            components[r] = (float(recording.first + lag), float(recording.azimuths[best]), gain)
    return components


def component(recording: Recording, echo: Component) -> Array:
    """Return what the microphones record of one echo: g s(n - tau - eta_m(phi)), shape (M, N)."""
    lag, azimuth, gain = echo
    eta = relative(recording.positions, azimuth, rate=recording.rate)
    return np.stack([gain * shift(recording.probe, lag + late) for late in eta])
