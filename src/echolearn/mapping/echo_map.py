"""The map that echoes leave: points, and the belief in each.

A map point is the pose plus the wall distance along the echo's direction (`geometry.wall_points`).
Filtering (`evaluation.metrics.kept`) keeps those that are believed enough.
"""

import math
from collections.abc import Sequence

import numpy as np

from echolearn.acoustics.geometry import wall_points
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
        poses: where each was heard.
        array: its first microphone is the reference of the TOAs.
        confidence: belief in each echo, shaped like the echoes, 0 to 1; 1 unless given.
        speed_of_sound: in m/s.

    Returns:
        P * R points, pose by pose, all kept; `poses` repeats each pose's position for its R points.

    Raises:
        BadValue: echoes, poses and confidence of different numbers, or a confidence outside 0 to 1.
    """
    shape = np.shape(echoes.toa)
    check(
        shape[:1] == (len(poses),),
        "echoes.toa",
        shape,
        allowed=f"one row for each of {len(poses)} poses",
    )
    toa = np.reshape(echoes.toa, (len(poses), math.prod(shape[1:])))
    believed = (
        np.ones(toa.size) if confidence is None else np.asarray(confidence, dtype=float).reshape(-1)
    )
    check(
        len(believed) == toa.size,
        "confidence",
        believed.shape,
        allowed=f"one value for each of {toa.size} echoes",
    )
    inside = bool(((believed >= 0) & (believed <= 1)).all())
    check(
        inside,
        "confidence",
        believed,
        allowed="from 0 to 1",
        hint="was a logit given for a confidence?",
    )
    where = np.array([pose.position[:2] for pose in poses], dtype=float).reshape(-1, 1, 2)
    points = wall_points(
        toa,
        np.reshape(echoes.azimuth, toa.shape),
        np.reshape(echoes.elevation, toa.shape),
        position=where,
        heading=np.array([pose.heading for pose in poses])[:, None],
        array=array,
        speed_of_sound=speed_of_sound,
    )
    seen_from = np.broadcast_to(where, points.shape).reshape(-1, 2).copy()
    return EchoMap(points.reshape(-1, 2), believed, np.ones(toa.size, dtype=bool), seen_from)
