"""Sets of walks to be compared on: what is true of each walk, and what somebody believes of it.

walks, hypotheses --Cell--> truth of each walk
Cell, confidences --believed--> lines of each walk
validation walks  --point_judges--> Hough and RANSAC, each with its cut
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.classifiers.operating_point import Aim, OutOfReach, choose_cut
from echolearn.comparison.point_lines import hough_lines, ransac_lines
from echolearn.dataset.labelled_set import Dataset
from echolearn.dataset.walk_set import WalkSet
from echolearn.evaluation.metrics import kept
from echolearn.evaluation.wall_matching import match_walls
from echolearn.evaluation.wall_scoring import BelievedLines, HeardWalls, heard_walls
from echolearn.storage.identity import canonical

POINT_LINES: dict[str, Callable[[Array, Array], BelievedLines]] = {
    "ransac_joint": ransac_lines,
    "hough_joint": hough_lines,
}
"""What a user would do without a sum over poses, by name."""

NOTHING = 2.0
"""Cut above every score."""


@dataclass(frozen=True, eq=False)
class Cell:
    """A test set: walks of one kind, and their hypotheses.

    Attributes:
        walks: the set of walks.
        hypotheses: the set of their hypotheses.
    """

    walks: WalkSet
    hypotheses: Dataset

    @property
    def name(self) -> str:
        """Name of the walks' plan."""
        return str(self.walks.plan["name"])

    def about(self) -> dict[str, str]:
        """Return what tells it from others, as columns of results."""
        plan = self.walks.plan
        room = plan["room"] or {}
        size = room.get("size")
        text = "x".join(f"{side:g}" for side in size) if size else "outline" if room else "drawn"
        about = {"tested_on": self.name, "room": text, "paths": " ".join(plan["paths"])}
        return about | {key: _range(plan[key]) for key in ("snr_db", "odometry_error")}

    @property
    def same_walks(self) -> bytes:
        """What sets have alike whose walks differ in nothing but the odometry's errors."""
        plan = self.walks.plan
        return canonical({k: v for k, v in plan.items() if k not in ("name", "odometry_error")})

    @property
    def family(self) -> bytes:
        """What sets have alike whose rooms and paths are the same."""
        varied = ("name", "odometry_error", "snr_db", "role", "shard_rows")
        return canonical({k: v for k, v in self.walks.plan.items() if k not in varied})

    @property
    def exact(self) -> bool:
        """Whether the odometry tells the true poses."""
        return max(self.walks.plan["odometry_error"]) == 0.0

    @cached_property
    def truths(self) -> list[HeardWalls]:
        """What is true of each walk."""
        return [truth_of(self.walks, row) for row in range(len(self.walks))]

    @cached_property
    def lines(self) -> BelievedLines:
        """All hypotheses of all walks; nobody believes in them yet."""
        read = self.hypotheses.__getitem__
        own = np.stack([read("theta"), read("rho")], axis=1)
        told = np.stack([read("normal"), read("offset")], axis=1)
        return BelievedLines(own, told, read("stretches"), np.zeros(len(own)))

    def believed(self, chosen: Array) -> list[BelievedLines]:
        """Return the lines of each walk that are chosen, (B,), of all hypotheses."""
        group = self.hypotheses["group"]
        return [self.lines.part((group == row) & chosen) for row in range(len(self.walks))]


def _range(values: Sequence[float]) -> str:
    """Return a range as text: one number where it is one."""
    return ":".join(f"{each:g}" for each in dict.fromkeys(values))


def truth_of(walks: WalkSet, row: int) -> HeardWalls:
    """Return what is true of a walk."""
    record = walks[row]
    sides = record["sides"][np.isfinite(record["sides"]).all(axis=(1, 2))]
    window = walks.plan["window"]
    return heard_walls(
        sides,
        poses=record["poses"][:, :2],
        told=record["told"][:, :2],
        nearest=window["nearest"],
        farthest=window["farthest"],
    )


@dataclass(frozen=True)
class PointJudge:
    """Lines through the strongest echoes, and how many votes make one a wall.

    Attributes:
        draw: from points and rays to lines.
        threshold: share of the poses from which a line is believed.
    """

    draw: Callable[[Array, Array], BelievedLines]
    threshold: float

    def believed(self, points: Sequence[tuple[Array, Array]]) -> list[BelievedLines]:
        """Return the lines of each walk that have enough votes."""
        every = [self.draw(*each) for each in points]
        return [lines.part(kept(lines.score, self.threshold)) for lines in every]


def points_of(walks: WalkSet, rows: Sequence[int]) -> list[tuple[Array, Array]]:
    """Return the strongest echo of each pose of some walks: points and rays."""
    return [walks.heard(row).strongest() for row in rows]


def point_judges(walks: WalkSet, rows: Sequence[int], *, aim: Aim) -> Mapping[str, PointJudge]:
    """Return Hough and RANSAC, cut as runs are: by validation walks.

    Args:
        walks: set that runs were trained on.
        rows: numbers of its walks for validation.
        aim: what the cut shall do.
    """
    points = points_of(walks, rows)
    truths = [truth_of(walks, row) for row in rows]
    found = {}
    for name, draw in POINT_LINES.items():
        scores = [np.empty(0)]
        right = [np.empty(0, dtype=bool)]
        for given, truth in zip(points, truths, strict=True):
            lines = draw(*given)
            scores.append(lines.score)
            matched = match_walls(truth.lines, lines.lines, middle=truth.middle)
            right.append(matched >= 0)
        cut = _cut(np.concatenate(scores), np.concatenate(right), aim=aim)
        found[name] = PointJudge(draw, cut)
    return found


def _cut(score: Array, right: Array, *, aim: Aim) -> float:
    """Return the cut of scores (B,), balanced where the aim is out of reach, as that of a run.

    Args:
        score: 0 to 1.
        right: whether each is right.
        aim: what the cut shall do.
    """
    if not right.any() or right.all():
        return 0.0 if right.any() else NOTHING
    try:
        return choose_cut(score, right, aim=aim).threshold
    except OutOfReach:
        return choose_cut(score, right, aim=Aim()).threshold
