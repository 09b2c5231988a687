"""Image sources spread onto an oversampled grid, the fast engine.

A shoebox mirrors the source into one image per cell of a lattice (Allen and Berkley 1979), and
every axis has its own list of squared offsets from the microphone and of reflection products, of
which an image is a triple:

    d^2 = x2_i + y2_j + z2_k,   g = gx_i gy_j gz_k,
    h(n) = sum over images of g / (4 pi d) phi(n - d fs / c).

With each list sorted by offset, the ball of images within reach is a prefix of z for every prefix
of x and y: none of them is left out, none outside is looked at. (But for images that one axis alone
dims by 180 dB.) How the sum is computed, and its errors, are in `simulation.image_loops`.

In a room of any outline the images on its plan take the place of x and y (`simulation.beams`): each
microphone has a list of those that it hears, and z is the axis from floor to ceiling. All images
within reach are summed there, too. What costs time are the beams on the plan; what they do not
know is diffraction around corners.
"""

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from echolearn.acoustics.polygon_room import AnyRoom, PolygonRoom
from echolearn.acoustics.types import Array
from echolearn.simulation.beams import plan_axis, plan_images
from echolearn.simulation.responses import check_placement, response_length

FAINT = 1e-9
"""Least reflection product on one axis; below it floats get denormal and 20 times slower."""


@dataclass(frozen=True)
class Images:
    """Compute responses by spreading images: complete, and far faster than `Pyroom`."""

    def __call__(
        self,
        room: AnyRoom,
        source: Array,
        *,
        microphones: Array,
        sample_rate: float,
        speed_of_sound: float,
    ) -> Array:
        """Return responses, shape (M, K); arguments as those of `simulation.scene.Responder`."""
        from echolearn.simulation import image_loops

        check_placement(
            room,
            source,
            microphones=microphones,
            sample_rate=sample_rate,
            speed_of_sound=speed_of_sound,
        )
        length = response_length(room, sample_rate)

        # All lengths in samples of the grid, which has twice the rate.
        scale = 2 * sample_rate / speed_of_sound
        reach = 2.0 * (length + image_loops.REACH)
        reflection = room.reflection(speed_of_sound)
        axes = lattice(
            room, source, microphones=microphones, scale=scale, reflection=reflection, reach=reach
        )
        response = image_loops.responses(axes, length, reach=reach)
        return np.multiply(response, scale / (4 * np.pi), dtype=np.float64)


def lattice(
    room: AnyRoom,
    source: Array,
    *,
    microphones: Array,
    scale: float,
    reflection: Array,
    reach: float,
) -> tuple[Array, Array, Array]:
    """Return the images along each axis of a room, longest side first, as `axis_images` has them.

    Of a room that is no box the first axis has one image, the second those on the plan.

    Args:
        room: with its walls.
        source: shape (3,), in m.
        microphones: shape (M, 3), in m.
        scale: samples of the grid per m.
        reflection: coefficients of the walls, shape (W,).
        reach: largest distance of interest, in samples of the grid.
    """
    if isinstance(room, PolygonRoom):
        return _plan_and_height(
            room,
            np.asarray(source, dtype=float),
            microphones=np.asarray(microphones, dtype=float),
            scale=scale,
            reflection=reflection,
            reach=reach,
        )
    size = scale * np.array(room.size)
    walls = reflection.reshape(3, 2)
    origin = scale * np.asarray(source, dtype=float)
    places = scale * np.asarray(microphones, dtype=float)

    # The innermost loop is the one that is fast: it gets the shortest side, with most images.
    x, y, z = (
        axis_images(size[i], walls[i], source=origin[i], microphones=places[:, i], reach=reach)
        for i in np.argsort(-size, kind="stable")
    )
    return x, y, z


def _plan_and_height(
    room: PolygonRoom,
    source: Array,
    *,
    microphones: Array,
    scale: float,
    reflection: Array,
    reach: float,
) -> tuple[Array, Array, Array]:
    """Return the images in a room of any outline: one, those on its plan, floor and ceiling.

    Args:
        room: the room.
        source: shape (3,), in m.
        microphones: shape (M, 3), in m.
        scale: samples of the grid per m.
        reflection: coefficients of the walls, shape (W,).
        reach: largest distance of interest, in samples of the grid.
    """
    count = len(microphones)
    orders = plan_images(
        room,
        source[:2],
        microphones=microphones[:, :2],
        reflection=reflection,
        reach=reach / scale,
        faint=FAINT,
    )
    plan = plan_axis(np.concatenate(list(orders)), count, scale=scale)
    upright = axis_images(
        scale * room.height,
        reflection[len(room.corners) :][:2],
        source=scale * source[2],
        microphones=scale * microphones[:, 2],
        reach=reach,
    )
    nothing = np.tile(np.array([[0.0], [1.0]]), (count, 1, 1))
    return nothing, plan, upright


def axis_images(
    length: float, reflection: Array, *, source: float, microphones: Array, reach: float
) -> Array:
    """Return the images along one axis that may be within reach of each microphone, nearest first.

    Cell k of the lattice spans k length to (k + 1) length; |k| reflections led to its image, which
    is mirrored for odd k.

    Args:
        length: side of the room, like all lengths here in samples of the grid.
        reflection: coefficients of the lower and the upper wall, shape (2,).
        source: coordinate.
        microphones: coordinates, shape (M,).
        reach: largest distance of interest.

    Returns:
        For each microphone the squared offsets, and the reflection products, shape (M, 2, K).
    """
    lower, upper = reflection.tolist()
    cell, mirrored, product = _audible(lower, upper, last=math.ceil(reach / length))
    position = cell * length + np.where(mirrored, length - source, source)

    square = (position - microphones[:, None]) ** 2
    order = np.argsort(square, axis=1, kind="stable")
    images = np.empty((len(microphones), 2, len(cell)))
    images[:, 0] = square[np.arange(len(square))[:, None], order]
    images[:, 1] = product[order]
    return images


@lru_cache(maxsize=8)
def _audible(lower: float, upper: float, *, last: int) -> tuple[Array, Array, Array]:
    """Return the cells of an axis whose images are not faint: all that a room's places share.

    Args:
        lower, upper: reflection coefficients of its walls.
        last: farthest cell of interest, but for one.

    Returns:
        Numbers of the cells, which are mirrored, and their reflection products, each (K,).
    """
    cell = np.arange(-last - 1, last + 2)
    # Reflections at the two walls alternate; the wall towards the cell comes first.
    low = (np.abs(cell) + (cell < 0)) // 2
    high = (np.abs(cell) + (cell > 0)) // 2
    product = lower**low * upper**high
    audible = product > FAINT
    return cell[audible], cell[audible] % 2 == 1, product[audible]
