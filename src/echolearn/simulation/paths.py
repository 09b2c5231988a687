"""Paths that know nothing of walls: they are drawn first, and a room around them afterwards.

    wandering      on and on through a rectangle, now to the left, now to the right
    corridor       up and down a passage, weaving a little
    stop_and_go    wandering with long strides, and stops at which the robot only turns

A path that is made from the walls gives them away: who knows only where the robot drove knows where
walls stand (`echolearn.walls.strips`).
"""

import numpy as np

from echolearn.acoustics.types import Array

TURN = 0.25
"""rad by which the rate of turning changes from one pose to the next, in the mean square."""

STEADY = 0.8
"""Share of the rate of turning that is left at the next pose."""

WEAVE = 0.25
"""m by which a way through a corridor swings to either side."""


def wandering(poses: int, *, extent: Array, stride: float, rng: np.random.Generator) -> Array:
    """Return poses that wander through a rectangle, x, y in m and heading in rad, shape (P, 3).

    Args:
        poses: their number P.
        extent: sides of the rectangle, shape (2,), in m; it begins at the origin.
        stride: from one pose to the next, in m.
        rng: draws the path.
    """
    place = rng.uniform(0.0, extent)
    heading = rng.uniform(-np.pi, np.pi)
    rate = 0.0
    found = np.empty((poses, 3))
    for number in range(poses):
        found[number] = (*place, heading)
        rate = STEADY * rate + TURN * rng.standard_normal()
        heading += rate
        ahead = place + stride * np.array([np.cos(heading), np.sin(heading)])
        if not ((ahead >= 0.0) & (ahead <= extent)).all():
            # At the edge it makes for some other place inside.
            toward = rng.uniform(0.0, extent) - place
            heading = float(np.arctan2(toward[1], toward[0]))
            rate = 0.0
            way = min(stride, float(np.linalg.norm(toward)))
            ahead = place + way * np.array([np.cos(heading), np.sin(heading)])
        place = ahead
    return found


def corridor(poses: int, *, extent: Array, stride: float, rng: np.random.Generator) -> Array:
    """Return poses up and down a passage as long as the longer side, as `wandering` does.

    Args:
        poses, extent, stride, rng: as those of `wandering`.
    """
    length = float(extent.max())
    way = rng.uniform(0.0, 2.0 * length) + stride * np.arange(poses)
    back = way % (2.0 * length) > length
    x = np.where(back, 2.0 * length - way % (2.0 * length), way % (2.0 * length))
    wave = 2.0 * np.pi / rng.uniform(2.0, 6.0)
    y = WEAVE * (1.0 + np.sin(wave * way))
    slope = WEAVE * wave * np.cos(wave * way)
    heading = np.arctan2(slope, np.where(back, -1.0, 1.0))
    return np.stack([x, y, heading], axis=1)


def stop_and_go(poses: int, *, extent: Array, stride: float, rng: np.random.Generator) -> Array:
    """Return poses of a robot that stops and turns, then goes on in long strides.

    Args:
        poses, extent, stride, rng: as those of `wandering`.
    """
    path = wandering(poses, extent=extent, stride=stride, rng=rng)
    # Drawn with repetition: what is drawn again is a stop, what is left out a long stride.
    kept = np.sort(rng.integers(poses, size=poses))
    found = path[kept]
    stops = np.append(False, np.diff(kept) == 0)
    found[stops, 2] = rng.uniform(-np.pi, np.pi, int(stops.sum()))
    return found


PATHS = {"wandering": wandering, "corridor": corridor, "stop_and_go": stop_and_go}
"""Ways to draw a path, by name."""
