"""The search for the largest J(tau, phi), on a grid and then between its points.

    J(tau, phi) = sum_m w_m r_m(tau + eta_m(phi))

On the grid every lag of the window meets every direction in one product of spectra
(`correlations.steered_response`). Then Newton's steps climb to the summit: with d_m = tau +
eta_m(phi),

    dJ/dtau = sum w r'(d_m),    dJ/dphi = sum w r'(d_m) eta_m',    and so on for the second ones,

where r' and r'' are exact derivatives of the band-limited r_m. A climb that leaves its cell of the
grid is cut short, and one that does not end higher is undone. (In noise that microphones share J is
climbed and J / sqrt(E) compared: E hardly changes within a cell.) The grid is always searched first
and whole: refining the one best point costs a hundredth of refining before choosing.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from scipy import fft

from echolearn.acoustics.arrays import tells_up
from echolearn.acoustics.geometry import direction, relative_delays
from echolearn.acoustics.types import Array, MicArray
from echolearn.localization.beamforming import direction_grid
from echolearn.localization.correlations import PAD, derivatives, echo_model, steered_response
from echolearn.localization.matched_filter import MatchedFilter, check_extent
from echolearn.localization.spatial import Spatial

STEPS = 5
"""Newton's steps; from within half a cell, three suffice."""

FINER = 4
"""Points per lag at which whitened recordings of one microphone are searched."""

FINER_JOINT = 2
"""The same of all microphones, where a crest that one has missed is met at another, and of arrays
so small that all miss it together."""

SMALL = 8.0
"""Samples from the centre of an array to its farthest microphone below which a lag and a direction
are hardly told apart, 12 cm at 22 050 Hz: the grid is finer, and a climb may leave its cell."""

Place = tuple[Array, Array, Array]
"""Lag in samples after the window's first, azimuth and elevation in rad: each (B,)."""


