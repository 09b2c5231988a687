"""A walk with its echoes and their map: what every writer in `mapping/files` makes its files from.

A writer is a module with one function, `write(walk) -> {file name: content}`. Echoes from the floor
or the ceiling lie on the array's axis and belong to no wall: they are in the map, but not among the
points that are `shown`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from echolearn.acoustics.types import Array, Echoes, EchoMap, Pose
from echolearn.mapping.accuracy import Accuracy
from echolearn.mapping.uncertainty import Sightings, measured
from echolearn.mapping.walls import Line, fit_lines

Files = Mapping[str, bytes]
"""Contents of files by their names, relative to the map's folder."""

BAG = ("bag/bag.mcap", "bag/metadata.yaml")
"""Files that only the writer of bags makes."""

LOWEST_SINE = 0.5
"""Sine of the elevation above which an echo counts as a wall's: 30 degrees off the array's axis."""


@dataclass(frozen=True, eq=False)
class JudgedWalls:
    """Lines that all poses together speak for, which of them are walls, and who heard them.

    Attributes:
        index: number of the pose of each echo, from 0, shape (N,).
        lines: the walls, one line for each stretch of one.
        theta, rho: normals in rad and offsets in m of K lines, the most evidence first.
        strength: evidence, in units of noise in the same walk, shape (K,).
        confidence: belief in each, shape (K,).
        believed: which are walls, shape (K,).
    """

    index: Array
    lines: Sequence[Line]
    theta: Array
    rho: Array
    strength: Array
    confidence: Array
    believed: Array


@dataclass(frozen=True)
class MappedWalk:
    """A walk, the echoes of its recordings, and the map that they leave.

    Attributes:
        echoes: fields (P, R), robot frame; with `judged` (N,).
        map: their P * R or N points, pose by pose, room frame.
        poses: P poses.
        numbers: names of the poses in tables, P whole numbers.
        outline: sides of the floor plan, shape (S, 2, 2), in m, or None where they are not known.
        resolution: side of a cell of the grid, in m.
        accuracy: of the echoes.
        placed: whether echoes can be placed on a map; if not, none of its points is shown.
        undecided: which points are believed, though not on which side of the array they lie, shape
            (P * R,), bool; echoes are then in pairs, each followed by its mirror image
            (`mirrors`). None where the array sees no mirror images.
        judged: walls that were found over all poses; None: those that the points suggest.
    """

    echoes: Echoes
    map: EchoMap
    poses: Sequence[Pose]
    numbers: Sequence[int]
    outline: Array | None = None
    resolution: float = 0.05
    accuracy: Accuracy = field(default_factory=Accuracy)
    placed: bool = True
    undecided: Array | None = None
    judged: JudgedWalls | None = None

    @cached_property
    def path(self) -> Array:
        """Positions of the poses, shape (P, 3), in m."""
        return np.array([pose.position for pose in self.poses], dtype=float)

    @property
    def index(self) -> Array:
        """Number of the pose of each point, from 0, shape (P * R,) or (N,)."""
        if self.judged is not None:
            return self.judged.index
        return np.repeat(np.arange(len(self.poses)), self.echoes.toa.shape[1])

    @property
    def sideways(self) -> Array:
        """Which echoes do not come from the floor or the ceiling, shape (P * R,), bool."""
        return np.sin(self.echoes.elevation).reshape(-1) > LOWEST_SINE

    @cached_property
    def shown(self) -> Array:
        """Which points are kept and belong to a wall, shape (P * R,), bool."""
        return np.asarray(self.map.kept) & self.sideways & self.placed

    @property
    def upright(self) -> Array:
        """Which points are kept and come from floor or ceiling, shape (P * R,), bool."""
        return np.asarray(self.map.kept) & ~self.sideways

    @cached_property
    def lines(self) -> list[Line]:
        """Walls that the shown points suggest, unless they are known otherwise."""
        if self.judged is not None:
            return [*self.judged.lines]
        poses = [self.poses[index] for index in self.index[self.shown].tolist()]
        seen = Sightings(
            points=self.map.points[self.shown],
            poses=self.map.poses[self.shown],
            headings=np.array([pose.heading for pose in poses]),
            position_sd=np.array([pose.position_sd for pose in poses]),
            heading_sd=np.array([pose.heading_sd for pose in poses]),
        )
        found = fit_lines(seen.points, seen.toward)
        return [measured(line, seen.only(line.members), accuracy=self.accuracy) for line in found]
