"""Images of a source in a room of any outline, those that each microphone hears.

Walls are upright, so an image is one of the plan times one of floor and ceiling:

    d^2 = d2_plan + z2_k,    g = g_plan gz_k.

On the plan beams are followed from the source: what they meet of a side sends back a beam of its
own, from the mirror image. A beam is split wherever what it meets changes, so an image is found for
just the places that hear it, order by order, until its sound comes after the end or is too faint.
Beams depend on the source alone; all microphones share them. A beam is split once for each corner
that it meets, so those of one order grow with the square of the order, and all of them with the
cube of the reach, where sequences of sides would grow as a power. Time grows with the square of the
number of corners, too. What meets a door leaves the room. Corners send nothing back: there is no
diffraction.

Whoever treats orders differently takes `plan_images` order by order: the order of an image is that
of its plan and the |k| of its cell between floor and ceiling (`axis_images`) together. 0 is the
direct path; 1 are the first echoes, each side's, the floor's, the ceiling's.
"""

from collections.abc import Iterator

import numpy as np

from echolearn.acoustics.polygon_room import PolygonRoom
from echolearn.acoustics.types import Array

WINDOW = 2.5e-4
"""m; half the width of the square around the source by whose sides its own sound leaves."""

NUDGE = 1e-8 * np.array([0.81, 0.59])
"""m; by which the source is moved, lest sound that goes just through a corner, as from the middle
of a room, be counted twice or not at all; at 11 kHz an error of -114 dB."""

NOWHERE = -1
"""Side from which the source's own beams come."""


def plan_images(
    room: PolygonRoom,
    source: Array,
    *,
    microphones: Array,
    reflection: Array,
    reach: float,
    faint: float,
) -> Iterator[Array]:
    """Yield the images on the plan, order by order from 0, the direct path.

    Args:
        room: with its walls.
        source: shape (2,), in m; off all walls.
        microphones: shape (M, 2), in m.
        reflection: coefficients of the walls, shape (W,).
        reach: distance beyond which nothing is heard, in m.
        faint: reflection product below which nothing is followed.

    Yields:
        For each image that a microphone hears its number, the squared distance in m^2 and the
        reflection product, shape (any, 3).
    """
    from echolearn.simulation.beam_loops import trace

    sides, walls = room.faces
    # The last one is that of doors.
    gains = np.append(reflection, 0.0)[walls]
    corners, ends = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
    plan = (sides, corners, ends.reshape(-1, 2))
    places = np.ascontiguousarray(microphones)
    beams = _first_beams(source)
    while len(beams):
        beams, heard = trace(beams, plan, gains=gains, microphones=places, limits=(reach, faint))
        yield heard


def plan_axis(images: Array, count: int, *, scale: float) -> Array:
    """Return images on the plan as an axis of `image_loops.responses`, nearest first.

    Args:
        images: number of the microphone, squared distance, reflection product, shape (K, 3).
        count: number M of microphones.
        scale: samples of the grid per m.

    Returns:
        For each microphone squared distances and reflection products, shape (M, 2, most images).
    """
    number = images[:, 0].astype(int)
    order = np.lexsort((images[:, 1], number))
    counts = np.bincount(number, minlength=count)
    # Microphones that hear fewer images have some at the end that nobody reaches.
    axis = np.zeros((count, 2, int(counts.max(initial=1))))
    axis[:, 0] = np.inf
    place = np.arange(len(order)) - np.repeat(np.cumsum(counts) - counts, counts)
    sorted_numbers = number[order]
    axis[sorted_numbers, 0, place] = images[order, 1] * scale**2
    axis[sorted_numbers, 1, place] = images[order, 2]
    return axis


def _first_beams(source: Array) -> Array:
    """Return the four beams by which sound leaves a source (2,), shape (4, 8)."""
    source = source + NUDGE
    corners = source + WINDOW * np.array([[1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]])
    beams = np.empty((4, 8))
    beams[:, :2] = source
    beams[:, 2:4] = corners
    beams[:, 4:6] = np.roll(corners, -1, axis=0)
    beams[:, 6] = 1.0
    beams[:, 7] = NOWHERE
    return beams
