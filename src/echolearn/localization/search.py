"""The search for the largest J(tau, phi) = sum_m w_m r_m(tau + eta_m(phi)), on a grid and then
between its points.

On the grid every lag of the window meets every direction in one product of spectra
(`beam.steered_response`). Then Newton's steps climb to the summit: with d_m = tau + eta_m(phi),

    dJ/dtau = sum w r'(d_m),    dJ/dphi = sum w r'(d_m) eta_m',    and so on for the second derivatives,

where r' and r'' are exact derivatives of the band-limited r_m. A climb that leaves its cell of the
grid is cut short, and one that does not end higher is undone. (In noise that microphones share J is
climbed and J / sqrt(E) compared: E hardly changes within a cell.) The grid is always searched first
and whole: refining the one best point costs a hundredth of refining before choosing.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft

from echolearn.acoustics.geometry import direction, relative_delays
from echolearn.acoustics.types import Array, MicArray
from echolearn.localization import beamforming
from echolearn.localization.spatial import Spatial

STEPS = 5
"""Newton's steps; from within half a cell, three suffice."""


@dataclass(frozen=True)
class Peak:
    """One echo of each observation, every field (B,).

    Attributes:
        lag: to microphone 1, in samples after the window's first lag.
        azimuth, elevation: in rad.
        gain: amplitude relative to the probe: J / (||s||^2 sum_m w_m).
        height: J.
    """

    lag: Array
    azimuth: Array
    elevation: Array
    gain: Array
    height: Array


