"""Mirror images: echoes of an array that cannot tell one side of it from the other.

A line of microphones, or an upright plane, hears a wall and its mirror image alike
(`acoustics.arrays.mirror_azimuth`), so each echo is one of two points. As the robot turns, the
points on the wall stay on one line, while those of the image turn with the robot. Lines are fitted
to the points of both sides (`walls.fit_lines`), and of an echo's two points the one is kept whose
line echoes of `MORE` more poses lie on. Its image is taken away, lines are fitted anew to what is
left, and so on until nothing changes. Points whose sides are as good as each other, as on a
straight walk, or that lie on no line, stay undecided.
"""

from dataclasses import replace

import numpy as np

from echolearn.acoustics.arrays import mirror_azimuth
from echolearn.acoustics.bistatic import wall_points
from echolearn.acoustics.geometry import wrap
from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.types import Array, Echoes, EchoMap, MicArray
from echolearn.mapping.mapped_walk import MappedWalk
from echolearn.mapping.walls import WIDTH, fit_lines

MORE = 3
"""Poses by which one side must be ahead: one or two more lie on a line by chance."""


def with_mirror_images(walk: MappedWalk, array: MicArray, *, speed_of_sound: float) -> MappedWalk:
    """Return a walk in which each echo is followed by its mirror image, one of them kept.

    Args:
        walk: its echoes as they were localized, on either side.
        array: the microphones, robot frame.
        speed_of_sound: in m/s.

    Returns:
        The walk with twice as many echoes, or as it is where there are no mirror images.
    """
    axis = mirror_azimuth(array)
    if axis is None or not walk.placed:
        return walk
    echoes = walk.echoes
    azimuth = wrap(2.0 * axis - echoes.azimuth)
    images = wall_points(
        echoes.toa,
        azimuth,
        echoes.elevation,
        position=walk.path[:, None, :2],
        heading=np.array([[pose.heading] for pose in walk.poses]),
        array=array,
        speed_of_sound=speed_of_sound,
    )
    found = walk.map
    points = np.stack([found.points, images.reshape(-1, 2)], axis=1)
    believed = np.asarray(found.kept)
    side = chosen_sides(points, found.poses, index=walk.index, among=walk.shown)
    # Floor and ceiling are on no side: the echo itself is kept.
    side = np.where(walk.sideways, side, 0)
    kept = believed[:, None] & (side[:, None] == np.arange(2))
    undecided = believed & (side < 0)
    return replace(
        walk,
        echoes=_paired(echoes, azimuth),
        map=EchoMap(
            points.reshape(-1, 2),
            found.confidence.repeat(2),
            kept.reshape(-1),
            found.poses.repeat(2, axis=0),
        ),
        undecided=undecided.repeat(2),
    )


def chosen_sides(points: Array, poses: Array, *, index: Array, among: Array) -> Array:
    """Return which of its two points each of K echoes is, 0 or 1; -1 if that is undecided.

    Args:
        points: shape (K, 2, 2), in m; the last axis is x and y.
        poses: places from which they were seen, shape (K, 2), in m.
        index: number of the pose of each echo, shape (K,).
        among: echoes that count, shape (K,), bool; the others stay undecided.
    """
    side = np.full(len(points), -1)
    # Two points at one place are one, whatever lies there.
    apart = np.linalg.norm(points[:, 0] - points[:, 1], axis=1)
    side[among & (apart <= WIDTH)] = 0
    toward = points - poses[:, None]
    toward = toward / np.maximum(np.linalg.norm(toward, axis=2, keepdims=True), 1e-9)
    while True:
        left = among[:, None] & ((side[:, None] < 0) | (side[:, None] == np.arange(2)))
        line, support = _supported(points[left], toward[left], index=np.nonzero(left)[0])
        lines = np.full(left.shape, -1)
        lines[left] = line
        votes = np.zeros(left.shape, dtype=int)
        votes[left] = support
        new = _decided(lines, votes)
        new = np.where((side < 0) & among, new, side)
        if np.array_equal(new, side):
            return side
        side = new


def _decided(lines: Array, votes: Array) -> Array:
    """Return which point of each pair more poses speak for, shape (K,); -1 if neither.

    Args:
        lines: number of the line that each lies on, -1 for none, shape (K, 2).
        votes: poses that speak for it, shape (K, 2).
    """
    ahead = votes[:, 0] - votes[:, 1]
    side = np.where(ahead >= MORE, 0, np.where(ahead <= -MORE, 1, -1))
    # Near the array's axis both are points of one wall.
    one_wall = (lines[:, 0] == lines[:, 1]) & (lines[:, 0] >= 0)
    return np.where(one_wall, 0, side)


def _supported(points: Array, toward: Array, *, index: Array) -> tuple[Array, Array]:
    """Return the number of the line that each point lies on, -1 for none, and its poses, (P,) each.

    Args:
        points: shape (P, 2), in m.
        toward: unit vectors from where the robot stood to each, shape (P, 2).
        index: number of the pose of each, shape (P,).
    """
    line = np.full(len(points), -1)
    support = np.zeros(len(points), dtype=int)
    for number, found in enumerate(fit_lines(points, toward)):
        line[found.members] = number
        support[found.members] = len(np.unique(index[found.members]))
    return line, support


def _paired(echoes: Echoes, azimuth: Array) -> Echoes:
    """Return echoes (P, R), each followed by its mirror image at azimuths (P, R), as (P, 2 R)."""
    doubled = {name: np.repeat(values, 2, axis=1) for name, values in vars(echoes).items()}
    doubled["azimuth"][:, 1::2] = azimuth
    return Echoes(**doubled)


def one_each(walk: MappedWalk, outline: Array) -> EchoMap:
    """Return a map by which its echoes are scored, one point for each.

    Args:
        walk: its echoes, each followed by its mirror image if the array sees such.
        outline: sides of the floor plan, shape (S, 2, 2), in m.

    Returns:
        Of a pair the point that is shown, or else the one nearer to a wall, since it is the echo
        that is true or false.
    """
    found = replace(walk.map, kept=walk.shown)
    if walk.undecided is None:
        return found
    away = distance_to_outline(found.points, outline)
    better = np.where(walk.shown, -1.0, away).reshape(-1, 2).argmin(axis=1)
    chosen = 2 * np.arange(len(better)) + better
    return EchoMap(*(column[chosen] for column in vars(found).values()))
