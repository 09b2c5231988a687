"""What is not ideal about one recording: a draw of `realism.Realism`."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.types import Array


@dataclass(frozen=True, eq=False)
class Imperfections:
    """What was drawn for one recording; directions and places are in the robot's frame.

    Attributes:
        drawn: a number of each kind, by the names of `realism.Realism`.
        clusters: what each of six walls makes of a pulse, and then what all further reflections
            together make of it, shape (7, T).
        dulling: share of high frequencies that a reflection leaves, at each wall, shape (6,).
        scatterers: directions, unit vectors (Q, 3).
        ways: share of the way to the wall at which each of them is, shape (Q,).
        facing: direction that the loudspeaker faces, shape (3,).
        offsets: of the microphones from where they should be, shape (M, 3), in m.
        microphones: their responses, shape (M, T).
        loudspeaker: its response, shape (T,).
    """

    drawn: Mapping[str, float]
    clusters: Array
    dulling: Array
    scatterers: Array
    ways: Array
    facing: Array
    offsets: Array
    microphones: Array
    loudspeaker: Array

    def sent(self, toward: Array) -> Array:
        """Return the share of high frequencies that the loudspeaker sends towards (..., 3)."""
        cosine = toward @ self.facing / np.sqrt(np.vecdot(toward, toward))
        return 1.0 - self.drawn["directivity"] * (1.0 - cosine) / 2.0
