"""The map that echoes leave: points, and the belief in each.

A map point is the pose plus the wall distance along the echo's direction (`bistatic.wall_points`).
Filtering (`evaluation.metrics.kept`) keeps those that are believed enough.
"""

import math
from collections.abc import Sequence

import numpy as np

from echolearn.acoustics.bistatic import wall_points
from echolearn.acoustics.types import SPEED_OF_SOUND, Array, Echoes, EchoMap, MicArray, Pose
from echolearn.checks import check


def echo_map(
    echoes: Echoes,
    poses: Sequence[Pose],
    *,
    array: MicArray,
    confidence: Array | None = None,
    speed_of_sound: float = SPEED_OF_SOUND,
) -> EchoMap:
    """Place the echoes of P poses on the map.

    Args:
        echoes: fields of shape (P,) or (P, R), robot frame.
        poses: poses at which they were recorded.
        array: its first microphone is the reference of the TOAs.
        confidence: belief in each echo, shaped like the echoes, 0 to 1; 1 unless given.
        speed_of_sound: in m/s.

    Returns:
        P * R points, pose by pose, all kept; `poses` repeats each pose's position for its R points.

    Raises:
        BadValue: echoes, poses and confidence of different numbers, or a confidence outside 0 to 1.
    """
    count, *rest = np.shape(echoes.toa)
    allowed = f"must have one row for each of {len(poses)} poses"
    check(count == len(poses), "echoes.toa", f"shape {(count, *rest)}", allowed=allowed)
    shape = (count, math.prod(rest))

    position = np.array([pose.position[:2] for pose in poses], dtype=float).reshape(-1, 1, 2)
    heading = np.array([pose.heading for pose in poses]).reshape(-1, 1)
    points = wall_points(
        np.reshape(echoes.toa, shape),
        np.reshape(echoes.azimuth, shape),
        np.reshape(echoes.elevation, shape),
        position=position,
        heading=heading,
        array=array,
        speed_of_sound=speed_of_sound,
    )

    return EchoMap(
        points=points.reshape(-1, 2),
        confidence=_belief(confidence, count=math.prod(shape)),
        kept=np.ones(math.prod(shape), dtype=bool),
        poses=np.broadcast_to(position, points.shape).reshape(-1, 2).copy(),
    )


def _belief(confidence: Array | None, *, count: int) -> Array:
    """Return the confidences of so many echoes, shape (count,): 1 unless given."""
    if confidence is None:
        return np.ones(count)
    belief = np.asarray(confidence, dtype=float).reshape(-1)
    allowed = f"must have one value for each of {count} echoes"
    check(len(belief) == count, "confidence", f"{len(belief)} values", allowed=allowed)
    # NaN is neither, and so refused.
    inside = bool(((belief >= 0) & (belief <= 1)).all())
    hint = "was a logit given for a confidence?"
    check(inside, "confidence", belief, allowed="must be from 0 to 1", hint=hint)
    return belief
