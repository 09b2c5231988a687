"""Walks past walls made by hand: echoes of a flat burst from mirror images, in white noise."""

import numpy as np

from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.walls.walk import HeardWalk, lags_needed

RATE, SPEED = 22050.0, 343.0
RING = circular_array()
WINDOW = SearchWindow()


def heard(lines, poses, *, amplitude=2.0, window=WINDOW, array=RING, seed=0, told=None):
    """Return a walk that hears lines (theta, rho, from, to) in white noise of variance 1.

    A line is heard between its ends, in m along its tangent; `told` are the poses of an odometry.
    """
    first, last = lags_needed(window, array, sample_rate=RATE, speed_of_sound=SPEED)
    rng = np.random.default_rng(seed)
    outputs = rng.standard_normal((len(poses), len(array), last - first + 1))
    for pose, (x, y, heading) in enumerate(poses):
        cos, sin = np.cos(heading), np.sin(heading)
        for theta, rho, low, high in lines:
            normal = np.array([np.cos(theta), np.sin(theta)])
            foot = np.array([-normal[1], normal[0]]) @ (x, y)
            away = rho - normal @ (x, y)
            if not low <= foot <= high or away <= 0:
                continue
            for number, (ahead, left, up) in enumerate(array.positions):
                place = np.array([cos * ahead - sin * left, sin * ahead + cos * left, up])
                way = np.linalg.norm(2.0 * away * np.append(normal, 0.0) - place)
                lags = np.arange(first, last + 1) - way * RATE / SPEED
                outputs[pose, number] += amplitude * np.sinc(lags)
    return HeardWalk(outputs, np.array(poses if told is None else told), window, array, RATE, SPEED)


def wandering(count, *, low=(0.0, 0.0), high=(4.0, 3.0), seed=1):
    """Return poses anywhere in a rectangle, shape (count, 3)."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(low, high, (count, 2))
    return np.column_stack([places, rng.uniform(-np.pi, np.pi, count)])
