"""Figures over several rooms at once: all sets made for testing, all walks at one SNR.

    a set or survey --set_shares, walk_shares--> value and draws of each model (`Share`)
    shares of all rooms --pooled_rows--> rows of results.csv of kind "pooled"
                        --pooled_tests--> rows of tests.csv, against the bare threshold

A figure's draws are those of its room, made alike for all models, so differences are paired; how
rooms are put together, `evaluation.pooling` says. On walks neighbouring poses see the same wall:
stretches of the walk are drawn, not poses.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.comparison.rivals import Pair, about, baselines
from echolearn.evaluation import metrics, pooling, scoring, stats
from echolearn.evaluation.rows import LocalizedSurvey, Model, Predictions, Recordings, Row

SETS, WALKS = "test sets", "walks"
"""What `tested_on` says of pooled rows."""

OF_MAPS = {
    "balanced_accuracy": "balanced_accuracy",
    "precision": "precision",
    "recall": "true_retention",
    "specificity": "spurious_removal",
}
"""Metrics of labels that are pooled over walks, and what they are called of maps."""


class Share(NamedTuple):
    """What a room adds to a pooled figure.

    Attributes:
        model: whose figure it is.
        source: where it is from; its `tested_on` is one of a kind, `SETS` or `WALKS`.
        snr_db: entry of that column.
        metric: name of the figure.
        value: the figure in that room.
        draws: the same for resampled positions, shape (K,).
        units: number of positions or stretches that were drawn each time.
    """

    model: Model
    source: Recordings
    snr_db: str
    metric: str
    value: float
    draws: Array
    units: int


def set_shares(rows: Iterable[Row], source: Recordings, *, positions: int) -> list[Share]:
    """Return what a set made for testing adds: the draws that its rows have kept.

    Args:
        rows: rows of the set, of which those with `draws` serve.
        source: the set.
        positions: number of its positions.
    """
    if source.set_role != "test":
        return []
    pooled = Recordings(SETS, kind="pooled", noise=source.noise, set_role="test")
    names = Model._fields
    return [
        Share(
            Model(*(row[name] for name in names)),
            pooled,
            snr_db="",
            metric=row["metric"],
            value=row["value"],
            draws=row["draws"],
            units=positions,
        )
        for row in rows
        if "draws" in row
    ]


def walk_shares(
    given: Mapping[Model, Sequence[Predictions]], survey: LocalizedSurvey
) -> Iterator[Share]:
    """Yield what a walk adds, for each model and metric of its map."""
    labelled = survey.labelled
    poses = labelled.groups
    weights = stats.walk_weights(poses, resamples=len(labelled.weights))
    count = len(np.unique(poses))
    units = count // stats.stretch(count)
    source = Recordings(
        WALKS, kind="pooled", noise=labelled.source.noise, localizer=labelled.source.localizer
    )
    for model, predictions in given.items():

        def over_seeds(
            each: Array | None, predictions: Sequence[Predictions] = predictions
        ) -> dict[str, Array]:
            """Return the mean over seeds of each metric."""
            found = [
                metrics.rates(labelled.reference, one.kept, weights=each) for one in predictions
            ]
            return scoring.mean_of([{name: values[name] for name in OF_MAPS} for values in found])

        for name, (value, draws) in stats.resampled(over_seeds, weights).items():
            about_it = {"snr_db": survey.snr_db, "metric": OF_MAPS[name]}
            yield Share(model, source, value=value, draws=draws, units=units, **about_it)


def pooled_rows(shares: Iterable[Share]) -> Iterator[Row]:
    """Yield a row of results.csv for each model and metric over all rooms, if there are several."""
    for (model, source, snr_db, metric), each in _together(shares).items():
        found = _pool(each)
        figure: Row = {"value": found.figure.value, "ci_low": found.figure.low}
        figure |= {"ci_high": found.figure.high, "n": len(each), "seed": "", "snr_db": snr_db}
        yield model.columns() | source._asdict() | {"metric": metric} | figure


def pooled_tests(shares: Iterable[Share]) -> Iterator[Row]:
    """Yield a row of tests.csv for each model against the threshold of its training."""
    together = _together(shares)
    bare = baselines({key[0]: None for key in together})
    for (model, source, snr_db, metric), each in together.items():
        rival = bare.get(model.training, model)
        other = together.get((rival, source, snr_db, metric), [])
        if rival == model or model.split == "row" or len(other) != len(each):
            continue
        differences = [
            one._replace(value=one.value - two.value, draws=one.draws - two.draws)
            for one, two in zip(each, other, strict=True)
        ]
        found = _pool(differences)
        cells: Row = {"test": "bootstrap", "metric": metric, "snr_db": snr_db, "p": found.p}
        cells |= {"difference": found.figure.value, "ci_low": found.figure.low}
        cells |= {"ci_high": found.figure.high, "n": len(each)}
        family = ("bootstrap", source.tested_on, metric, model.training)
        yield about(Pair(model, rival, "baseline"), source) | cells | {"family": family}


Key = tuple[Model, Recordings, str, str]
"""What shares of one pooled figure have in common."""


def _together(shares: Iterable[Share]) -> dict[Key, list[Share]]:
    """Return the shares of each pooled figure, of those that every room adds to."""
    found: dict[Key, list[Share]] = defaultdict(list)
    for share in shares:
        found[share.model, share.source, share.snr_db, share.metric].append(share)
    # A mean over fewer rooms than the others' would be of other rooms.
    most: dict[tuple[Recordings, str], int] = defaultdict(int)
    for (_, source, snr_db, _), each in found.items():
        most[source, snr_db] = max(most[source, snr_db], len(each))
    return {key: each for key, each in found.items() if len(each) == most[key[1], key[2]] > 1}


def _pool(shares: Sequence[Share]) -> pooling.PooledFigures:
    values = np.array([share.value for share in shares])
    units = sum(share.units for share in shares)
    return pooling.pool(values, np.stack([share.draws for share in shares]), units=units)
