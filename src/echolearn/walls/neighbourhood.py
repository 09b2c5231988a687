"""The largest value nearby, along one axis: what `scipy.ndimage.maximum_filter1d` says, sooner.

Maxima of 1, 2, 4, ... neighbours follow from each other, and two of the longest that fit make any
window (van Herk 1992 has the idea): whole arrays at a time, in single precision where they are.
"""

import numpy as np

from echolearn.acoustics.types import Array


def largest_near(values: Array, reach: int, *, axis: int, circular: bool = False) -> Array:
    """Return the largest of the values within `reach` of each along an axis, of the same shape.

    Args:
        values: any shape, floats.
        reach: places on either side.
        axis: along which they are near.
        circular: whether the first follows the last; if not, nothing lies beyond the ends.
    """
    if reach == 0:
        return values
    count = values.shape[axis]
    if circular:
        padded = np.take(values, np.arange(-reach, count + reach) % count, axis=axis)
    else:
        shape = [*values.shape]
        shape[axis] = reach
        beyond = np.full(shape, -np.inf, values.dtype)
        padded = np.concatenate([beyond, values, beyond], axis=axis)

    def part(start: int, stop: int) -> Array:
        """Return the places from one to before another."""
        whole = [slice(None)] * values.ndim
        whole[axis] = slice(start, stop)
        return padded[tuple(whole)]

    width = 2 * reach + 1
    span = 1
    left = count + 2 * reach
    while 2 * span <= width:
        left -= span
        padded = np.maximum(part(0, left), part(span, span + left))
        span *= 2
    return np.maximum(part(0, count), part(width - span, width - span + count))