class Peak(NamedTuple):
    """One echo of each observation, every field (B,).

    Attributes:
        lag: of arrival at microphone 1, in samples after the window's first lag.
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
        view: matched filters of the recordings.
        array: the first M of their microphones, which are searched.
        directions: azimuths and elevations of the grid, each of shape (A,), in rad.
        weights: weights of the microphones, shape (B, M).
        refine: whether to climb between the points of the grid.
        finer: points of the grid per lag; one may miss a crest of a whitened echo between two
            samples and take a side lobe.
        spatial: noise that microphones share; then the correlations are weighted by it, weights 1,
            and J / sqrt(E) is searched.
        elevations: size of the grid of elevations, 1 for the level plane and its axis.
    """

    view: MatchedFilter
    array: MicArray
    directions: tuple[Array, Array]
    weights: Array
    refine: bool
    finer: int
    spatial: Spatial | None = None
    elevations: int = 1

    @property
    def padded(self) -> Array:
        """Correlations of its microphones, shape (B, M, L + 2 PAD)."""
        return self.view.padded[:, : len(self.array)]

    def __call__(self, padded: Array | None = None) -> Peak:
        """Return the largest J inside the window.

        Args:
            padded: correlations, shape (B, M, L + 2 PAD); those of the view unless given.
        """
        weighted = (self.padded if padded is None else padded) * self.weights[..., None]
        # The view's own J serves other localizers and the features too.
        known = padded is None and self.is_plain
        surface = self.view.steered if known else self.grid(weighted)
        if self.spatial is not None:
            strength = self.spatial.grid_strength(*self.directions)
            surface = surface / np.sqrt(strength / self.view.probe_energy)[:, None]

        highest = surface.reshape(len(surface), -1).argmax(axis=-1)
        way, point = np.unravel_index(highest, surface.shape[1:])
        azimuth, elevation = (angle[way] for angle in self.directions)
        place = (point / self.finer, azimuth, elevation)
        if self.refine:
            place = self.climb(weighted, place)
            place = place if self.elevations == 1 else self.tilt(weighted, place)

        # The grid's J is in single precision; the estimate's is not.
        height = self.read(weighted, place).sum(axis=-1)
        return Peak(*place, height / (self.view.probe_energy * self.share(*place[1:])), height)

    def grid(self, weighted: Array) -> Array:
        """Return J of weighted correlations on the grid, shape (B, A, finer * (L - 1) + 1)."""
        surface = steered_response(
            weighted,
            self.array,
            directions=self.directions,
            scale=self.view.scale,
            finer=self.finer,
        )
        return surface[..., PAD * self.finer : 1 - (PAD + 1) * self.finer]

    @property
    def is_plain(self) -> bool:
        """Whether J on the grid is the plain sum over all microphones, a point per lag."""
        whole = len(self.array) == len(self.view.observation.array)
        usual = whole and self.finer == self.elevations == 1
        return usual and bool((self.weights == 1.0).all())

    def only(self, rows: Array) -> "Search":
        """Return the search of some of the observations."""
        return replace(self, weights=self.weights[rows])

    def share(self, azimuth: Array, elevation: Array) -> Array:
        """Return E(phi) / ||s||^2, J of an echo of gain 1: the sum of the weights, (B,) or (A,)."""
        if self.spatial is not None:
            return self.spatial.strength(azimuth, elevation) / self.view.probe_energy
        return np.maximum(self.weights.sum(axis=-1), np.finfo(float).tiny)

    def delays(self, place: Place) -> Array:
        """Return tau + eta_m(phi), in samples after the window's first lag, shape (B, M)."""
        lag, azimuth, elevation = place
        toward = direction(azimuth, elevation)
        return lag[:, None] + relative_delays(self.array, toward, scale=self.view.scale)

    def read(self, padded: Array, place: Place) -> Array:
        """Return r_m(tau + eta_m(phi)) of correlations (B, M, L + 2 PAD), shape (B, M)."""
        return derivatives(fft.rfft(padded), self.delays(place), size=padded.shape[-1])[0]

    def model(self, peak: Peak) -> Array:
        """Return the correlations of echoes: g a(t - tau - eta_m(phi)), (B, M, L + 2 PAD)."""
        delays = self.delays(peak[:3])
        size = self.view.padded.shape[-1]
        if self.spatial is None:
            alone = echo_model(self.view.observation.probe.samples, delays, size=size)
        else:
            alone = self.spatial.model(delays + PAD, size=size)
        return peak.gain[:, None, None] * alone

    def climb(self, weighted: Array, place: Place) -> Place:
        """Return the summits next to points of the grid.

        Args:
            weighted: correlations, shape (B, M, L + 2 PAD).
            place: points of the grid, each (B,).
        """
        size = weighted.shape[-1]
        read = partial(derivatives, fft.rfft(weighted), size=size)
        lag, azimuth, elevation = place
        start = np.stack([lag, azimuth])
        cell = np.array([[1.0], [self.turn]])
        bottom = np.array([[0.0], [-np.inf]])
        top = np.array([[size - 2 * PAD - 1.0], [np.inf]])

        here = start
        for _ in range(STEPS):
            here = here + self.newton(read, here, elevation=elevation)
            # Another summit is not wanted, and one outside the window is no estimate.
            here = np.clip(np.clip(here, start - cell, start + cell), bottom, top)

        before = self._height(read, (*start, elevation))
        after = self._height(read, (*here, elevation))
        # A step from where J is nearly flat may end anywhere.
        lag, azimuth = np.where(after > before, here, start)
        return lag, np.angle(np.exp(1j * azimuth)), elevation

    def tilt(self, weighted: Array, place: Place) -> Place:
        """Return the summits next to places, in elevation too, by parabolas through J.

        Args:
            weighted: correlations, shape (B, M, L + 2 PAD).
            place: each (B,).
        """
        read = partial(derivatives, fft.rfft(weighted), size=weighted.shape[-1])
        top = np.pi if tells_up(self.array) else np.pi / 2
        for width in (top / self.elevations / 2, top / self.elevations / 8):
            lag, azimuth, elevation = place
            below, here, above = (
                self._height(read, (lag, azimuth, elevation + turn))
                for turn in (-width, 0.0, width)
            )
            bend = 2 * (below - 2 * here + above)
            concave = bend < 0
            move = np.where(concave, (below - above) / np.where(concave, bend, 1.0), 0.0)
            move = width * np.clip(move, -1.0, 1.0)
            moved = self.climb(weighted, (lag, azimuth, np.clip(elevation + move, 0.0, top)))
            # A step from where J is nearly flat may end anywhere.
            higher = self._height(read, moved) > here
            pairs = zip(moved, place, strict=True)
            lag, azimuth, elevation = (np.where(higher, new, old) for new, old in pairs)
            place = (lag, azimuth, elevation)
        return place

    @property
    def turn(self) -> float:
        """How far a climb may turn: a cell of the grid, of a small array as far as a lag does."""
        cell = 2 * np.pi / (self.view.azimuths if len(self.directions[0]) > 1 else 1)
        reach = self.array.reach * self.view.scale
        # Half a lag beside the true one, its best direction may be several cells beside, too.
        return max(cell, 1.0 / reach) if 0 < reach < SMALL else cell

    def _height(self, read: Callable[[Array], Array], place: Place) -> Array:
        """Return J, or J / sqrt(E) in noise that microphones share, shape (B,)."""
        height = read(self.delays(place))[0].sum(axis=-1)
        return height if self.spatial is None else height / np.sqrt(self.share(*place[1:]))

    def newton(self, read: Callable[[Array], Array], here: Array, *, elevation: Array) -> Array:
        """Return Newton's step towards the summit of J, shape (2, B); 0 where J is not concave.

        Args:
            read: correlations and their derivatives at delays (B, M), shape (3, B, M).
            here: lags and azimuths, shape (2, B).
            elevation: shape (B,), in rad.
        """
        lag, azimuth = here
        _, slope, bend = read(self.delays((lag, azimuth, elevation)))
        turn, swing = self.turning(azimuth, elevation)
        rise = np.stack([slope.sum(axis=-1), (slope * turn).sum(axis=-1)])

        # On the axis every azimuth is the same, and the matrix of second derivatives singular.
        flat = (turn == 0).all(axis=-1)
        along = bend.sum(axis=-1)
        across = (bend * turn).sum(axis=-1)
        around = np.where(flat, -1.0, (bend * turn**2 + slope * swing).sum(axis=-1))
        determinant = along * around - across**2
        concave = (along < 0) & (determinant > 0)
        step = np.stack([around * rise[0] - across * rise[1], along * rise[1] - across * rise[0]])
        return np.where(concave, -step / np.where(concave, determinant, 1.0), 0.0)

    def turning(self, azimuth: Array, elevation: Array) -> tuple[Array, Array]:
        """Return both derivatives of eta_m by the azimuth, in samples per rad, each (B, M)."""
        positions = (self.array.positions - self.array.positions[0]) * self.view.scale
        level = np.where(np.sin(elevation) < 1e-9, 0.0, np.sin(elevation))[:, None]
        ahead = direction(azimuth, np.pi / 2)
        aside = direction(azimuth + np.pi / 2, np.pi / 2)
        return -(aside @ positions.T) * level, (ahead @ positions.T) * level


