"""Is this a walk? All poses looked at together: what is in range by itself may be in other units.

Headings in rad are within -pi ... pi or 0 ... 2 pi, or have been added up over many turns, going on
from pose to pose. Steps between places are such that echoes of walls, heard within 2 m, cover them.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import check

STRIDE = 20.0
"""m between neighbouring poses of most of a walk; echoes are heard within 2 m of it."""

TURN = 6.5
"""rad, a turn and what rounding adds to it."""


def check_walk(name: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Raise `BadValue` for poses that no robot walks.

    Args:
        name: name of the table in errors.
        rows: cells by column, in the order of the walk.
    """
    [(file, times)] = Counter(row["file"] for row in rows).most_common(1)
    named = f"{file}, {times} times"
    allowed = "must name a recording for each pose"
    hint = "was the first row copied down?"
    own = times == 1 or 2 * times <= len(rows)
    check(own, f"{name} file", named, allowed=allowed, hint=hint)

    places = np.array([[row["x_m"], row["y_m"]] for row in rows])
    moves = np.diff(places, axis=0)
    stride = float(np.median(np.linalg.norm(moves, axis=1))) if len(moves) else 0.0
    allowed = f"must be m, most poses within {STRIDE:g} m of the one before"
    hint = "are they in mm or cm?"
    check(stride <= STRIDE, f"{name} x_m, y_m", f"steps of {stride:g}", allowed=allowed, hint=hint)

    headings = np.array([row["heading_rad"] for row in rows])
    largest = float(np.abs(headings).max())
    allowed = "must be rad"
    hint = "are they in degrees? Headings within -pi ... pi are taken as they are"
    value = f"values up to {largest:g}"
    check(not in_degrees(headings, moves), f"{name} heading_rad", value, allowed=allowed, hint=hint)


def in_degrees(headings: Array, moves: Array) -> bool:
    """Tell whether the headings of a walk are in degrees rather than in rad.

    Within a turn nothing tells them apart. Beyond it degrees jump, or are typed whole, or turn as
    the walk does, which rad of that size do not.

    Args:
        headings: shape (P,), in the order of the walk.
        moves: from each pose to the next, shape (P - 1, 2).
    """
    if np.abs(headings).max() <= TURN:
        return False
    jumps = bool((np.abs(np.diff(headings)) > TURN).any())
    halves = bool((headings * 2 == np.rint(headings * 2)).all())
    return jumps or halves or _follows(np.deg2rad(headings), headings, moves=moves)


def _follows(turned: Array, other: Array, *, moves: Array) -> bool:
    """Tell whether a walk turns as headings do, up to a constant, and not as others.

    Args:
        turned: headings in rad, shape (P,).
        other: others, shape (P,).
        moves: from each pose to the next, shape (P - 1, 2).
    """
    going = moves.any(axis=1)
    travel = np.arctan2(*moves[going].T[::-1])
    if len(travel) < 4:
        return False
    # 1 less the mean resultant length: 0 where all differences are equal, near 1 where they vary.
    left, beside, alone = (
        1.0 - abs(np.mean(np.exp(1j * (travel - heading))))
        for heading in (turned[:-1][going], other[:-1][going], 0.0)
    )
    # A straight walk is followed by anything that hardly turns.
    return bool(left < 0.1 * min(beside, alone))
