"""Wall hypotheses, and the names of the columns that describe them."""

from dataclasses import dataclass

from echolearn.acoustics.types import Array

SOUND = (
    "evidence_exact",
    "evidence_2",
    "evidence_6",
    "evidence_12",
    "strength",
    "relative",
    "above_3",
    "above_4",
    "median",
    "quartile",
    "profile_peak",
    "profile_offset",
    "profile_contrast",
    "beside_contrast",
    "halves",
)
"""Columns of sound alone, in the order of `strips.sound_columns`."""

GEOMETRY = (
    "poses",
    "share_of_walk",
    "distance_mean",
    "distance_sd",
    "distance_least",
    "distance_most",
    "blank",
    "length",
    "gap",
    "step_mean",
    "beyond",
)
"""Columns of everything but the sound, in the order of `strips.geometry_columns`."""


@dataclass(frozen=True)
class Hypotheses:
    """Lines on which walls may lie, those with the most evidence first.

    Attributes:
        theta: directions of the normals, from the robot to the wall, shape (K,), in rad.
        rho: offsets along them from the origin of the poses, shape (K,), in m.
        strength: evidence in units of the walk's `hypotheses.REFERENCE`-th peak, shape (K,).
    """

    theta: Array
    rho: Array
    strength: Array

    def __len__(self) -> int:
        return len(self.theta)

    def part(self, which: Array) -> "Hypotheses":
        """Return some of them, by number or by a mask."""
        return Hypotheses(self.theta[which], self.rho[which], self.strength[which])