def joint_search(
    matched: MatchedFilter,
    *,
    weights: Array | None = None,
    refine: bool = True,
    spatial: Spatial | None = None,
    elevations: int = 1,
) -> Search:
    """Return the search of J over all microphones.

    Args:
        matched: recordings.
        weights: of the microphones, shape (B, M); 1, and 0 for silent ones, unless given.
        refine: climb between the points of the grid.
        spatial: noise that microphones share, which has weighted the recordings.
        elevations: size of the grid of elevations, 1 for the level plane and its axis.
    """
    check_extent(matched)
    if weights is None:
        weights = (~matched.silent).astype(float)
    array = matched.observation.array
    finer = FINER_JOINT if matched.white or array.reach * matched.scale < SMALL else 1
    directions = matched.directions
    if elevations > 1:
        # The poles besides, which the plane's directions already have.
        axis = directions[1][matched.azimuths :]
        grid = direction_grid(matched.azimuths, elevations, below=tells_up(array))
        directions = (np.append(grid[0], np.zeros(len(axis))), np.append(grid[1], axis))
    return Search(matched, array, directions, weights, refine, finer, spatial, elevations)


def reference_search(matched: MatchedFilter, *, refine: bool = True) -> Search:
    """Return the search of r_1, the matched filter of microphone 1 alone."""
    alone = MicArray(matched.observation.array.positions[:1])
    anywhere = np.zeros(1)
    weights = np.ones((len(matched.observation.samples), 1))
    finer = FINER if matched.white else 1
    return Search(matched, alone, (anywhere, anywhere), weights, refine, finer)
