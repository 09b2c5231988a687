"""Which directions an array of any shape tells apart.

An array tells directions by the delays p_m . v / c of its microphones, relative to one another. So
of v it sees what lies in the span of p_m - c, c their mean: everything where they fill space; not
the sign across a plane; of a line, two microphones among them, the angle to it alone. Directions
that an array cannot tell apart count as one wherever directions are compared.
"""

from functools import lru_cache

import numpy as np

from echolearn.acoustics.types import Array, MicArray

FLAT = 0.01
"""Spread along an axis, relative to the largest, below which microphones count as not spread."""

UPRIGHT = 0.1
"""Sine of the angle between a line of microphones and the vertical below which it stands upright:
6 degrees."""


@lru_cache(maxsize=64)
def axes(array: MicArray) -> Array:
    """Return the axes along which microphones are spread, widest first, shape (rank, 3)."""
    _, sizes, found = np.linalg.svd(array.positions - array.positions.mean(axis=0))
    kept = found[: len(sizes)][sizes > FLAT * sizes[0]]
    return _exact(kept)


def _exact(vectors: Array) -> Array:
    """Return unit vectors (..., 3) without the rounding of what is 0."""
    cut = np.where(np.abs(vectors) < 1e-9, 0.0, vectors)
    return np.asarray(cut / np.linalg.norm(cut, axis=-1, keepdims=True))


def representative(array: MicArray, toward: Array) -> Array:
    """Return one direction for all that an array cannot tell apart.

    Two directions are as far from one another for the array as these are: across a plane the sign
    is lost, around a line all but the angle to it.

    Args:
        array: the microphones.
        toward: unit vectors, shape (..., 3).

    Returns:
        Unit vectors, shape (..., 3).
    """
    found = axes(array)
    if len(found) == 3:
        return toward
    if not len(found):
        return np.broadcast_to([1.0, 0.0, 0.0], toward.shape)
    if len(found) == 2:
        normal = _upward(_exact(np.cross(*found)))
        below = np.minimum(toward @ normal, 0.0)
        return np.asarray(toward - 2.0 * below[..., None] * normal)
    [line] = found
    aside = _exact(np.cross(line, np.eye(3)[np.abs(line).argmin()]))
    along = toward @ line
    across = np.sqrt(np.maximum(1.0 - along**2, 0.0))
    return np.asarray(along[..., None] * line + across[..., None] * aside)


def _upward(normal: Array) -> Array:
    """Return a normal or its opposite: the one whose largest component is positive."""
    return np.asarray(normal * np.sign(normal[np.abs(normal).argmax()]))


def tells_azimuth(array: MicArray) -> bool:
    """Tell whether an array hears azimuths; microphones one above another, or one alone, do not."""
    found = axes(array)
    return len(found) > 1 or bool((np.hypot(found[:, 0], found[:, 1]) > UPRIGHT).any())


def tells_up(array: MicArray) -> bool:
    """Tell whether an array hears what comes from above otherwise than what comes from below."""
    above = representative(array, np.array([0.0, 0.0, 1.0]))
    below = representative(array, np.array([0.0, 0.0, -1.0]))
    return bool(above @ below < 1.0 - FLAT)


def mirror_azimuth(array: MicArray) -> float | None:
    """Return the azimuth phi of the upright plane across which an array mirrors walls, in rad.

    An upright wall at theta sounds to a line of microphones, two among them, and to an upright
    plane as one at 2 phi - theta would. A level plane takes above for below, which is one place on
    a map. None where walls have no mirror image.
    """
    found = axes(array)
    if not tells_azimuth(array) or len(found) == 3:
        return None
    if len(found) == 1:
        x, y, _ = found[0]
        return float(np.arctan2(y, x))
    x, y, z = np.cross(*found)
    return float(np.arctan2(x, -y)) if abs(z) < UPRIGHT else None


def limits(array: MicArray) -> str:
    """Return in words what an array can and cannot tell apart."""
    found = axes(array)
    if len(found) == 3:
        return "tells all directions apart"
    if not len(found):
        return "one microphone: tells no directions"
    if not tells_azimuth(array):
        return "an upright line: cannot tell azimuths"
    if len(found) == 1:
        shape = "two microphones" if len(array) == 2 else "a line"
        return f"{shape}: cannot tell one side of it from the other, nor up from down"
    level = abs(np.cross(*found)[2])
    if level > 1.0 - FLAT:
        return "a level plane: cannot tell up from down"
    side = "front from back" if level < UPRIGHT else "a direction from its mirror image"
    return f"{'an upright' if level < UPRIGHT else 'a tilted'} plane: cannot tell {side}"
