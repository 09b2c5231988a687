"""What a survey seems to get wrong, of which nobody can be sure.

A direct path in recordings that shall hold none, a level that changes on the way, microphones whose
positions are in another unit.
"""

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.survey import naming, time_zero
from echolearn.survey.measuring import Walk

EARLY = 64.0
"""Samples after the direct path's lag within which no wall answers: 0.5 m away at 22 kHz."""

OFTEN = 0.9
"""Share of recordings in which it must be so."""

CHANGED_DB = 12.0
"""dB by which a microphone's level, over that of the others, may change on the way."""

UNLIKE_DB = 30.0
FEW = 4
"""dB by which a recording's level differs from the others' if it is told, and recordings of which
that can be said."""

WIDE = 5.0
LARGE = 200.0
"""m that no robot, and no room, is wide."""

STILL = 0.02
SEEN_AGAIN = 0.3
FEWEST = 12
AGAIN = 4.0
"""m within which poses stand still; share of echoes that must then be heard again, pairs of echoes
that tell it, and samples within which they are the same."""


def hidden_lines(walk: Walk, alive: Array) -> list[str]:
    """Return the lines on what a survey seems to get wrong.

    Args:
        walk: what was measured.
        alive: microphones that hear a room, shape (M,), bool.
    """
    return [
        *_present(walk, alive),
        *_unsteady(walk, alive),
        *_unlike(walk, alive),
        *_wide(walk),
        *_still(walk),
    ]


def _present(walk: Walk, alive: Array) -> list[str]:
    """Return the line on recordings that seem to hold the direct path, though they should not."""
    survey = walk.survey
    if survey.direct or not alive.any():
        return []
    expected = np.array(
        [
            time_zero.expected(
                survey.around(pose), survey.probe, speed_of_sound=survey.speed_of_sound
            )
            for pose in range(len(survey.poses))
        ]
    )
    late = (np.asarray(walk.echo.lag) - expected)[:, alive]
    usual = float(np.median(late))
    # A wall is elsewhere at another pose, and at each microphone.
    there = (np.abs(late - usual) < 1.0).all(axis=1) & (walk.echo.seen[:, alive] > 0).all(axis=1)
    if len(late) < 3 or there.mean() < OFTEN or not abs(usual) < EARLY:
        return []
    return [
        f"the loudest sound arrives where the direct path would, {usual:z.1f} samples late, in "
        f"{naming.recordings(walk.numbers, there)}: should direct_path be present?"
    ]


def _unsteady(walk: Walk, alive: Array) -> list[str]:
    """Return the line on microphones whose level changes against that of the others."""
    level = walk.level_db - np.median(walk.level_db[:, alive], axis=1, keepdims=True)
    # One recording may be loud at one microphone; a gain stays.
    half = len(level) // 2
    if half < 3 or not alive.any():
        return []
    change = np.median(level[half:], axis=0) - np.median(level[:half], axis=0)
    which = alive & (np.abs(change) > CHANGED_DB)
    if not which.any():
        return []
    most = float(change[which][np.abs(change[which]).argmax()])
    return [
        f"the level of {naming.microphones(which)} changes by {most:+.0f} dB against the others on "
        "the way: was a gain turned, or is a plug loose?"
    ]


def _unlike(walk: Walk, alive: Array) -> list[str]:
    """Return the line on recordings whose level is not that of the others."""
    if len(walk.numbers) < FEW or not alive.any():
        return []
    level = np.median(walk.level_db[:, alive], axis=1)
    above = level - np.median(level)
    which = np.abs(above) > UNLIKE_DB
    if not which.any():
        return []
    most = float(above[which][np.abs(above[which]).argmax()])
    side, hint = ("above", "") if most > 0 else ("below", " was the probe played,")
    return [
        f"the level of {naming.recordings(walk.numbers, which)} is {abs(most):.0f} dB {side} the "
        f"others':{hint} is it stored in another way, or was a gain turned?"
    ]


def _wide(walk: Walk) -> list[str]:
    """Return the lines on microphones farther apart than any robot is wide, and on such walls."""
    places = walk.survey.array.positions
    apart = float(np.linalg.norm(places[:, None] - places, axis=-1).max())
    walls = walk.survey.walls
    across = 0.0 if walls is None else float(np.ptp(walls, axis=(0, 1)).max())
    told = [("microphones", apart, WIDE), ("walls", across, LARGE)]
    return [
        f"{name}={size:.3g} m apart: must be m; are they in cm or mm?"
        for name, size, most in told
        if size > most
    ]


def _still(walk: Walk) -> list[str]:
    """Return the line on poses that do not move, though the echoes do."""
    places = np.array([pose.position for pose in walk.survey.poses])
    # Where the loudspeaker moves on its own, echoes move though the robot does not.
    apart = walk.survey.loudspeakers is not None or not walk.survey.mapped
    if apart or len(places) < 2 or np.ptp(places, axis=0).max() > STILL:
        return []
    # Floor and ceiling are always as far away; what comes from there has no azimuth.
    path = np.where(np.isfinite(walk.echo.azimuth), walk.echo.path, np.nan)
    known = np.isfinite(path[:-1]) & np.isfinite(path[1:]).any(axis=1, keepdims=True)
    moved = np.nanmin(
        np.abs(path[1:, None, :] - path[:-1, :, None])[known], axis=-1, initial=np.inf
    )
    if len(moved) < FEWEST or np.mean(moved < AGAIN) > SEEN_AGAIN:
        return []
    within = 1000 * float(np.ptp(places, axis=0).max())
    return [
        f"poses are within {within:.2g} mm of one another, but {np.sum(moved >= AGAIN)} of "
        f"{len(moved)} echoes move: are x_m and y_m filled in, in m and not in degrees?"
    ]
