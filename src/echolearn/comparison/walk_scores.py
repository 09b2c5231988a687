"""Who finds which walls: rows of results and paired tests, cell by cell and over all cells.

    runs, cells --judgements--> WalkCounts of each judge and walk --cell_rows, tests_of--> tables

Judges are the runs (their first seed), cut as they come; lines through points (`point_lines`); the
oracle, which believes in exactly those hypotheses that are right, the most that any judge of them
could reach; and `exact_poses`, the best run on the same walks told their true poses.

Walks are resampled and swapped, not hypotheses. Cells that repeat the same walks at another SNR or
odometry are no further walks: over all cells a walk counts as one cluster.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.comparison.walk_cells import Cell, PointJudge, points_of
from echolearn.evaluation import metrics, pairs, stats
from echolearn.evaluation.rows import Row
from echolearn.evaluation.wall_scoring import (
    BelievedLines,
    WalkCount,
    count_walk,
    evaluate_walks,
    found_shares,
)
from echolearn.training.predictions import predict
from echolearn.training.runs import Run

ORACLE = "oracle"
EXACT = "exact_poses"

ALL = "all"
"""What tests of all cells together are about."""


@dataclass(frozen=True, eq=False)
class Judgement:
    """What one judge says of the walks of one cell.

    Attributes:
        counts: what came of each walk.
        confidence: in each hypothesis, shape (B,); None of who does not look at them.
    """

    counts: Sequence[WalkCount]
    confidence: Array | None = None


Judgements = Mapping[str, Judgement]


def judgements(
    cell: Cell, *, runs: Mapping[str, Run], points: Mapping[str, PointJudge]
) -> Judgements:
    """Return what everybody says of a cell, but for who is told the true poses.

    Args:
        cell: walks and hypotheses.
        runs: finished runs by the classifiers' names.
        points: Hough and RANSAC.
    """
    found: dict[str, Judgement] = {}
    for name, run in runs.items():
        confidence = predict(run, cell.hypotheses)
        chosen = metrics.kept(confidence, run.threshold)
        found[name] = Judgement(_counts(cell, cell.believed(chosen)), confidence)
    given = points_of(cell.walks, range(len(cell.walks)))
    for name, judge in points.items():
        found[name] = Judgement(_counts(cell, judge.believed(given)))
    right = cell.hypotheses["is_wall"].astype(bool)
    found[ORACLE] = Judgement(_counts(cell, cell.believed(right)))
    return found


def _counts(cell: Cell, believed: Sequence[BelievedLines]) -> list[WalkCount]:
    return [count_walk(truth, each) for truth, each in zip(cell.truths, believed, strict=True)]


def with_exact_poses(
    cells: Sequence[Cell], found: Sequence[Judgements], *, best: str
) -> list[Judgements]:
    """Add what the best run finds on the same walks with exact poses, where a cell has them.

    Args:
        cells: what is compared on.
        found: what was said of each.
        best: name of the run.
    """
    both = list(zip(cells, found, strict=True))
    exact = [(cell.same_walks, said[best]) for cell, said in both if cell.exact]
    result: list[Judgements] = []
    for cell, said in both:
        same = [there for walks, there in exact if walks == cell.same_walks]
        result.append({**said, **({EXACT: Judgement(same[0].counts)} if same else {})})
    return result


def cell_rows(cell: Cell, said: Judgements, *, resamples: int) -> list[Row]:
    """Return the rows of results about a cell.

    Args:
        cell: what is compared on.
        said: what everybody says of it.
        resamples: bootstrap draws of walks.
    """
    walks = np.arange(len(cell.walks))
    weights = stats.cluster_weights(walks, resamples=resamples)
    group = cell.hypotheses["group"]
    reference = cell.hypotheses["is_wall"].astype(bool)
    rows = []
    for name, judgement in said.items():
        counts = judgement.counts
        figures = stats.intervals(partial(evaluate_walks, counts), weights)
        confidence = judgement.confidence
        if confidence is not None:
            order = partial(_auc, reference, confidence)
            figures["auc"] = stats.interval(order, weights[:, group])
        audible = sum(count.audible for count in counts)
        for metric, (value, low, high) in figures.items():
            about = {"classifier": name, "metric": metric, "value": value}
            about |= {"ci_low": low, "ci_high": high, "n": len(walks), "walls": audible}
            rows.append(cell.about() | about)
    return rows


def _auc(reference: Array, confidence: Array, weights: Array | None) -> Array:
    return metrics.auc(reference, confidence, weights=weights)


def tests_of(
    cells: Sequence[Cell],
    found: Sequence[Judgements],
    *,
    rivals: Sequence[tuple[str, str]],
    resamples: int,
) -> list[Row]:
    """Return paired tests of judges, in each cell and over all, corrected together.

    Args:
        cells: what is compared on.
        found: what was said of each.
        rivals: names of judges, two by two.
        resamples: bootstrap draws of walks.
    """
    rows = []
    for first, second in rivals:
        about: Row = {"classifier": first, "against": second}
        duels = [
            Duel(cell, said[first], said[second])
            for cell, said in zip(cells, found, strict=True)
            if first in said and second in said
        ]
        for duel in duels:
            rows += [about | row for row in _tests([duel], duel.cell.about(), resamples=resamples)]
        if len(duels) > 1:
            everywhere = {"tested_on": ALL, "room": "", "paths": "", "snr_db": ""}
            everywhere["odometry_error"] = ""
            rows += [about | row for row in _tests(duels, everywhere, resamples=resamples)]
    # Tests of one metric are read as one table; those of single cells and over all apart.
    families = [
        {**row, "training": "", "family": (row["metric"], row["tested_on"] == ALL)} for row in rows
    ]
    return pairs.correct(families)


@dataclass(frozen=True, eq=False)
class Duel:
    """Two judges in one cell.

    Attributes:
        cell: where they meet.
        first, second: what they say.
    """

    cell: Cell
    first: Judgement
    second: Judgement

    @property
    def metrics(self) -> tuple[str, ...]:
        """What they can be compared in: only who looks at hypotheses can put them in order."""
        both = self.first.confidence is not None and self.second.confidence is not None
        return ("found", "auc") if both else ("found",)

    @property
    def reference(self) -> Array:
        """Which hypotheses are right, shape (B,)."""
        return self.cell.hypotheses["is_wall"].astype(bool)

    def difference(self, metric: str, weights: Array | None) -> Array:
        """Return the difference of a metric, for each row of weights (resamples, walks)."""
        sides = (self.first, self.second)
        if metric == "found":
            values = [evaluate_walks(side.counts, weights)["found"] for side in sides]
        else:
            each = None if weights is None else weights[:, self.cell.hypotheses["group"]]
            given = [np.asarray(side.confidence) for side in sides]
            values = [metrics.auc(self.reference, one, weights=each) for one in given]
        return values[0] - values[1]

    def shares(self, metric: str) -> tuple[Array, Array]:
        """Return what each row adds to the difference, and the number of its walk."""
        if metric == "found":
            shares = found_shares(self.first.counts, self.second.counts)
            return shares, np.arange(len(shares))
        first, second = map(np.asarray, (self.first.confidence, self.second.confidence))
        shares = pairs.auc_shares(self.reference, first=first, second=second)
        return shares, self.cell.hypotheses["group"]


def _tests(duels: Sequence[Duel], about: Row, *, resamples: int) -> list[Row]:
    """Return one test for each metric, of the mean difference over cells.

    Args:
        duels: the same two judges in different cells.
        about: columns that tell the cell.
        resamples: bootstrap draws of walks.
    """
    # The same walks in several cells are drawn, and swapped, together.
    families: dict[bytes, int] = {}
    for duel in duels:
        families.setdefault(duel.cell.family, len(families) * 10**7)
    starts = [families[duel.cell.family] for duel in duels]
    walks = [
        start + np.arange(len(duel.cell.walks)) for start, duel in zip(starts, duels, strict=True)
    ]
    every = np.unique(np.concatenate(walks))
    weights = stats.cluster_weights(every, resamples=resamples)
    rows = []
    for metric in duels[0].metrics:
        found = float(np.mean([duel.difference(metric, None) for duel in duels]))
        draws = [
            duel.difference(metric, weights[:, np.searchsorted(every, own)])
            for duel, own in zip(duels, walks, strict=True)
        ]
        shares, clusters = zip(*(duel.shares(metric) for duel in duels), strict=True)
        groups = [start + each for start, each in zip(starts, clusters, strict=True)]
        swaps = stats.swapped(
            np.concatenate(shares) / len(duels), np.concatenate(groups), swaps=pairs.SWAPS
        )
        # A share is exact but for rounding, which must not make ties smaller.
        least = abs(np.concatenate(shares).sum() / len(duels)) - 1e-12
        p = (1 + int((np.abs(swaps) >= least).sum())) / (1 + len(swaps))
        value, low, high = stats.percentiles(found, np.mean(draws, axis=0))
        row = {"metric": metric, "difference": value, "ci_low": low, "ci_high": high, "p": p}
        rows.append({**about, **row, "n": len(every), "test": "swaps"})
    return rows
