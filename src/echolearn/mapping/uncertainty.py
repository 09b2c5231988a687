"""How certain walls are: what echoes, rounded to grids, leave of a normal and an offset.

A wall with the normal theta at the offset o is D = o - n(theta) . p away from a robot at p, and its
echo comes from theta. Both are measured: the distance, rounded to that of a lag, and the azimuth,
theta less the heading, rounded to the grid of directions. (An array beside its loudspeaker sees the
echo turn by dphi as the normal turns by dtheta, `bistatic.echo_slopes`: misses of theta are made
misses of phi by that.) What is rounded are true values plus
noise, so of a number x

    P(measured k | x) = F((k + step / 2 - x) / s) - F((k - step / 2 - x) / s),

F the normal distribution. Given the wall, echoes are independent: that those of a robot that stands
still share one error of the grid, and those of one that turns do not, comes out by itself, as does
a heap of points of which only the rays tell a direction. The product over all echoes, summed on a
grid of theta and o that is drawn closer around its mass, gives their means and deviations.

s^2 adds up the error of a pose, independent from one to the next, and the noise of the estimates.
That is not known: candidates lie around the scatter, which few echoes tell badly, and the sum over
them gives few echoes the wide intervals of Student's t. An error that all headings share is summed
over, too.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.special import log_ndtr

from echolearn.acoustics.bistatic import echo_slopes
from echolearn.acoustics.geometry import wrap
from echolearn.acoustics.types import Array
from echolearn.mapping.accuracy import Accuracy
from echolearn.mapping.walls import Line, line_of

NODES = 21
"""Points of the grid along theta and along o."""

REACH = 5.0
"""Standard deviations that the grid reaches to either side."""

HIDDEN = np.array([0.05, 0.15, 0.3])
"""Noise, in steps of a grid, that rounding may hide from the scatter."""

FEW = 50
"""Echoes up to which the scatter may be far from the noise."""

TURNS = 161
"""Points over which an error that all headings share is summed."""


@dataclass(frozen=True)
class Sightings:
    """Echoes of walls and the poses that they were recorded at, n of them.

    Attributes:
        points: of the map, shape (n, 2), in m.
        poses: positions, shape (n, 2), in m.
        headings: shape (n,), in rad.
        position_sd: standard deviation of the poses' coordinates, shape (n,), in m.
        heading_sd: that of the headings, shape (n,), in rad.
    """

    points: Array
    poses: Array
    headings: Array
    position_sd: Array
    heading_sd: Array

    def only(self, members: Array) -> "Sightings":
        """Return some of them."""
        return Sightings(*(values[members] for values in vars(self).values()))

    @property
    def distances(self) -> Array:
        """From the poses to the points, shape (n,), in m."""
        return np.asarray(np.linalg.norm(self.points - self.poses, axis=1))

    @property
    def toward(self) -> Array:
        """Unit vectors from the poses to the points, shape (n, 2)."""
        return (self.points - self.poses) / np.maximum(self.distances, 1e-9)[:, None]


@dataclass(frozen=True)
class _Rounded:
    """Numbers that were measured, rounded to a grid.

    Attributes:
        step: of the grid.
        known: standard deviation of what is known to be noise of each, shape (n,).
        noise: candidates for the standard deviation of all other noise, shape (any,).
    """

    step: float
    known: Array
    noise: Array

    def log_likelihood(self, misses: Array) -> Array:
        """Return the logarithm of the probability of misses (..., n), summed over them: (...).

        Args:
            misses: what was measured minus what a wall would give.
        """
        sums = []
        for noise in self.noise:
            sd = np.hypot(noise, self.known)
            inside = log_ndtr((self.step / 2 - np.abs(misses)) / sd)
            beyond = log_ndtr((-self.step / 2 - np.abs(misses)) / sd)
            ratio = np.exp(np.minimum(beyond - inside, -1e-12))
            sums.append(np.sum(inside + np.log1p(-ratio), axis=-1))
        found: Array = np.logaddexp.reduce(sums, axis=0)
        return found

    def likely(self) -> "_Rounded":
        """Return it with the one candidate that the scatter suggests."""
        return _Rounded(self.step, self.known, self.noise[len(self.noise) // 2, None])


def _rounded(scatter: Array, known: Array, *, step: float, freedom: int) -> _Rounded:
    """Return rounded numbers with candidates for their noise.

    Args:
        scatter: what is left of the measured by a wall that fits them, shape (n,).
        known: standard deviation of what is known to be noise of each, shape (n,).
        step: of the grid.
        freedom: n less the number of what was fitted.
    """
    hidden = HIDDEN * step
    total = np.sqrt(np.sum(scatter**2) / max(freedom, 1))
    if total < 1e-6 * step:
        # All within one cell: that noise has moved none out of it would only seem to tell more.
        return _Rounded(step, known, hidden[:1] / 10)
    # The logarithm of a scatter has about this standard deviation.
    apart = np.linspace(-3.5, 3.5, 7 if freedom < FEW else 3) / np.sqrt(2 * freedom + 1)
    rest = (total * np.exp(apart)) ** 2 - step**2 / 12 - np.mean(known**2)
    seen = np.sqrt(np.maximum(rest, 0.0))
    seen = seen[seen > hidden[-1]]
    hides = total < step or not len(seen)
    return _Rounded(step, known, np.concatenate([hidden, seen]) if hides else seen)


def measured(line: Line, seen: Sightings, *, accuracy: Accuracy) -> Line:
    """Return a line as its echoes place it, and as certain as they make it.

    Args:
        line: as fitted to points.
        seen: these points alone.
        accuracy: of the echoes.
    """
    wall = _Wall.of(line, seen, accuracy=accuracy)
    centre = np.zeros(2)
    width = wall.width
    # The likely noise finds the place, all candidates together tell how far around it.
    for candidate in (wall.likely(), wall, wall):
        place = centre[:, None] + width[:, None] * np.linspace(-1.0, 1.0, NODES)
        mass = candidate.mass(*place)
        shares = np.stack([mass.sum(axis=1), mass.sum(axis=0)])
        centre = (shares * place).sum(axis=1)
        sds = np.sqrt((shares * (place - centre[:, None]) ** 2).sum(axis=1))
        # A mass within one cell of the grid seems to have no width at all.
        width = REACH * np.maximum(sds, width / NODES / 2)

    offsets = wall.offsets(*place)
    offset = float((mass * offsets).sum())
    offset_sd = np.sqrt((mass * (offsets - offset) ** 2).sum())
    # The nodes of this grid see an edge of a cell a tenth too near at worst.
    scale = max(1.0, wall.least_normal_sd / sds[0])
    return line_of(
        seen.points,
        line.members,
        normal=float(wrap(line.normal + centre[0])),
        offset=offset,
        normal_sd=float(scale * sds[0]),
        offset_sd=float(scale * offset_sd),
    )


@dataclass(frozen=True)
class _Wall:
    """The echoes of one wall, and the probability of them, given its normal and its offset.

    Attributes:
        line: about which both are counted: turns of its normal about the middle of the poses, in
            rad, and shifts away from them, in m.
        seen: its echoes.
        accuracy: of them.
        distance: distances from the robot.
        azimuth: azimuths of the echoes.
    """

    line: Line
    seen: Sightings
    accuracy: Accuracy
    distance: _Rounded
    azimuth: _Rounded

    @classmethod
    def of(cls, line: Line, seen: Sightings, *, accuracy: Accuracy) -> "_Wall":
        """Return the wall of a fitted line, with the noise that the scatter suggests.

        Args:
            line: as fitted to points.
            seen: these points alone.
            accuracy: of the echoes.
        """
        none = _Rounded(1.0, np.zeros(1), np.zeros(1))
        wall = cls(line, seen, accuracy, none, none)
        misses = wall.distance_misses(0.0, np.zeros(1))[0]
        turns = wall.azimuth_misses(np.zeros(1))[0]
        # What any other line would leave, too, is scatter.
        columns = np.stack([np.ones(len(misses)), wall.along], axis=1)
        best, _, rank, _ = np.linalg.lstsq(columns, misses, rcond=1e-6)
        distance = _rounded(
            misses - columns @ best,
            seen.position_sd,
            step=accuracy.lag,
            freedom=len(misses) - int(rank),
        )
        azimuth = _rounded(
            turns - turns.mean(),
            seen.heading_sd,
            step=accuracy.azimuth,
            freedom=len(turns) - 1,
        )
        return cls(line, seen, accuracy, distance, azimuth)

    def likely(self) -> "_Wall":
        """Return it with the likely noise only."""
        return replace(self, distance=self.distance.likely(), azimuth=self.azimuth.likely())

    @property
    def along(self) -> Array:
        """Place of each pose along the wall, shape (n,), in m from their middle."""
        tangent = np.array([-np.sin(self.line.normal), np.cos(self.line.normal)])
        return (self.seen.poses - self.seen.poses.mean(axis=0)) @ tangent

    @property
    def least_normal_sd(self) -> float:
        """What a cell of the azimuths leaves if all echoes lie in one, from one place; else 0."""
        alone = self.azimuth.noise[-1] < HIDDEN[0] * self.azimuth.step
        on_the_spot = np.ptp(self.along) < self.accuracy.lag
        return float(self.azimuth.step / np.sqrt(12) if alone and on_the_spot else 0.0)

    @property
    def width(self) -> Array:
        """How far turns and shifts are sought at first, shape (2,): in rad and m."""
        distance, azimuth = self.distance.likely(), self.azimuth.likely()
        count = len(self.along)
        spread = self.distance.step / 2
        variance = (distance.noise**2 + np.mean(distance.known**2) + spread**2) / count
        turn = azimuth.step + azimuth.noise + np.mean(azimuth.known)
        turn = turn + self.accuracy.heading_bias_sd
        extent = max(np.std(self.along), 1e-9)
        by_place = (np.sqrt(variance) + spread) / extent
        return REACH * np.array([min(turn[0], by_place[0]), (np.sqrt(variance) + spread)[0]])

    def offsets(self, turn: Array, shift: Array) -> Array:
        """Return the offsets of lines that are turned and shifted so, (A,) by (V,): (A, V)."""
        middle = self.seen.poses.mean(axis=0)
        normal = np.array([np.cos(self.line.normal), np.sin(self.line.normal)])
        # Turned about the robot, a wall stays as far away as it was heard.
        away = self.line.offset - middle @ normal + shift
        angle = self.line.normal + turn[:, None]
        return np.asarray(middle[0] * np.cos(angle) + middle[1] * np.sin(angle) + away)

    def distance_misses(self, turn: float, shift: Array) -> Array:
        """Return distances less those of lines that are turned and shifted, (V,): (V, n), in m."""
        angle = self.line.normal + turn
        normal = np.array([np.cos(angle), np.sin(angle)])
        offsets = self.offsets(np.array([turn]), shift).T
        return np.asarray(self.seen.distances + self.seen.poses @ normal - offsets)

    def azimuth_misses(self, turn: Array) -> Array:
        """Return azimuths less those of turned lines (A,), shape (A, n), in rad, as seen."""
        x, y = (self.seen.points - self.seen.poses).T
        misses = wrap(np.arctan2(y, x) - self.line.normal - turn[..., None])
        return np.asarray(misses * self._seen_turn)

    @cached_property
    def _seen_turn(self) -> Array | float:
        """What the array sees of a turn of each normal, shape (n,)."""
        array = self.accuracy.array
        if array is None:
            return 1.0
        seen = self.seen
        azimuth = np.arctan2(*seen.toward.T[::-1]) - seen.headings
        slopes = echo_slopes(seen.distances, azimuth, array=array)
        return np.asarray(slopes[1, 1])

    def mass(self, turn: Array, shift: Array) -> Array:
        """Return the shares of turned (A,) and shifted (V,) lines in all probability, (A, V)."""
        by_distance = [
            self.distance.log_likelihood(self.distance_misses(each, shift)) for each in turn
        ]
        total = self._by_azimuth(turn)[:, None] + np.stack(by_distance)
        share: Array = np.exp(total - total.max())
        return share / share.sum()

    def _by_azimuth(self, turn: Array) -> Array:
        """Return the log likelihood of the azimuths of turned lines, (A,)."""
        bias_sd = self.accuracy.heading_bias_sd
        if bias_sd == 0:
            return self.azimuth.log_likelihood(self.azimuth_misses(turn))
        # The azimuths tell the sum of turn and bias, of which the bias is normal.
        sums = np.linspace(turn[0] - 4 * bias_sd, turn[-1] + 4 * bias_sd, TURNS)
        found = self.azimuth.log_likelihood(self.azimuth_misses(sums))
        bias = (sums - turn[:, None]) / bias_sd
        summed: Array = np.logaddexp.reduce(found - bias**2 / 2, axis=1)
        return summed
