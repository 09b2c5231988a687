"""Labelled wall hypotheses of a set of walks, a record each: what classifiers of walls learn from.

    finished set of walks --hypotheses, strips--> columns --walls in the odometry's frame--> is_wall

The walks' matched filters are not simulated anew: this set is made of a finished one, in seconds a
walk, and again whenever hypotheses are sought otherwise. A record has the columns of sound and of
geometry (`walls.strips`), the line (`theta`, `rho`), and

- `is_wall`: whether the line is a wall's, within 2 degrees and 5 cm (`evaluation.wall_matching`),
- `wall`: which one, or -1; `walls`: how many the room has,
- `snr_db`, `t60`, `odometry_error`, and `group`, the number of the walk: hypotheses of one walk are
  not independent, and no split parts them,
- `normal`, `offset`, `normal_sd`, `offset_sd`: the line as its track fits it, in rad and m, with
  standard deviations, and `stretches`, how far it reaches there (`walls.track`), NaN-padded,
- `strips`, if the plan wants them: J of each pose around the line, float16, (P, `STRIP_ENTRIES`),
  noise where a lag lies outside the window. Poses that have the line in their window come first, in
  their order; the others are zeros. The first entries are the walk's number, in digits of 2048,
  which float16 holds exactly.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Array
from echolearn.checks import Range, check_fields
from echolearn.dataset.walk_plan import WalkPlan
from echolearn.dataset.walk_set import WalkSet
from echolearn.evaluation.wall_matching import alignment, carried, match_walls, wall_lines
from echolearn.walls.hypotheses import hypotheses
from echolearn.walls.nouns import GEOMETRY, SOUND, Hypotheses
from echolearn.walls.strips import Strips, geometry_columns, sound_columns, strip_rows, strips
from echolearn.walls.track import follow
from echolearn.walls.walk import HeardWalk

RANGES: dict[str, Range] = {"count": (1, 1000), "shard_rows": (1, 4096, "walks")}
"""Least and largest value of a field that is a whole number."""

KNOWN = ("snr_db", "t60", "odometry_error", "group")
"""Fields of a walk that its hypotheses have, too."""

STRETCHES = 4
"""Most stretches of a wall that are kept, those that come first along it."""


@dataclass(frozen=True)
class HypothesisPlan:
    """The wall hypotheses of all walks of a plan.

    Attributes:
        walks: plan of the walks, whose set must be finished.
        count: most hypotheses of a walk, before those that the path crosses are dropped.
        shard_rows: walks of which the hypotheses are stored in one file.
        strips: whether records hold them, which networks look at.
    """

    walks: WalkPlan
    count: int = 20
    shard_rows: int = 16
    strips: bool = True

    def __post_init__(self) -> None:
        check_fields("plan", self, ranges=RANGES)

    def __len__(self) -> int:
        return len(self.walks)


def hypothesis_records(plan: HypothesisPlan, rows: range, *, source: Path) -> Array:
    """Return the records of all hypotheses of some walks, a structured array.

    Args:
        plan: says how many are sought.
        rows: numbers of the walks.
        source: folder of the set of walks.
    """
    walks = WalkSet(source)
    return np.concatenate([_of_walk(plan, walks, row=row) for row in rows])


def _of_walk(plan: HypothesisPlan, walks: WalkSet, *, row: int) -> Array:
    """Return the records of one walk's hypotheses.

    Args:
        plan: what is sought and kept.
        walks: set of walks.
        row: number of the walk.
    """
    record, walk = walks[row], walks.heard(row)
    found = hypotheses(walk, count=plan.count)
    cut = strips(walk, found)
    sound = sound_columns(walk, found, cut=cut)
    geometry = geometry_columns(walk, found, cut=cut)
    matched, total = _truth(record, found)

    columns = dict(zip(SOUND, sound.T, strict=True)) | dict(zip(GEOMETRY, geometry.T, strict=True))
    columns |= {"theta": found.theta, "rho": found.rho, "is_wall": matched >= 0, "wall": matched}
    columns |= {name: np.repeat(record[name], len(found)) for name in KNOWN}
    columns["walls"] = np.full(len(found), total)
    columns |= _tracks(walk, found, cut=cut)
    if plan.strips:
        rng = stream(plan.walks.seed, "strips", row)
        columns["strips"] = strip_rows(walk, cut, number=int(record["group"]), rng=rng)
    kinds = [(name, column.dtype, column.shape[1:]) for name, column in columns.items()]
    table = np.empty(len(found), kinds)
    for name, column in columns.items():
        table[name] = column
    return table


def _tracks(walk: HeardWalk, found: Hypotheses, *, cut: Strips) -> dict[str, Array]:
    """Return the lines of hypotheses (K,) as their tracks have them, and their stretches.

    Args:
        walk: what was heard, and where.
        found: its hypotheses.
        cut: their strips.
    """
    lines = np.zeros((len(found), 4))
    reached = np.full((len(found), STRETCHES, 2, 2), np.nan)
    for number in range(len(found)):
        track = follow(walk, found, cut=cut, number=number)
        line = track.line
        lines[number] = line.normal, line.offset, line.normal_sd, line.offset_sd
        some = track.stretches[:STRETCHES]
        reached[number, : len(some)] = some
    names = ("normal", "offset", "normal_sd", "offset_sd")
    return dict(zip(names, lines.T, strict=True)) | {"stretches": reached}


def _truth(record: Array, found: Hypotheses) -> tuple[Array, int]:
    """Return which wall each hypothesis is, (K,), and how many walls there are."""
    sides = record["sides"]
    lines = wall_lines(sides[np.isfinite(sides).all(axis=(1, 2))])
    told = record["told"][:, :2]
    angle, shift = alignment(record["poses"][:, :2], told)
    there = carried(lines, angle=angle, shift=shift)
    estimated = np.stack([found.theta, found.rho], axis=1)
    return match_walls(there, estimated, middle=told.mean(axis=0)), len(lines)
