"""What a robot heard along a walk, steered to the mirror images of its loudspeaker.

A wall in the plane is the line n . x = rho with the unit normal n = (cos theta, sin theta), which
points from the robot to the wall. From pose p, at x_p with the heading h_p, it lies

    D_p = rho - n . x_p

away. Its echo seems to come from the loudspeaker's mirror image 2 D_p n, so that microphone m, at
q_m from the loudspeaker, hears it |2 D_p n - q_m| / c after the emission. The walk's response there
is the sum of the matched filters r_m(tau) = sum_n y_m(n + tau) s(n) at exactly these times,

    J_p(n, D) = sum_m r_m(|2 D n - q_m| / c),

the steered matched filter of `localization.methods.joint` without its plane wave, which is 5 mm off
at 1 m. It holds for any array, wherever its middle is. Every J is told in units of its pose: over
its root mean square in the window, all directions and distances together.

Matched filters are band-limited: they are interpolated to 1 / `FINER` of a lag by their Fourier
series, and read between by straight lines, which is exact to 0.12 % of a tone at half the sample
rate, and better below.

Axis letters: P poses, M microphones, L lags, A azimuths, D distances, T and R the normals and
offsets of a grid of lines, K hypotheses.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import fft

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import SPEED_OF_SOUND, Array, MicArray
from echolearn.checks import check

FINER = 32
"""Points per lag to which matched filters are interpolated."""

AZIMUTHS = 180
"""Directions of the tabled responses; 2 degrees, as for the localizers."""

MARGIN = 6
"""Lags beyond those that any microphone needs, so that interpolation has neighbours."""


def lags_needed(
    window: SearchWindow, array: MicArray, *, sample_rate: float, speed_of_sound: float
) -> tuple[int, int]:
    """Return the first and the last lag that responses in a window read, both inclusive.

    Args:
        window: distances of walls in m.
        array: whose microphones lie around the loudspeaker.
        sample_rate: in Hz.
        speed_of_sound: in m/s.
    """
    scale = sample_rate / speed_of_sound
    first = math.floor((2.0 * window.nearest - array.radius) * scale) - MARGIN
    last = math.ceil((2.0 * window.farthest + array.radius) * scale) + MARGIN
    return max(first, 0), last


@dataclass(frozen=True, eq=False)
class HeardWalk:
    """All that is known of a walk: matched filters, and where the odometry believed to be.

    Attributes:
        outputs: matched filters r_m over the lags that `lags_needed` returns, shape (P, M, L); the
            scale of each pose is its own.
        poses: x and y of the loudspeaker in m, heading in rad, shape (P, 3), by odometry.
        window: distances of walls that are sought.
        array: what the robot carries.
        sample_rate: in Hz.
        speed_of_sound: in m/s.
    """

    outputs: Array
    poses: Array
    window: SearchWindow
    array: MicArray
    sample_rate: float
    speed_of_sound: float = SPEED_OF_SOUND

    def __post_init__(self) -> None:
        about = {"sample_rate": self.sample_rate, "speed_of_sound": self.speed_of_sound}
        first, last = lags_needed(self.window, self.array, **about)
        shape = (len(self.poses), len(self.array), last - first + 1)
        allowed = f"must be {shape}: poses, microphones, lags {first} to {last}"
        check(self.outputs.shape == shape, "walk.outputs", self.outputs.shape, allowed=allowed)
        fine = self.poses.shape[1:] == (3,) and bool(np.isfinite(self.poses).all())
        allowed = "must be finite, shape (P, 3): x, y in m, heading in rad"
        check(fine, "walk.poses", self.poses.shape, allowed=allowed)
        object.__setattr__(self, "_first", first)

    @property
    def scale(self) -> float:
        """Lags per metre of path."""
        return self.sample_rate / self.speed_of_sound

    @property
    def first(self) -> int:
        """Lag of the first output."""
        return int(vars(self)["_first"])

    @property
    def step(self) -> float:
        """Distance of a wall that one lag stands for, in m: sound goes there and back."""
        return 0.5 / self.scale

    @cached_property
    def distances(self) -> Array:
        """Distances of the tabled responses, one lag apart, shape (D,), in m."""
        span = self.window.farthest - self.window.nearest
        return self.window.nearest + self.step * np.arange(math.floor(span / self.step + 1e-9) + 1)

    @cached_property
    def azimuths(self) -> Array:
        """Directions of the tabled responses in the robot's frame, shape (A,), in rad."""
        return -np.pi + 2.0 * np.pi / AZIMUTHS * np.arange(AZIMUTHS)

    @cached_property
    def fine(self) -> Array:
        """Matched filters at `FINER` points per lag, in units of J, shape (P, M, F), float32."""
        fine = _finer(self.outputs.astype(np.float64)).astype(np.float32)
        table = tabled(fine, self._lags(self.azimuths[:, None], self.distances))
        rms = np.sqrt(np.mean(np.square(table), axis=(1, 2)))
        # A silent pose tells nothing, of any wall.
        return fine / np.where(rms > 0, rms, 1.0)[:, None, None]

    @cached_property
    def responses(self) -> Array:
        """J over all directions and distances of the tables, shape (P, A, D), float32."""
        return tabled(self.fine, self._lags(self.azimuths[:, None], self.distances))

    def strongest(self) -> tuple[Array, Array]:
        """Return the point of each pose's largest J, and the unit vector toward it, (P, 2) each."""
        flat = self.responses.reshape(len(self.poses), -1).argmax(axis=1)
        azimuth, distance = np.unravel_index(flat, self.responses.shape[1:])
        angle = self.poses[:, 2] + self.azimuths[azimuth]
        toward = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return self.poses[:, :2] + self.distances[distance][:, None] * toward, toward

    def seen(self, theta: Array, rho: Array) -> tuple[Array, Array, Array]:
        """Return how poses have lines (K,): directions, distances, in the window; each (K, P).

        Directions are those of the normals in the robot's frame, in rad, distances in m.
        """
        normals = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
        distance = rho[:, None] - normals @ self.poses[:, :2].T
        # The edges belong to the window, whatever rounding makes of them.
        inside = (distance >= self.window.nearest - 1e-9) & (
            distance <= self.window.farthest + 1e-9
        )
        return theta[:, None] - self.poses[:, 2], distance, inside

    def at(self, *, pose: Array, azimuth: Array, distance: Array) -> Array:
        """Return J of some poses at any directions and distances, all three of one shape.

        Args:
            pose: number of the pose.
            azimuth: of the wall's normal in the robot's frame, in rad.
            distance: from the loudspeaker to the wall, in m, within the window.
        """
        pose, azimuth, distance = np.broadcast_arrays(pose, azimuth, distance)
        whole, part = np.divmod(self._lags(azimuth, distance), 1.0)
        index = np.clip(whole.astype(int), 0, self.fine.shape[-1] - 2)
        total = np.zeros(pose.shape)
        # Microphone by microphone: all places of all at once would not fit into memory.
        for number in range(len(self.array)):
            here = index[number]
            low = self.fine[pose, number, here]
            total += low + part[number] * (self.fine[pose, number, here + 1] - low)
        return total

    def _lags(self, azimuth: Array, distance: Array) -> Array:
        """Return where an image is heard in `fine`, for each microphone: shape (M, ...)."""
        places = self.array.positions.reshape(-1, 3, *[1] * np.ndim(azimuth))
        toward = places[:, 0] * np.cos(azimuth) + places[:, 1] * np.sin(azimuth)
        square = (places**2).sum(axis=1)
        way = np.sqrt(4.0 * distance * (distance - toward) + square)
        return (way * self.scale - self.first) * FINER


def _finer(outputs: Array) -> Array:
    """Return outputs (..., L) at `FINER` points per lag, shape (..., FINER * L)."""
    spectrum = fft.rfft(outputs)
    if outputs.shape[-1] % 2 == 0:
        # In the longer series the Nyquist bin stands for a positive and a negative frequency.
        spectrum[..., -1] /= 2.0
    return fft.irfft(spectrum, FINER * outputs.shape[-1]) * FINER


def tabled(fine: Array, lags: Array) -> Array:
    """Return sums over microphones read at the same lags for every pose, shape (P, ...), float32.

    Args:
        fine: matched filters, shape (P, M, F).
        lags: where to read each, shape (M, ...).
    """
    whole, part = np.divmod(lags.astype(np.float32), np.float32(1.0))
    index = whole.astype(np.intp)
    table = np.zeros((len(fine), *lags.shape[1:]), np.float32)
    for outputs, total in zip(fine, table, strict=True):
        for row, here, between in zip(outputs, index, part, strict=True):
            low = row[here]
            total += low + between * (row[here + 1] - low)
    return table
