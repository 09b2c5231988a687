"""A comparison looked at more closely: ranks, importance, shifts, the worst errors, warnings.

Comparison --examine--> Examined --examined_files--> CSV files, --examined_facts--> the report
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean
from typing import Any

from echolearn.comparison import importance, ranking, shifts, warnings, worst
from echolearn.comparison.choice import Comparison, closely, headline, trained
from echolearn.comparison.importance import importance_rows
from echolearn.comparison.ranking import Ranking, rank_models, rank_rows
from echolearn.comparison.shifts import shift_rows
from echolearn.comparison.tables import away
from echolearn.comparison.warnings import CODES, Warned, all_warnings
from echolearn.comparison.worst import PlanOf, Worst, worst_errors
from echolearn.evaluation.rows import Model, Row, pick, to_csv


@dataclass(frozen=True)
class Examined:
    """What is known of a comparison besides its tables.

    Attributes:
        ranking: ranks of the headline's models; None where there is nothing to rank.
        importance: rows of `importance.csv`.
        shifts: rows of `shifts.csv`.
        worst: errors of which the chosen model was surest.
        warnings: what a reader should know first.
    """

    ranking: Ranking | None = None
    importance: Sequence[Row] = ()
    shifts: Sequence[Row] = ()
    worst: Worst = Worst([], [])
    warnings: Sequence[Warned] = ()


def examine(
    comparison: Comparison, *, trained: Mapping[str, Path], plan_of: PlanOf, resamples: int
) -> Examined:
    """Look at a comparison more closely.

    Args:
        comparison: what was found.
        trained: folders of training sets by their digests.
        plan_of: the plan that a set was made by.
        resamples: bootstrap draws behind intervals.
    """
    moved = list(shift_rows(comparison, trained))
    return Examined(
        rank_models(comparison),
        importance=list(importance_rows(comparison, resamples=resamples)),
        shifts=moved,
        worst=worst_errors(comparison, plan_of),
        warnings=all_warnings(comparison, trained=trained, shifts=moved),
    )


def examined_files(examined: Examined, comparison: Comparison) -> dict[str, bytes]:
    """Return the CSV files of what was found, by name."""
    ranked = examined.ranking
    rows = rank_rows(ranked, headline(comparison)) if ranked else []
    warned = [each._asdict() for each in examined.warnings]
    return {
        "ranks.csv": to_csv(rows, ranking.COLUMNS),
        "importance.csv": to_csv(examined.importance, importance.COLUMNS),
        "shifts.csv": to_csv(examined.shifts, shifts.COLUMNS),
        "worst.csv": to_csv(examined.worst.rows, worst.COLUMNS),
        "warnings.csv": to_csv(warned, warnings.COLUMNS),
    }


def examined_facts(examined: Examined, comparison: Comparison) -> dict[str, Any]:
    """Return what the report's template shows of it, and of tests besides the first ones."""
    tests = comparison.tests
    source = headline(comparison)
    return {
        "ranking": examined.ranking,
        "important": examined.importance,
        "worst_rows": examined.worst.rows,
        "warnings": examined.warnings,
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
