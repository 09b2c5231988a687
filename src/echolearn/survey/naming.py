"""How lines about a survey name recordings and microphones: few by number, many by how many."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

SHOWN = 6
"""Recordings that a line names."""


def microphones(which: ArrayLike) -> str:
    """Return "microphone 3" or "microphones 2, 3" for which of them, shape (M,), bool."""
    found = (np.flatnonzero(which) + 1).tolist()
    if len(found) == np.size(which) > 1:
        return f"all {len(found)} microphones"
    return f"microphone{'s' if len(found) > 1 else ''} {', '.join(map(str, found))}"


def recordings(numbers: Sequence[object], which: ArrayLike) -> str:
    """Return "recording 3" or "recordings 3, 4, 8" for which of them, shape (P,), bool.

    Args:
        numbers: `index` of each in `poses.csv`, or what else names it.
        which: those that are meant.
    """
    found = [str(numbers[place]) for place in np.flatnonzero(which).tolist()]
    if len(found) == len(numbers) > 1:
        return f"all {len(found)} recordings"
    more = f" and {len(found) - SHOWN} more" if len(found) > SHOWN else ""
    return f"recording{'s' if len(found) > 1 else ''} {', '.join(found[:SHOWN])}{more}"


def left_out(which: ArrayLike) -> str:
    """Return how to map without some microphones, shape (M,), bool."""
    numbers = (np.flatnonzero(which) + 1).tolist()
    # Some localizers take times from the first one.
    by = ", by a bundle whose localizer is joint or em" if 1 in numbers else ""
    return f"without={numbers} maps with the others{by}"
