"""Geometry of echoes: directions, far-field delays, search windows.

The loudspeaker and the room's mirror sources make everything here a closed form. An echo *from*
direction v reaches microphone m at position p_m earlier than the loudspeaker's place by
p_m . v / c, so

    delay_m = -(p_m . v) / c = -(R/c) sin(psi) cos(theta_m - phi)        for a ring,

and the paper's eta_m (Eq. 3) is delay_m - delay_1, relative to microphone 1.
"""

import math
from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.types import SPEED_OF_SOUND, Array, MicArray, Pose
from echolearn.checks import check, check_choice, check_number, check_whole


def circular_array(*, microphones: int = 6, radius: float = 0.2, offset: float = 0.0) -> MicArray:
    """Place a uniform ring of microphones around the loudspeaker (paper, Eqs. 4 and 5).

    Args:
        microphones: M.
        radius: in m.
        offset: angle of microphone 1 from the robot's heading, in rad (the authors used pi/2).

    Raises:
        BadValue: fewer than 2 microphones, or a radius outside 0.01 to 2 m.
    """
    check_whole("array.microphones", microphones, low=2, high=256)
    check_number("array.radius", radius, low=0.01, high=2.0, unit="m")
    check_number("array.offset", offset, low=-10.0, high=10.0, unit="rad")
    angle = offset + 2 * np.pi * np.arange(microphones) / microphones
    return MicArray(
        radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)
    )


def direction(azimuth: Array | float, elevation: Array | float) -> Array:
    """Return unit vectors, shape (..., 3), for azimuth and elevation from the axis, both in rad."""
    azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
    return np.stack(
        [
            np.sin(elevation) * np.cos(azimuth),
            np.sin(elevation) * np.sin(azimuth),
            np.cos(elevation),
        ],
        axis=-1,
    )


def far_field_delays(array: MicArray, toward: Array, *, speed_of_sound: float) -> Array:
    """Return the delays of plane waves relative to the loudspeaker's place, shape (..., M), in s.

    Args:
        array: M microphones.
        toward: unit vectors of the directions of arrival, shape (..., 3).
        speed_of_sound: in m/s.
    """
    return -(toward @ array.positions.T) / speed_of_sound


def relative_delays(array: MicArray, toward: Array, *, scale: float) -> Array:
    """Return eta_m (Eq. 3): far-field delays relative to microphone 1, shape (..., M), in samples.

    Args:
        array: M microphones.
        toward: unit vectors of the directions of arrival, shape (..., 3).
        scale: samples per metre of path.
    """
    delays = far_field_delays(array, toward, speed_of_sound=1.0)
    return (delays - delays[..., :1]) * scale


def microphone_positions(array: MicArray, pose: Pose) -> Array:
    """Return the microphones in the room's frame, shape (M, 3), in m."""
    return np.asarray(pose.position) + turned(array.positions, pose.heading)


def turned(places: Array, heading: float) -> Array:
    """Return places (..., 3) of the robot's frame as a heading in rad turns them."""
    cos = math.cos(heading)
    sin = math.sin(heading)
    rotation = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    return places @ rotation.T


def wrap(angle: Array | float) -> Array:
    """Return angles in rad wrapped to [-pi, pi)."""
    return (np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi


@dataclass(frozen=True)
class SearchWindow:
    """Where an echo may arrive, given the wall distances of interest.

    Attributes:
        nearest, farthest: wall distances in m (the paper's "1 m to 2 m").
        rule: "general" holds every wall in that range whatever its direction,
            [2 nearest - a, 2 farthest + a] of path, a the distance of microphone 1 from the
            loudspeaker; "authors" is the published MATLAB, round((2 d - a) fs / c), which clips
            far walls opposite microphone 1.
    """

    nearest: float = 1.0
    farthest: float = 2.0
    rule: str = "general"

    def __post_init__(self) -> None:
        check_number("window.nearest", self.nearest, low=0.1, high=100.0, unit="m")
        check_number("window.farthest", self.farthest, low=0.1, high=100.0, unit="m")
        allowed = f"must be below window.farthest={self.farthest} m"
        check(self.nearest < self.farthest, "window.nearest", f"{self.nearest} m", allowed=allowed)
        check_choice("window.rule", self.rule, "general", "authors")

    def lags(
        self, array: MicArray, sample_rate: float, *, speed_of_sound: float = SPEED_OF_SOUND
    ) -> tuple[int, int]:
        """Return the first and last lag of the window, both inclusive, in samples.

        Args:
            array: its first microphone is the reference.
            sample_rate: in Hz.
            speed_of_sound: in m/s.

        Raises:
            BadValue: a nearest wall whose echo could arrive with the emission.
        """
        scale = sample_rate / speed_of_sound
        away = float(np.linalg.norm(array.positions[0]))
        nearest = (2 * self.nearest - away) * scale
        if self.rule == "authors":
            first = round(nearest)
            last = round((2 * self.farthest - away) * scale)
        else:
            # A wall exactly at the edge costs no lag more, whatever rounding makes of it.
            first = math.floor(nearest + 1e-9)
            last = math.ceil((2 * self.farthest + away) * scale - 1e-9)
        allowed = f"must be more than half of {away:g} m, from loudspeaker to microphone 1"
        check(first >= 1, "window.nearest", f"{self.nearest} m", allowed=allowed)
        return first, last
