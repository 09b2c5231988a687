"""Do the echoes of a walk move as its poses do?

A wall stands still, so

    d' = d - s n . (x' - x),   n = (cos theta, sin theta),   theta = a heading + b azimuth + phi

is the distance at which a wall, heard at d from x, is heard from x'. With a = b = s = 1 and phi = 0
many echoes of a sound walk come true at the poses that follow. Where far more do with another sense
of headings (a) or of microphones (b), turned (phi), in another unit (s), or with the poses of
another row, that is what the survey got wrong.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.geometry import wrap
from echolearn.acoustics.types import Array

AFTER = (1, 2, 3, 4)
"""Poses later at which an echo is sought again."""

MOST = 1000
"""Pairs of poses that are compared."""

NEAR = 0.08
TOWARD = np.deg2rad(25)
"""m and rad within which an echo comes true; directions are told to 15 degrees."""

PHASES = 24
FEET = 0.3048
CENTIMETRES = 0.01
TURNS = 2 * np.pi
"""m of a unit of x and y, and rad of one of headings."""

FEWEST = 12
SURE = 2.5
"""Echoes that come true at least if something is wrong, and by how many standard deviations more
than as the survey has it: sound walks reach 0.5."""


class Reading(NamedTuple):
    """How a survey may be meant.

    Attributes:
        sense: a, -1 where headings count clockwise, `TURNS` where they are in turns.
        order: b, -1 where microphones do.
        phi: by which directions are turned, in rad.
        scale: s, metres of a unit of x and y.
        row: 1 where recordings belong to the pose before theirs, -1 to the one after.
    """

    sense: float = 1
    order: int = 1
    phi: float = 0.0
    scale: float = 1.0
    row: int = 0


AS_IT_IS = Reading()


class Heard(NamedTuple):
    """What P recordings hear of walls.

    Attributes:
        places: x, y as the survey has them, shape (P, 2).
        headings: shape (P,).
        distance: of a wall, for each echo, shape (P, E), in m; NaN where none is heard.
        azimuth: shape (P, E), in rad.
    """

    places: Array
    headings: Array
    distance: Array
    azimuth: Array


def inconsistency(heard: Heard) -> str:
    """Return what the echoes of a walk say against its poses; "" if nothing."""
    usual = int(come_true(heard, AS_IT_IS)[0])
    counts = {reading: come_true(heard, reading) for reading in _readings()}
    best = max(counts, key=lambda reading: int(counts[reading].max()))
    most = int(counts[best].max())
    if len(heard.headings) > 1 and not np.ptp(heard.headings):
        ahead = int(come_true(_looking_ahead(heard), AS_IT_IS)[0])
        if ahead > most and _clearly(ahead, usual):
            return (
                f"heading_rad={heard.headings[0]:.3g} at every pose, where {usual} echoes of walls "
                f"move as the poses do, and {ahead} would if the robot looked where it drives: is "
                "it filled in?"
            )
    if not _clearly(most, usual):
        return ""
    phi = wrap(2 * np.pi * int(counts[best].argmax()) / PHASES)
    echoes = f"{usual} echoes of walls move as the poses do, and {most} would"
    return f"{echoes}{_told(best._replace(phi=float(phi)))}"


def _clearly(most: int, usual: int) -> bool:
    """Tell whether so many echoes come true, and so many more than as the survey has it."""
    return most >= FEWEST and most - usual >= SURE * np.sqrt(most)


def _looking_ahead(heard: Heard) -> Heard:
    """Return what is heard by a robot that looks where it drives."""
    x, y = np.gradient(heard.places, axis=0).T
    return heard._replace(headings=np.arctan2(y, x))


def _readings() -> Iterator[Reading]:
    """Yield the ways in which a survey may be meant, the most likely mistakes first."""
    yield AS_IT_IS
    for scale in (FEET, CENTIMETRES):
        yield Reading(scale=scale)
    yield Reading(sense=TURNS)
    for row in (1, -1):
        yield Reading(row=row)
    for sense, order in ((-1, 1), (-1, -1), (1, -1)):
        yield Reading(sense, order)


def _told(reading: Reading) -> str:
    """Return how a survey seems to be meant, and what to ask."""
    degrees = f", turned by about {np.rad2deg(reading.phi):.0f} degrees" if reading.phi else ""
    if reading.scale != 1.0:
        unit = "feet" if reading.scale == FEET else "cm"
        return f" if x_m and y_m were in {unit}: are they?"
    if reading.sense == TURNS:
        return " if heading_rad were in turns: is it?"
    if reading.row:
        beside = "before" if reading.row > 0 else "after"
        return f" with the pose of the row {beside} each: are files one row off?"
    match reading.sense, reading.order:
        case 1, 1:
            return f"{degrees}: is heading_rad counted from x, and microphone 1 where it is told?"
        case -1, 1:
            return (
                f" if headings counted clockwise{degrees}: are they of a compass? "
                "heading_rad is pi/2 less those"
            )
        case -1, -1:
            return f" in the mirror{degrees}: are x and y exchanged?"
        case _:
            return f" if microphones counted the other way round{degrees}: do they?"


def come_true(heard: Heard, reading: Reading) -> Array:
    """Return how many echoes are heard again where a reading puts them, for each phi, (PHASES,).

    Args:
        heard: what the recordings hear.
        reading: how the survey is meant; its phi is not looked at.
    """
    here, there = _pairs(len(heard.places), reading.row)
    poses = np.arange(len(heard.places)) - reading.row
    places = reading.scale * heard.places[poses % len(poses)]
    headings = heard.headings[poses % len(poses)]
    moved = places[there] - places[here]

    # How a robot turned between two poses, its walls turn the other way.
    turned = reading.sense * reading.order * (headings[here] - headings[there])
    azimuth = heard.azimuth[here] + turned[:, None]
    off = wrap(heard.azimuth[there][:, None, :] - azimuth[:, :, None])
    same = np.abs(off) < TOWARD
    theta = reading.sense * headings[here][:, None] + reading.order * heard.azimuth[here]
    count = np.zeros(PHASES, dtype=int)
    for number in range(PHASES):
        toward = theta + 2 * np.pi * number / PHASES
        nearer = np.cos(toward) * moved[:, :1] + np.sin(toward) * moved[:, 1:]
        wanted = (heard.distance[here] - nearer)[:, :, None]
        close = np.abs(heard.distance[there][:, None, :] - wanted) < NEAR
        count[number] = int((close & same).any(axis=-1).sum())
    return count


def _pairs(count: int, row: int) -> tuple[Array, Array]:
    """Return pairs of recordings, those without a pose left out, two arrays of numbers."""
    found = [
        (first, first + after)
        for first in range(max(row, 0), count + min(row, 0))
        for after in AFTER
        if first + after < count + min(row, 0)
    ]
    every = max(1, -(-len(found) // MOST))
    pairs = np.array(found[::every], dtype=int).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]
