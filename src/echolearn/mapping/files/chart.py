"""Map files: writers of one interface, `write(chart) -> {file name: content}`, one module each.

A chart holds everything that was heard on a walk and is the same for all of them. Echoes from the
floor or the ceiling are in it, but not among those that are `drawn`: they lie on the array's axis
and belong to no wall.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from echolearn.acoustics.types import Array, Echoes, EchoMap
from echolearn.mapping.walls import Line, fit_lines

Files = Mapping[str, bytes]


@dataclass(frozen=True)
class Chart:
    """A walk and what was heard on it.

    Attributes:
        name: of the map.
        echoes: fields (P, R).
        map: their P * R points, pose by pose, room frame.
        path: positions of the P poses, shape (P, 3), in m.
        outline: corners of the room, shape (C, 2), in m, or None.
        resolution: of the grid, in m.
        headings: of the P poses, shape (P,), in rad, or None where they are not known.
        numbers: what the poses are called, P unique whole numbers; 0, 1, ... if there are none.
    """

    name: str
    echoes: Echoes
    map: EchoMap
    path: Array
    outline: Array | None = None
    resolution: float = 0.05
    headings: Array | None = None
    numbers: tuple[int, ...] = ()

    @property
    def index(self) -> Array:
        """Row in `path` of the pose of each point, shape (P * R,)."""
        return np.repeat(np.arange(len(self.path)), self.echoes.toa.shape[1])

    @cached_property
    def drawn(self) -> Array:
        """Which points are kept and belong to a wall, shape (P * R,), bool."""
        return np.asarray(self.map.kept) & (np.sin(self.echoes.elevation).reshape(-1) > 0.5)

    @cached_property
    def lines(self) -> list[Line]:
        """Walls that the drawn points suggest."""
        points, poses = self.map.points[self.drawn], self.map.poses[self.drawn]
        reach = np.linalg.norm(points - poses, axis=1, keepdims=True)
        return fit_lines(points, (points - poses) / np.maximum(reach, 1e-9))
