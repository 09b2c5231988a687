"""What is derived from a set's records when it is read: a label, and the candidates of a pose.

The label `time_and_direction` comes from what they say of the truth.

An echo is true if it arrives within 10 samples of a wall's echo *and* from within 10 degrees of it
(`evaluation.matching.agree`). Sets of before need not be made again: a record has the room, the
robot's pose in it, and the time of each wall's echo at microphone 1, and the wall's mirror image of
the loudspeaker gives its direction. That is seen from the loudspeaker, in a box; sets of other
rooms, or whose microphones have another middle, hold the label as a column of their own. What the
array cannot tell apart counts as one; manifests of before do not tell it, and then it tells all.

The tensor `candidates` of an echo is made of the columns of all echoes of its observation, as it is
on a robot (`localization.candidates`).
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from echolearn.acoustics.geometry import wrap
from echolearn.acoustics.types import Array, MicArray, Truth
from echolearn.evaluation.matching import TOA_TOLERANCE_SAMPLES, UNMATCHED, agree
from echolearn.localization.candidates import NEEDED, candidates

NAME = "time_and_direction"


def time_and_direction(
    gather: Callable[[str], Array],
    plan: Mapping[str, Any],
    *,
    several: bool,
    array: MicArray | None = None,
) -> Array:
    """Return the label of some records, shape (B,), bool.

    Args:
        gather: returns a field of them, shape (B, ...).
        plan: of their set, as its manifest has it.
        several: whether an observation has several echoes, each with the `wall` it is matched to.
        array: what heard them; None tells all directions apart.
    """
    rate = plan["scene"]["probe"]["sample_rate"]
    truth = wall_directions(
        gather("room"), gather("position"), heading=gather("heading"), walls=present(plan)
    )
    toa = gather("truth_toa")[:, : truth.azimuth.shape[1]]
    late = np.abs(gather("toa")[:, None] - toa)
    azimuth, elevation = gather("azimuth")[:, None], gather("elevation")[:, None]
    near = agree(truth, azimuth=azimuth, elevation=elevation, array=array)[:, 0]
    fits = near & (late < TOA_TOLERANCE_SAMPLES / rate)
    if not several:
        return fits.any(axis=1)
    # Of several echoes each wall belongs to one.
    wall = gather("wall")
    own = np.take_along_axis(fits, np.maximum(wall, 0)[:, None], axis=1)[:, 0]
    return own & (wall != UNMATCHED)


def candidates_of(gather: Callable[[str, Array], Array], rows: Array, *, echoes: int) -> Array:
    """Return the tensor `candidates` of some records, shape (B, candidates, K).

    Args:
        gather: returns a field of records, by its name and their numbers.
        rows: numbers of the records, shape (B,).
        echoes: records of each observation, one after the other.
    """
    poses, own = np.divmod(rows, echoes)
    beside = (poses[:, None] * echoes + np.arange(echoes)).ravel()
    columns = {name: gather(name, beside) for name in NEEDED}
    return candidates(columns, echoes=echoes)[np.arange(len(rows)) * echoes + own]


def present(plan: Mapping[str, Any]) -> Array:
    """Return which of the six walls of a plan's rooms reflect, shape (6,), bool."""
    # Plans that draw their rooms draw factors above 0.
    return np.array(plan.get("room", {}).get("walls", [1.0] * 6)) > 0


def wall_directions(room: Array, position: Array, *, heading: Array, walls: Array) -> Truth:
    """Return the directions of walls seen from the loudspeaker, fields (B, W); no times.

    Args:
        room: sizes, shape (B, 3), in m.
        position: of the loudspeaker, shape (B, 3), in m.
        heading: shape (B,), in rad.
        walls: which of the six reflect, shape (6,), bool.
    """
    toward = np.zeros((len(room), 6, 3))
    axes = np.arange(3)
    # The image behind a wall lies as far behind it, along the wall's normal.
    toward[:, 2 * axes, axes] = -2.0 * position
    toward[:, 2 * axes + 1, axes] = 2.0 * (room - position)
    seen = toward[:, walls]
    height = seen[..., 2] / np.linalg.norm(seen, axis=-1)
    return Truth(
        toa=np.full(height.shape, np.nan),
        azimuth=wrap(np.arctan2(seen[..., 1], seen[..., 0]) - heading[:, None]),
        elevation=np.arccos(height),
    )
