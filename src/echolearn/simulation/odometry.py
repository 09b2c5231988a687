"""What an odometry makes of a path: errors of one kind, in a frame of its own.

    exact    none
    white    each pose for itself: sigma in x and y, sigma / 2 rad (per m of sigma) in heading
    drift    a random walk, an eighth of that per pose
    bias     a heading that turns away evenly with the way, and places that follow it; as large as
             makes their root mean square sigma

The frame is turned and shifted at random: nobody tells a robot where the room's corner is.
"""

import numpy as np

from echolearn.acoustics.types import Array

MODELS = ("exact", "white", "drift", "bias")

PER_POSE = 0.125
"""Share of sigma by which a drifting odometry errs anew at every pose."""

SMALL = 1e-4
"""rad per m; a heading bias so small that errors are proportional to it."""

SHIFT = 5.0
"""m by which a frame may be shifted along each axis."""


def told_poses(path: Array, *, model: str, sigma: float, rng: np.random.Generator) -> Array:
    """Return the poses that an odometry tells, in the frame of the path, shape (P, 3).

    Args:
        path: true x, y in m and heading in rad, shape (P, 3).
        model: one of `MODELS`.
        sigma: size of the errors, in m.
        rng: draws them.
    """
    errors = rng.standard_normal(path.shape) * (sigma, sigma, sigma / 2.0)
    if model == "white":
        return path + errors
    if model == "drift":
        return path + np.cumsum(PER_POSE * errors, axis=0)
    if model == "bias":
        sign = rng.choice([-1.0, 1.0])
        off = _turned_away(path, SMALL)[:, :2] - path[:, :2]
        rms = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
        return _turned_away(path, sign * SMALL * sigma / rms if rms > 0 else 0.0)
    return path.copy()


def in_own_frame(path: Array, *, rng: np.random.Generator) -> Array:
    """Return poses (P, 3) in a frame that is turned and shifted at random."""
    angle = rng.uniform(-np.pi, np.pi)
    return turned_path(path, angle=angle, shift=rng.uniform(-SHIFT, SHIFT, 2))


def turned_path(path: Array, *, angle: float, shift: Array) -> Array:
    """Return poses turned about the origin, then shifted, shape (P, 3).

    Args:
        path: x, y in m and heading in rad, shape (P, 3).
        angle: by which they are turned, in rad.
        shift: shape (2,), in m.
    """
    cos, sin = np.cos(angle), np.sin(angle)
    places = path[:, :2] @ np.array([[cos, sin], [-sin, cos]]) + shift
    return np.column_stack([places, path[:, 2] + angle])


def _turned_away(path: Array, rate: float) -> Array:
    """Return poses whose heading turns away by a rate in rad per m of way, shape (P, 3)."""
    steps = np.diff(path[:, :2], axis=0)
    away = rate * np.append(0.0, np.cumsum(np.linalg.norm(steps, axis=1)))
    # Each step is taken in the direction that the robot believes to have.
    turned = np.exp(1j * away[1:]) * (steps[:, 0] + 1j * steps[:, 1])
    places = path[0, 0] + 1j * path[0, 1] + np.append(0.0, np.cumsum(turned))
    return np.column_stack([places.real, places.imag, path[:, 2] + away])
