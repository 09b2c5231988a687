"""How far what is tested lies from what was trained on, column by column: the rows of `shifts.csv`.

`distance` is Kolmogorov's, the largest difference of the two distribution functions, 0 to 1.
`outside` is the share of tested values beyond the 0.5 and 99.5 % quantiles of the trained ones,
0.01 where nothing has shifted: there a classifier extrapolates, and its confidence means little.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import ks_2samp

from echolearn.acoustics.types import Array
from echolearn.classifiers.inputs import FEATURES, view_of
from echolearn.comparison.choice import Comparison
from echolearn.comparison.tables import main_localizer
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation.rows import Row

COLUMNS = "trained_on tested_on localizer column distance outside".split()
"""Columns of `shifts.csv`."""

TAIL = 0.005
"""Share of the trained values on either side that count as outside themselves."""


class Tested(NamedTuple):
    """What is tested: a set, a walk, or recorded surveys; `columns[name]` has shape (B,)."""

    tested_on: str
    localizer: str
    columns: Any


def shift_rows(comparison: Comparison, trained: Mapping[str, Path]) -> Iterator[Row]:
    """Yield a row for each training set, tested recordings and column that some run looks at.

    Args:
        comparison: what was tested.
        trained: folders of training sets by their digests.
    """
    for digest, names in inputs_seen(comparison).items():
        if digest not in trained:
            continue
        training = Dataset(trained[digest])
        known = [name for name in names if training.holds([name])]
        columns = {name: training[name].astype(float) for name in known}
        for tested in everything(comparison, but=digest):
            for name, values in columns.items():
                if _has(tested.columns, name):
                    about = {"trained_on": training.name, "tested_on": tested.tested_on}
                    about |= {"localizer": tested.localizer, "column": name}
                    yield about | compare_columns(
                        values, np.asarray(tested.columns[name], dtype=float)
                    )


def inputs_seen(comparison: Comparison) -> dict[str, list[str]]:
    """Return the columns that runs look at, by the digest of the set they were trained on."""
    found: dict[str, dict[str, None]] = {}
    for runs in comparison.models.values():
        for run in runs:
            if view_of(run.inputs) == FEATURES:
                found.setdefault(run.data_digest, {}).update(dict.fromkeys(run.inputs))
    return {digest: list(names) for digest, names in found.items()}


def everything(comparison: Comparison, *, but: str) -> Iterator[Tested]:
    """Yield all that is tested, walks as their main localizer hears them, but one set."""
    for name, dataset in comparison.sets.items():
        if dataset.digest != but:
            yield Tested(name, "", dataset)
    heard = main_localizer(comparison)
    for kind in (comparison.surveys, comparison.measured):
        for (name, localizer), rows in kind.items():
            if localizer == heard:
                yield Tested(name, localizer, rows.columns)


def compare_columns(trained: Array, tested: Array) -> dict[str, float]:
    """Return distance and share outside of tested values (B,) from trained ones (C,)."""
    low, high = np.quantile(trained, [TAIL, 1 - TAIL])
    outside = float(np.mean((tested < low) | (tested > high)))
    distance = ks_2samp(trained, tested, method="asymp").statistic
    return {"distance": float(distance), "outside": outside}


def _has(columns: Dataset | Mapping[str, Sequence[float]], name: str) -> bool:
    return columns.holds([name]) if isinstance(columns, Dataset) else name in columns
