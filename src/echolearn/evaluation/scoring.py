"""Judge trained classifiers: on labelled sets row by row, on surveys by the map they leave.

A *contestant* is one classifier trained on one set, with its seeds; what it answers about a test
set is an `Answer` per seed. Every figure is the mean over seeds, its interval a bootstrap over
positions (or poses) that is shared by all contestants. On a set that any of them was trained on,
all are judged on the positions held out, seed by seed.

The rows produced here are those of `results.csv`: classifier, trained_on, tested_on, seed (empty:
mean over seeds), snr_db (empty: all; "low:high": a band, low included, of the last one high, too),
noise, metric, value, ci_low, ci_high, n.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.evaluation import metrics, stats
from echolearn.evaluation.coverage import attainable

BANDS = ((-40, -20), (-20, -15), (-15, -10), (-10, -5), (-5, 40))
"""dB, from and to; classifiers differ between -20 and -5 dB only."""

SWAPS = 5000
"""Permutations behind a p value: 1 / 5001 times the number of tests in a family must lie well below
0.05."""

Row = dict[str, Any]


@dataclass(frozen=True)
class Answer:
    """What one run says about a test set.

    Attributes:
        seed: of the run.
        rows: which rows it is judged on, shape (B,).
        confidence: of these rows, shape (B,).
        threshold: fixed beforehand on validation data.
    """

    seed: int
    rows: Array
    confidence: Array
    threshold: float


@dataclass(frozen=True)
class Sheet:
    """What is known of a test set.

    Attributes:
        name: of the set, or of the survey and its localizer.
        reference: shape (B,), bool.
        groups: position or pose of each row, shape (B,).
        snr_db: of each row, shape (B,).
        weights: resamples, shape (resamples, B).
        noise: kind of noise.
    """

    name: str
    reference: Array
    groups: Array
    snr_db: Array
    weights: Array
    noise: str = "white"

    def only(self, mask: Array) -> "Sheet":
        """Return the sheet of the rows where `mask` (B,) holds."""
        return replace(
            self,
            reference=self.reference[mask],
            groups=self.groups[mask],
            snr_db=self.snr_db[mask],
            weights=self.weights[:, mask],
        )


Evaluate = Callable[[Answer, Array | None], Mapping[str, Array]]


def judge(
    who: tuple[str, str],
    answers: Sequence[Answer],
    sheet: Sheet,
    evaluate: Evaluate,
    *,
    snr_db: str = "",
) -> Iterator[Row]:
    """Yield one row per metric and seed, and one for the mean over seeds with its interval.

    Args:
        who: classifier and the set it was trained on.
        answers: one per seed.
        sheet: the test set; its weights cover all rows that answers refer to.
        evaluate: metrics of an answer, for weights (resamples, B) or None.
        snr_db: entry of that column.
    """
    common = dict(zip(("classifier", "trained_on"), who, strict=True)) | {
        "tested_on": sheet.name,
        "snr_db": snr_db,
        "noise": sheet.noise,
        "n": round(np.mean([len(answer.rows) for answer in answers])),
    }
    each = [evaluate(answer, None) for answer in answers]
    if len(answers) > 1:
        for answer, values in zip(answers, each, strict=True):
            for metric, value in values.items():
                yield common | {
                    "seed": answer.seed,
                    "metric": metric,
                    "value": float(value),
                    "ci_low": "",
                    "ci_high": "",
                }

    def mean(weights: Array | None) -> dict[str, Array]:
        if weights is None:
            return average(each)
        return average([evaluate(answer, weights[:, answer.rows]) for answer in answers])

    for metric, found in stats.intervals(mean, sheet.weights).items():
        yield common | {
            "seed": "",
            "metric": metric,
            "value": found.value,
            "ci_low": found.low,
            "ci_high": found.high,
        }


def average(evaluations: Sequence[Mapping[str, Array]]) -> dict[str, Array]:
    """Return the mean over seeds of each metric; NaN where any seed's is (nothing kept, say)."""
    return {
        metric: np.mean([values[metric] for values in evaluations], axis=0)
        for metric in evaluations[0]
    }


def judge_labels(who: tuple[str, str], answers: Sequence[Answer], sheet: Sheet) -> Iterator[Row]:
    """Yield the label metrics of a contestant on a labelled set, over all rows and by SNR band."""

    def every(answer: Answer, weights: Array | None) -> Mapping[str, Array]:
        return metrics.evaluate_labels(
            sheet.reference[answer.rows],
            answer.confidence,
            threshold=answer.threshold,
            weights=weights,
        )

    yield from judge(who, answers, sheet, every)
    for low, high in BANDS:
        yield from _judge_band(who, answers, sheet, low=low, high=high)


def _judge_band(
    who: tuple[str, str], answers: Sequence[Answer], sheet: Sheet, *, low: float, high: float
) -> Iterator[Row]:
    inside = in_band(sheet.snr_db, low=low, high=high)
    new_row = np.cumsum(inside) - 1
    cut = [
        Answer(a.seed, new_row[a.rows[inside[a.rows]]], a.confidence[inside[a.rows]], a.threshold)
        for a in answers
    ]
    if not all(len(answer.rows) for answer in cut):
        return
    banded = sheet.only(inside)

    def few(answer: Answer, weights: Array | None) -> Mapping[str, Array]:
        reference = banded.reference[answer.rows]
        return {
            "auc": metrics.auc(reference, answer.confidence, weights=weights),
            "balanced_accuracy": metrics.balanced_accuracy(
                reference, metrics.kept(answer.confidence, answer.threshold), weights=weights
            ),
        }

    rows = judge(who, cut, banded, few, snr_db=f"{low}:{high}")
    yield from (row for row in rows if row["seed"] == "")


