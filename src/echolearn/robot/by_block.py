"""What is kept of a survey's recordings, block by block; a broken one is told by its file."""

from collections.abc import Callable, Sequence
from typing import TypeVar
from warnings import catch_warnings, simplefilter

import numpy as np

from echolearn.checks import BadValue
from echolearn.localization.silence import SilentMicrophone
from echolearn.runtime.progress import track
from echolearn.survey.survey import Survey, blocks

Fields = TypeVar("Fields")


def block_by_block(walk: Survey, take: Callable[[Sequence[int]], Fields]) -> list[Fields]:
    """Return what is taken from every block of a survey's recordings.

    Args:
        walk: the survey.
        take: from numbers of poses to what is kept of them.

    Raises:
        BadValue: a recording that cannot be analysed; names its file.
    """
    found = []
    for block in track(blocks(walk), f"map {walk.folder.name}", unit="blocks"):
        try:
            # A microphone that is silent has been refused, or left out by whoever maps.
            with catch_warnings():
                simplefilter("ignore", SilentMicrophone)
                found.append(take(block))
        except BadValue as error:
            raise _blame(error, take, walk=walk, block=block) from None
    return found


def concatenated(parts: Sequence[Fields]) -> Fields:
    """Return values of one class, whose fields are arrays, as one of them all."""
    columns = zip(*(vars(part).values() for part in parts), strict=True)
    return type(parts[0])(*map(np.concatenate, columns))


def _blame(
    error: BadValue, take: Callable[[Sequence[int]], object], *, walk: Survey, block: Sequence[int]
) -> BadValue:
    """Return the complaint about a block, said of the file of the recording that is to blame.

    Args:
        error: the complaint.
        take: what complained.
        walk: the survey.
        block: numbers of the poses.
    """
    if not str(error).startswith("observation.samples="):
        return error
    # Alone, a recording is number 0 of its block, which tells a reader nothing.
    for pose in block:
        try:
            take([pose])
        except BadValue as alone:
            reason = str(alone).removeprefix("observation.samples=")
            reason = reason.replace(" of observation 0", "")
            return BadValue(f"{walk.folder / walk.files[pose]}: {reason}")
    return error
