"""Recordings that are copies of others: no two of a real walk have equal samples.

A file under another name, or a channel whose buffer was not filled anew, is what was heard at
another pose. At the same pose a simulation without noise hears the same again.
"""

from collections import defaultdict

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.survey import naming
from echolearn.survey.survey import Survey

SAME = 1e-3
"""m and rad within which poses are one."""


def copy_lines(survey: Survey, marks: Array) -> list[str]:
    """Return the line on recordings that hold what was recorded at another pose, if any do.

    Args:
        survey: what was recorded.
        marks: of each channel, shape (P, M); 0 where nothing is compared.
    """
    copied = np.zeros(marks.shape, dtype=bool)
    for microphone, column in enumerate(marks.T):
        equal = defaultdict(list)
        for pose, mark in enumerate(column.tolist()):
            equal[mark].append(pose)
        groups = (group for mark, group in equal.items() if mark and _apart(survey, group))
        for group in groups:
            copied[group, microphone] = True
    if not copied.any():
        return []
    poses = np.flatnonzero(copied.any(axis=1))
    files = ", ".join(dict.fromkeys(survey.files[pose] for pose in poses[:3]))
    more = f" and {len(poses) - 3} more" if len(poses) > 3 else ""
    where = naming.recordings(survey.numbers, copied.any(axis=1))
    which = naming.microphones(copied.any(axis=0))
    return [
        f"equal samples at {which}={where} ({files}{more}): must be recorded at their own poses; "
        "was a file copied, or a buffer not filled?"
    ]


def _apart(survey: Survey, poses: list[int]) -> bool:
    """Tell whether some poses differ."""
    found = [survey.poses[pose] for pose in poses]
    places = np.array([[*pose.position, pose.heading] for pose in found])
    return bool((np.ptp(places, axis=0) > SAME).any())