def in_band(snr_db: Array, *, low: float, high: float) -> Array:
    """Tell which SNRs (B,) lie in [low, high) dB; the last of the bands holds its upper end, too."""
    below = snr_db <= high if high == BANDS[-1][1] else snr_db < high
    return (snr_db >= low) & below


@dataclass(frozen=True)
class Heard:
    """A survey as one localizer heard it.

    Attributes:
        sheet: reference is "the map point lies within 0.10 m of a wall".
        points: map points, shape (P, 2), in m.
        poses: robot positions, shape (P, 2), in m.
        corners: the room's outline, shape (C, 2), in m.
        columns: what classifiers look at, by name, shape (P, ...).
    """

    sheet: Sheet
    points: Array
    poses: Array
    corners: Array
    columns: Mapping[str, Array]

    @property
    def attainable(self) -> float:
        """Share of poses with a wall 1 to 2 m away: about what one echo a pose can get right."""
        return attainable(self.corners, self.poses)


def judge_map(
    who: tuple[str, str], answers: Sequence[Answer], heard: Heard, *, snr_db: str
) -> Iterator[Row]:
    """Yield the map metrics of a contestant on a survey."""

    def every(answer: Answer, weights: Array | None) -> Mapping[str, Array]:
        return metrics.evaluate_map(
            heard.corners,
            heard.points,
            kept=metrics.kept(answer.confidence, answer.threshold),
            confidence=answer.confidence,
            poses=heard.poses,
            weights=weights,
        )

    reference = heard.sheet.reference
    counts = {"true_retention": reference.sum(), "spurious_removal": (~reference).sum()}
    for row in judge(who, answers, heard.sheet, every, snr_db=snr_db):
        yield at_the_edge(row, int(counts[row["metric"]])) if row["metric"] in counts else row


def at_the_edge(row: Row, count: int) -> Row:
    """Return a row of a share, by Wilson's interval where all of `count` points or none leave a
    bootstrap no width.
    """
    if row["seed"] != "" or row["value"] not in (0.0, 1.0) or count == 0:
        return row
    found = stats.wilson(round(row["value"] * count), count)
    return row | {"ci_low": found.low, "ci_high": found.high}


def yardsticks(reference: Array, *, seed: int = 0) -> dict[str, Answer]:
    """Return the answers that no classifier gives: keep everything, nothing, the right ones, or
    toss a coin.
    """
    rows = np.arange(len(reference))
    confidence = {
        "keep_everything": np.ones(len(rows)),
        "keep_nothing": np.zeros(len(rows)),
        "oracle": reference.astype(float),
        "chance": np.random.default_rng(seed).uniform(size=len(rows)),
    }
    return {name: Answer(0, rows, values, 0.5) for name, values in confidence.items()}


def paired(first: Sequence[Answer], second: Sequence[Answer]) -> list[tuple[Answer, Answer]]:
    """Return the answers of two contestants seed by seed; a lone answer of the second goes with
    each of the first.
    """
    return [(a, b) for a in first for b in second if a.seed == b.seed or len(second) == 1]


def compare_pair(
    first: Sequence[Answer], second: Sequence[Answer], sheet: Sheet, *, metric: str, seed: int = 0
) -> Row:
    """Test whether two contestants differ in a metric, on the same rows, pooled over their common
    seeds.

    Args:
        first, second: their answers, which refer to the same rows seed by seed.
        sheet: the test set.
        metric: "auc" (of confidence) or "balanced_accuracy" (of what is kept).
        seed: of the resamples and swaps.

    Raises:
        BadValue: no seed in common.
    """
    pairs = paired(first, second)
    check(
        len(pairs) > 0,
        "seeds",
        [answer.seed for answer in first],
        allowed="one in common with the other's",
    )
    rows = np.concatenate([a.rows for a, _ in pairs])
    answers = [np.concatenate([_answer(pair[side], metric) for pair in pairs]) for side in (0, 1)]
    difference = stats.paired_test(
        getattr(metrics, metric),
        sheet.reference[rows],
        shares=getattr(metrics, f"{metric}_shares"),
        first=answers[0],
        second=answers[1],
        groups=sheet.groups[rows],
        weights=sheet.weights[:, rows],
        ranked=metric == "auc",
        swaps=SWAPS,
        seed=seed,
    )
    value, low, high, p = difference
    return {
        "metric": metric,
        "difference": value,
        "ci_low": low,
        "ci_high": high,
        "p": p,
        "n": len(np.unique(sheet.groups[rows])),
    }


def _answer(answer: Answer, metric: str) -> Array:
    return (
        answer.confidence if metric == "auc" else metrics.kept(answer.confidence, answer.threshold)
    )


def correct(tests: Iterable[Row]) -> list[Row]:
    """Add Holm's correction, as `p_holm`, for the number of tests of the same metric and training
    set.
    """
    rows = list(tests)
    adjusted: dict[int, float] = {}
    for key in {(row["metric"], row["trained_on"]) for row in rows}:
        family = [
            index for index, row in enumerate(rows) if (row["metric"], row["trained_on"]) == key
        ]
        adjusted |= dict(
            zip(family, stats.holm(np.array([rows[index]["p"] for index in family])), strict=True)
        )
    return [row | {"p_holm": float(adjusted[index])} for index, row in enumerate(rows)]
