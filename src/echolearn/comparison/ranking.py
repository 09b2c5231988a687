"""Ranks of the models of a training over conditions: the rows of `ranks.csv`.

A condition is a band of SNR of a set made for testing; where no set is, a band of any set. No two
share a row. A model's figure there is its AUC, the mean over seeds.
"""

from typing import NamedTuple

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.comparison.choice import Comparison, headline
from echolearn.comparison.pivot import pivot
from echolearn.evaluation import ranks
from echolearn.evaluation.rows import Row, pick

COLUMNS = "classifier trained_on mean_rank conditions critical_difference p_friedman p_best".split()
"""Columns of `ranks.csv`."""


class Ranking(NamedTuple):
    """Models by their ranks, best first.

    Attributes:
        names: the k models.
        ranks: mean rank of each, shape (k,).
        conditions: number of conditions, N.
        difference: critical difference of two mean ranks.
        p: of Friedman's test that none differs.
        p_pairs: of each pair by Wilcoxon's test, corrected by Holm, shape (k, k).
    """

    names: list[str]
    ranks: Array
    conditions: int
    difference: float
    p: float
    p_pairs: Array


def rank_models(comparison: Comparison) -> Ranking | None:
    """Return the ranks of the headline's models; None of fewer than three, or two conditions."""
    rows = pick(comparison.rows, kind="set", metric="auc", seed="", training=headline(comparison))
    tested = pick(rows, set_role="test") or rows
    banded = [row for row in tested if row["snr_db"] and np.isfinite(row["value"])]
    table = pivot(
        [{**row, "cell": _condition(row)} for row in banded], lines=("classifier",), cells="cell"
    )
    conditions = list(dict.fromkeys(_condition(row) for row in banded))
    # A band in which one class is missing has no AUC: it is one for nobody.
    whole = [each for each in conditions if all(each in line for line in table.values())]
    if len(table) < 3 or len(whole) < 2:
        return None
    values = np.array([[line[each]["value"] for line in table.values()] for each in whole])
    mean = ranks.mean_ranks(values)
    order = np.argsort(mean, kind="stable")
    names = [classifier for (classifier,) in table]
    return Ranking(
        [names[place] for place in order],
        mean[order],
        conditions=len(whole),
        difference=ranks.critical_difference(len(names), conditions=len(whole)),
        p=ranks.friedman(values)[1],
        p_pairs=ranks.wilcoxon_holm(values)[np.ix_(order, order)],
    )


def rank_rows(ranking: Ranking, training: str) -> list[Row]:
    """Return the rows of `ranks.csv`."""
    shared = {
        "trained_on": training,
        "conditions": ranking.conditions,
        "critical_difference": ranking.difference,
        "p_friedman": ranking.p,
    }
    pairs = zip(ranking.names, ranking.ranks, ranking.p_pairs[0], strict=True)
    return [
        {"classifier": name, "mean_rank": float(rank), "p_best": float(p)} | shared
        for name, rank, p in pairs
    ]


def _condition(row: Row) -> tuple[str, str]:
    return row["tested_on"], row["snr_db"]
