"""Image sources spread onto an oversampled grid, the fast engine.

A shoebox mirrors the source into one image per cell of a lattice (Allen and Berkley 1979), and
every axis has its own list of squared offsets from the microphone and of reflection products, of
which an image is a triple:

    d^2 = x2_i + y2_j + z2_k,   g = gx_i gy_j gz_k,   h(n) = sum over images of g / (4 pi d) phi(n - d fs / c).

With each list sorted by offset, the ball of images that are heard is a prefix of z for every prefix
of x and y: none of them is left out, none outside is looked at. (But for images that one axis alone
dims by 180 dB.)

phi is a sinc under a Kaiser window of +-40 samples. Writing it 81 taps at a time is what takes the
time elsewhere; here each image is written with 8 taps, as in the non-uniform FFT (Dutt and Rokhlin
1993; Barnett, Magland and af Klinteberg 2019): onto a grid at 2 fs, with a narrow kernel psi read
from a table. One filter q, whose spectrum is phi / psi, then turns every psi into phi and halves
the rate. As q is short it runs in the time domain: no circular wrap, and the rounding of a loud
echo stays near that echo.

Errors: psi and its table -105 dB, phi against the ideal delay -89 dB up to 0.92 of Nyquist, float32
    sums -130 dB.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from echolearn.acoustics.types import Array, Room
from echolearn.simulation.responses import check_placement, response_length
from echolearn.simulation.rir import machine
from echolearn.simulation.rir.machine import STEPS, TAPS

HALF_WIDTH = 40  # of phi, in samples
REACH = HALF_WIDTH + 4  # half width of q, in samples: dividing by psi widens phi a little
FAINT = 1e-9  # reflection product on one axis; below it floats get denormal and 20 times slower


def kaiser(x: Array, half_width: float, beta: float) -> Array:
    """Return the Kaiser-Bessel bump I0(beta sqrt(1 - (x / half_width)^2)) / I0(beta), 0 outside."""
    height = np.sqrt(np.maximum(1.0 - (x / half_width) ** 2, 0.0))
    return np.where(np.abs(x) <= half_width, np.i0(beta * height) / np.i0(beta), 0.0)


def fractional_delay(t: Array) -> Array:
    """Return phi at `t` samples from its centre: the sinc under a Kaiser window."""
    return np.sinc(t) * kaiser(t, HALF_WIDTH, 9.0)


def spreading_kernel(t: Array) -> Array:
    """Return psi at `t` samples of the grid from its centre."""
    return kaiser(t, TAPS / 2, 17.0)


@lru_cache
def kernel_table() -> Array:
    """Return psi for each step of the fractional delay, shape (STEPS, 2 TAPS): values, then rise to
    the next row.
    """
    fraction = np.arange(STEPS + 1)[:, None] / STEPS
    values = spreading_kernel(np.arange(TAPS) - (TAPS // 2 - 1) - fraction)
    return np.hstack([values[:-1], np.diff(values, axis=0)]).astype(np.float32)


@lru_cache
def correction() -> Array:
    """Return q, shape (4 REACH + 1,), centred: the filter that turns psi into phi."""
    at = np.arange(-512, 512)
    phi, psi = (
        np.fft.fft(np.fft.ifftshift(f)).real
        for f in (fractional_delay(at / 2), spreading_kernel(at))
    )
    q = np.fft.fftshift(np.fft.ifft(phi / psi).real)
    return q[np.abs(at) <= 2 * REACH].astype(np.float32)


def axis_images(
    length: float, reflection: Array, *, source: float, microphones: Array, reach: float
) -> Array:
    """Return the images along one axis that each microphone may hear, nearest first.

    Cell k of the lattice spans k length to (k + 1) length; |k| reflections led to its image, mirrored for odd k.

    Args:
        length: of the room, like all lengths here in samples of the grid.
        reflection: of the lower and the upper wall, shape (2,).
        source: coordinate.
        microphones: coordinates, shape (M,).
        reach: largest distance of interest.

    Returns:
        For each microphone the squared offsets, and the reflection products, shape (M, 2, K).
    """
    last = math.ceil(reach / length) + 1
    cell = np.arange(-last, last + 1)
    position = cell * length + np.where(cell % 2 == 0, source, length - source)
    lower, upper = (np.abs(cell) + (cell < 0)) // 2, (np.abs(cell) + (cell > 0)) // 2
    product = reflection[0] ** lower * reflection[1] ** upper
    square = (position[product > FAINT] - microphones[:, None]) ** 2
    order = np.argsort(square, axis=1, kind="stable")
    return np.stack(
        [np.take_along_axis(square, order, axis=1), product[product > FAINT][order]], axis=1
    )


def grid_length(samples: int) -> int:
    """Return the number of samples of the grid that a response of so many samples is filtered from."""
    return 2 * (samples + 2 * REACH) + TAPS


@dataclass(frozen=True)
class Images:
    """Compute responses by spreading images: complete, and far faster than `Pyroom`."""

    def __call__(
        self,
        room: Room,
        source: Array,
        microphones: Array,
        *,
        sample_rate: float,
        speed_of_sound: float,
    ) -> Array:
        """Return the responses from one source to M microphones.

        Args:
            room: the shoebox; its T60 gives the wall coefficients (Sabine) and the length.
            source: shape (3,), in m.
            microphones: shape (M, 3), in m.
            sample_rate: in Hz.
            speed_of_sound: in m/s.

        Returns:
            Responses of shape (M, round(t60 * sample_rate)), direct path of amplitude 1 / (4 pi d).

        Raises:
            BadValue: what `check_placement` refuses.
        """
        check_placement(
            room, source, microphones, sample_rate=sample_rate, speed_of_sound=speed_of_sound
        )
        response = np.empty((len(microphones), response_length(room, sample_rate)), np.float32)
        scale = 2 * sample_rate / speed_of_sound
        reach = 2.0 * (response.shape[1] + REACH)
        size, reflection = (
            scale * np.array(room.size),
            room.reflection(speed_of_sound).reshape(3, 2),
        )
        points, origin = (
            scale * np.asarray(microphones, dtype=float),
            scale * np.asarray(source, dtype=float),
        )
        axes = [
            axis_images(
                size[i], reflection[i], source=origin[i], microphones=points[:, i], reach=reach
            )
            for i in np.argsort(-size, kind="stable")
        ]
        inputs = [part for axis in axes for part in (axis, axis.shape[-1])]
        filtering, most = (
            (correction(), correction().size, 2 * REACH - TAPS // 2 + 1, reach),
            axes[-1].shape[-1],
        )
        sizes = (
            (2 * grid_length(response.shape[1]), np.float32),
            (2 * most, np.float32),
            (most, np.int32),
        )
        space = (np.empty(size, kind) for size, kind in sizes)
        machine.respond()(response, *response.shape, kernel_table(), *filtering, *inputs, *space)
        return response.astype(np.float64) * (scale / (4 * np.pi))