@dataclass(frozen=True)
class Search:
    """How J is searched.

    Attributes:
        array: M microphones.
        azimuth, elevation: directions of the grid, shape (A,), in rad.
        scale: samples per metre of path.
        weights: of the microphones, shape (B, M).
        probe_energy: ||s||^2.
        refine: climb between the points of the grid.
        finer: points of the grid per lag. Whitened echoes ring close to half the sample rate, where
            one point per lag may miss a crest between two samples and take a side lobe.
        spatial: noise that microphones share; then the correlations are weighted by it, weights 1,
            and J / sqrt(E) is searched.
    """

    array: MicArray
    azimuth: Array
    elevation: Array
    scale: float
    weights: Array
    probe_energy: float
    refine: bool = True
    finer: int = 1
    spatial: Spatial | None = None

    def __call__(self, padded: Array, surface: Array | None = None) -> Peak:
        """Return the largest J inside the window.

        Args:
            padded: correlations, shape (B, M, L + 2 PAD).
            surface: J on the grid, shape (B, A, L), where it is known already.
        """
        weighted = padded * self.weights[..., None]
        inside = self.grid(weighted) if surface is None else surface
        if self.spatial is not None:
            strength = self.spatial.grid_strength(self.azimuth, self.elevation)
            inside = inside / np.sqrt(strength / self.probe_energy)[:, None]
        best = np.stack(
            np.unravel_index(inside.reshape(len(inside), -1).argmax(axis=-1), inside.shape[1:])
        )
        spot = (best[1] / self.finer, self.azimuth[best[0]], self.elevation[best[0]])
        if self.refine:
            spot = self.climb(fft.rfft(weighted), padded.shape[-1], *spot)
        height = self.read(weighted, *spot).sum(axis=-1)
        return Peak(*spot, height / (self.probe_energy * self.share(*spot[1:])), height)

    def grid(self, weighted: Array) -> Array:
        """Return J of weighted correlations on the grid, inside the window, shape (B, A, finer * (L
        - 1) + 1).
        """
        surface = beamforming.steered_response(
            weighted, self.array, self.azimuth, self.elevation, scale=self.scale, finer=self.finer
        )
        return surface[..., beamforming.PAD * self.finer : 1 - (beamforming.PAD + 1) * self.finer]

    def is_plain(self, microphones: int) -> bool:
        """Tell whether J on the grid is the plain sum over so many microphones, a point per lag."""
        whole = len(self.array) == microphones and bool((self.weights == 1.0).all())
        return whole and self.finer == 1 and self.spatial is None

    def share(self, azimuth: Array, elevation: Array) -> Array:
        """Return E(phi) / ||s||^2 of directions, J of an echo of gain 1: the sum of the weights, shape (B,) or (A,)."""
        if self.spatial is not None:
            return self.spatial.strength(azimuth, elevation) / self.probe_energy
        return np.maximum(self.weights.sum(axis=-1), np.finfo(float).tiny)

    def delays(self, lag: Array, azimuth: Array, elevation: Array) -> Array:
        """Return tau + eta_m(phi) of echoes (B,), in samples after the window's first lag, shape
        (B, M).
        """
        return lag[:, None] + relative_delays(self.array, azimuth, elevation, 1.0) * self.scale

    def read(self, padded: Array, lag: Array, azimuth: Array, elevation: Array) -> Array:
        """Return r_m(tau + eta_m(phi)) of correlations (B, M, L + 2 PAD) at echoes (B,), shape (B,
        M).
        """
        delays = self.delays(lag, azimuth, elevation)
        return derivatives(fft.rfft(padded), padded.shape[-1], delays)[0]

    def climb(
        self, spectrum: Array, size: int, lag: Array, azimuth: Array, elevation: Array
    ) -> tuple[Array, Array, Array]:
        """Return lag, azimuth and elevation of the summits next to points of the grid, each (B,)."""
        start = np.stack([lag, azimuth])
        reach = np.array([[1.0], [2 * np.pi / max(len(self.azimuth) - 1, 1)]])
        bottom, top = (
            np.array([0.0, -np.inf])[:, None],
            np.array([size - 2 * beamforming.PAD - 1.0, np.inf])[:, None],
        )
        here = start
        for _ in range(STEPS):
            here = here + self.newton(spectrum, size, here, elevation)
            here = np.clip(np.clip(here, start - reach, start + reach), bottom, top)
        heights = [
            derivatives(spectrum, size, self.delays(point[0], point[1], elevation))[0].sum(axis=-1)
            / (1.0 if self.spatial is None else np.sqrt(self.share(point[1], elevation)))
            for point in (start, here)
        ]
        lag, azimuth = np.where(heights[1] > heights[0], here, start)
        return lag, np.angle(np.exp(1j * azimuth)), elevation

    def newton(self, spectrum: Array, size: int, here: Array, elevation: Array) -> Array:
        """Return Newton's step towards the summit of J from (lag, azimuth), shape (2, B); 0 where J
        is not concave.
        """
        _, slope, bend = derivatives(spectrum, size, self.delays(here[0], here[1], elevation))
        turn, swing = self.turning(here[1], elevation)
        rise = np.stack([slope.sum(axis=-1), (slope * turn).sum(axis=-1)])
        flat = (turn == 0).all(axis=-1)  # on the axis every azimuth is the same
        along, across = bend.sum(axis=-1), (bend * turn).sum(axis=-1)
        around = np.where(flat, -1.0, (bend * turn**2 + slope * swing).sum(axis=-1))
        determinant = along * around - across**2
        concave = (along < 0) & (determinant > 0)
        safe = np.where(concave, determinant, 1.0)
        step = np.stack([around * rise[0] - across * rise[1], along * rise[1] - across * rise[0]])
        return np.where(concave, -step / safe, 0.0)

    def turning(self, azimuth: Array, elevation: Array) -> tuple[Array, Array]:
        """Return the first and second derivative of eta_m by the azimuth, in samples per rad, shape
        (B, M).
        """
        positions = (self.array.positions - self.array.positions[0]) * self.scale
        level = np.where(np.sin(elevation) < 1e-9, 0.0, np.sin(elevation))[:, None]
        ahead = direction(azimuth, np.pi / 2)
        aside = direction(azimuth + np.pi / 2, np.pi / 2)
        return -(aside @ positions.T) * level, (ahead @ positions.T) * level


def derivatives(spectrum: Array, size: int, delays: Array) -> Array:
    """Return correlations and their first two derivatives at fractional lags, shape (3, B, M).

    Args:
        spectrum: of correlations over `size` lags that begin `PAD` before the window, shape (B, M,
            size // 2 + 1).
        size: number of those lags.
        delays: where to read, in samples after the window's first lag, shape (B, M).
    """
    omega = 2 * np.pi * np.fft.rfftfreq(size)
    count = np.where((omega == 0) | (omega >= np.pi), 1.0, 2.0) / size
    turned = spectrum * np.exp(1j * (delays[..., None] + beamforming.PAD) * omega)
    return np.stack(
        [turned.real @ count, -turned.imag @ (omega * count), -turned.real @ (omega**2 * count)]
    )
