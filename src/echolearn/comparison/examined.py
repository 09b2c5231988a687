"""A comparison looked at more closely: ranks, importance, shifts, the worst errors, warnings.

Comparison --examine--> Examined --draw_examined--> figures, --examined_facts--> the report
"""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import mean
from typing import Any, NamedTuple

from echolearn.acoustics.types import Array, Truth
from echolearn.comparison.choice import Comparison, away, closely, headline, trained
from echolearn.comparison.ranking import Ranking
from echolearn.comparison.warnings import CODES, Warned
from echolearn.evaluation.rows import Model, Row, pick

BELIEVED, MISSED = "believed", "missed"
"""Spurious echoes with the largest confidence, true ones with the smallest."""


class Picture(NamedTuple):
    """What was heard where an error was made.

    Attributes:
        row: its row of `worst.csv`.
        response: J(tau, phi) over its maximum, shape (A, L).
        azimuths: of its A directions, in rad, rising.
        distances: of its L lags, c tau / 2, in m.
        truth: times and directions of the walls, fields (W,).
        speed_of_sound: in m/s.
    """

    row: Row
    response: Array
    azimuths: Array
    distances: Array
    truth: Truth
    speed_of_sound: float


@dataclass(frozen=True)
class Worst:
    """Errors of the chosen model's first seed on the set whose curves are drawn.

    Attributes:
        rows: the errors, of either kind the surest first.
        pictures: of some of them; none where the set's plan is not known.
    """

    rows: list[Row]
    pictures: list[Picture]


@dataclass(frozen=True)
class Examined:
    """What is known of a comparison besides its tables.

    Attributes:
        ranking: ranks of the headline's models; None where there is nothing to rank.
        importance: rows of `importance.csv`.
        shifts: rows of `shifts.csv`.
        worst: errors of which the chosen model was surest.
        warnings: what a reader should know first.
        selected: lines on models that stand for others of other settings.
    """

    ranking: Ranking | None = None
    importance: Sequence[Row] = ()
    shifts: Sequence[Row] = ()
    worst: Worst = Worst([], [])
    warnings: Sequence[Warned] = ()
    selected: Sequence[str] = ()


def examined_facts(examined: Examined, comparison: Comparison) -> dict[str, Any]:
    """Return what the report's template shows of it, and of tests besides the first ones."""
    tests = comparison.tests
    source = headline(comparison)
    return {
        "ranking": examined.ranking,
        "important": examined.importance,
        "worst_rows": examined.worst.rows,
        "warnings": examined.warnings,
        "selected": examined.selected,
        "codes": CODES,
        "pooled": pooled_lines(comparison, source),
        "best_rival": closely(comparison.models, comparison.roles)
        .get(source, Model(""))
        .classifier,
        "against_best": pick([row for row in tests if row.get("rival") == "best"], training=source),
        "ablations": [row for row in tests if row["without"] and row.get("rival") == "full"],
        "folds": pick(tests, test="nadeau_bengio"),
    }


def pooled_lines(comparison: Comparison, training: str) -> list[dict[str, Any]]:
    """Return the pooled figures of a training, each with its test against the threshold, if any."""
    rows = pick(comparison.rows, kind="pooled", training=training)
    shown = pick(rows, metric="balanced_accuracy", tested_on="walks") + pick(rows, metric="auc")
    tests = pick(comparison.tests, test="bootstrap", training=training)
    keys = ("classifier", "tested_on", "metric", "snr_db")
    known = {tuple(row[key] for key in keys): row for row in tests}
    return [{"row": row, "test": known.get(tuple(row[key] for key in keys))} for row in shown]


def learning_curves(comparison: Comparison) -> dict[str, list[Row]]:
    """Return AUC over training rows for each model that was trained on several numbers of them.

    The rows are those of the set whose curves are drawn, with the number as `train`.
    """
    shown = away(comparison)
    whole = pick(comparison.rows, tested_on=shown, seed="", snr_db="", metric="auc")
    lines: dict[Model, dict[float, Row]] = {}
    # The model on all rows comes last: asked for more than there are, another one has as many.
    known = trained(comparison)
    for model in sorted(known, key=lambda model: model.train_rows == ""):
        taught = mean(run.metrics["rows"]["train"] for run in known[model])
        for row in pick(whole, **model._asdict()):
            line = lines.setdefault(model._replace(train_rows=""), {})
            line[taught] = row | {"train": taught}
    return {
        f"{model.classifier}, {model.training}": [line[taught] for taught in sorted(line)]
        for model, line in lines.items()
        if len(line) > 1
    }
