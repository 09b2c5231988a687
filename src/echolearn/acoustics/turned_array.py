"""By how much one array is another that was turned about its axis.

The angle follows from the positions p_m and q_m of their microphones, as complex numbers x + i y:

    angle = arg sum_m conj(p_m) q_m

which is the least squares solution of q_m = exp(i angle) p_m (Procrustes in the plane).
"""

import numpy as np

from echolearn.acoustics.types import Array

DISPLACED = 1e-3
"""m by which a microphone of the same array may be elsewhere."""

SAME = 1e-6
"""m within which positions are the same, so that nothing is turned."""


def turn_between(positions: Array, found: Array) -> tuple[float, float]:
    """Return the angle that brings microphones to those found, and the largest distance left.

    Args:
        positions, found: each of shape (M, 3), in m.
    """
    if float(np.abs(positions - found).max()) <= SAME:
        return 0.0, 0.0
    here = positions[:, 0] + 1j * positions[:, 1]
    there = found[:, 0] + 1j * found[:, 1]
    angle = float(np.angle(np.sum(here.conj() * there)))
    across = np.abs(here * np.exp(1j * angle) - there)
    return angle, float(np.hypot(across, positions[:, 2] - found[:, 2]).max())
