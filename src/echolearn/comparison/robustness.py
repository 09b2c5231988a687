"""How much a filter's AUC changes where the same positions are heard in another way.

A set whose rooms' sizes, positions and headings are an earlier one's, row by row, is that set under
another condition: another gain, a sample of latency, microphones beside their places, rotors, other
walls. Then the difference of two AUCs on the same positions is paired: resamples draw these
once for both. Labels are each model's own, of the echoes that were found there.

How many echoes can be told at all changes with the condition as well, so beside the difference
stands the ceiling's: the AUC of whoever knows whether the estimated time is that of a wall's echo
within `LOCKED` samples, which no chance hit is.
"""

from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation import metrics, stats
from echolearn.evaluation.rows import PAPER, Model, Predictions, Row

LOCKED = 2.0
"""Samples; an estimate that has found an echo is within one or two of it."""

COLUMNS = (
    "classifier trained_on target tested_on against auc difference ci_low ci_high "
    "ceiling ceiling_difference"
)
"""Columns of `robustness.csv`; differences are to the set in column `against`."""


def under_conditions(sets: Mapping[str, Dataset]) -> dict[str, str]:
    """Return of each set that repeats an earlier one's positions the name of that one."""
    found: dict[str, str] = {}
    first: dict[bytes, str] = {}
    for name, dataset in sets.items():
        places = [
            np.column_stack([dataset[key], dataset["heading"]]) for key in ("room", "position")
        ]
        known = first.setdefault(np.hstack(places).tobytes(), name)
        if known != name:
            found[name] = known
    return found


Answers = Mapping[str, Sequence[Predictions]]
"""What a model says about all rows of each set that it fits, seed by seed."""


def changes(
    model: Model, given: Answers, *, sets: Mapping[str, Dataset], resamples: int
) -> Iterator[Row]:
    """Yield the rows of a model, one for each set that repeats another's positions.

    Args:
        model: the model.
        given: what it says about the sets.
        sets: the sets by name.
        resamples: bootstrap draws.
    """
    target = model.target or PAPER
    for name, other in under_conditions(sets).items():
        if name in given and other in given:
            here = _Heard.of(sets[name], given[name], target=target)
            there = _Heard.of(sets[other], given[other], target=target)
            weights = stats.cluster_weights(sets[name]["group"], resamples=resamples)
            found = stats.interval(partial(_difference, here, there), weights)
            yield {
                "classifier": model.classifier,
                "trained_on": model.trained_on,
                "target": target,
                "tested_on": name,
                "against": other,
                "auc": float(here.auc(None)),
                "difference": found.value,
                "ci_low": found.low,
                "ci_high": found.high,
                "ceiling": here.ceiling,
                "ceiling_difference": here.ceiling - there.ceiling,
            }


class _Heard(NamedTuple):
    """One set as a model hears it: truth (B,), what each seed says, the ceiling's AUC."""

    truth: Array
    given: Sequence[Predictions]
    ceiling: float

    @classmethod
    def of(cls, dataset: Dataset, given: Sequence[Predictions], *, target: str) -> "_Heard":
        """Return what predictions say of a set.

        Args:
            dataset: of B rows.
            given: predictions of its rows, one for each seed.
            target: label that they are held against.
        """
        truth = dataset[target].astype(bool)
        # True by chance, without an echo at that time, cannot be told from false.
        ceiling = float(metrics.auc(truth, locked_on(dataset) * truth))
        return cls(truth, given, ceiling)

    def auc(self, weights: Array | None) -> Array:
        """Return the mean AUC over seeds, for weights (..., B) or None."""
        areas = []
        for each in self.given:
            drawn = None if weights is None else weights[..., each.rows]
            areas.append(metrics.auc(self.truth[each.rows], each.confidence, weights=drawn))
        mean: Array = np.mean(areas, axis=0)
        return mean


def _difference(here: _Heard, there: _Heard, weights: Array | None) -> Array:
    """Return how much higher the AUC is on the first of two sets."""
    return here.auc(weights) - there.auc(weights)


def locked_on(dataset: Dataset) -> Array:
    """Return 1 for each row whose estimated time is that of a wall's echo, else 0, shape (B,)."""
    rate = dataset.manifest["plan"]["scene"]["probe"]["sample_rate"]
    away = np.abs(dataset["toa"][:, None] - dataset["truth_toa"])
    nearest = np.nanmin(np.where(np.isnan(away), np.inf, away), axis=1)
    return (nearest * rate <= LOCKED).astype(float)
