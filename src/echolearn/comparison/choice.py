"""Which models a comparison shows and exports.

The choice is made by figures on a run's own validation rows: no test set, no survey has a say.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import mean

from echolearn.classifiers.inputs import view_of
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation.rows import BUNDLE, UNFIT, LocalizedSurvey, MeasuredRows, Model, Row, pick
from echolearn.training.runs import Run

ALSO_DRAWN = ("svm_pair", "covnet")
"""Classifiers that are drawn, good or not: the paper's pair and the literature's network."""


@dataclass(frozen=True)
class Comparison:
    """Everything a report is made of.

    Attributes:
        models: finished runs of each model, one for each seed; bundles among them.
        roles: what each training set was made for, by its plan's name.
        sets: labelled test sets by name.
        surveys: localized surveys, by the names of survey and localizer.
        rows: rows of results.csv.
        tests: rows of tests.csv.
        measured: echoes of recorded surveys, by the names of their group and localizer.
        repeated: rows of robustness.csv, on sets that repeat others under another condition.
    """

    models: Mapping[Model, Sequence[Run]]
    roles: Mapping[str, str]
    sets: Mapping[str, Dataset]
    surveys: Mapping[tuple[str, str], LocalizedSurvey]
    rows: Sequence[Row]
    tests: Sequence[Row]
    measured: Mapping[tuple[str, str], MeasuredRows] = field(default_factory=dict)
    repeated: Sequence[Row] = ()


def headline(comparison: Comparison) -> str:
    """Return the training that the maps' tables are about.

    That is one on a set made for training, if there is any, and rather on one that is tested, too;
    of several on one set, one on all of its rows and columns, whose positions are never parted.
    """
    # What was made for another robot leaves no map of these surveys.
    unfit = pick(comparison.rows, kind="survey", metric=UNFIT)
    others = {row["training"] for row in unfit if row["role"] != BUNDLE}

    def order(model: Model) -> tuple[bool, bool, bool, bool, str]:
        """Return what trainings are ranked by: whether they fit, are tested, made for training."""
        name = model.trained_on
        made_for_it = comparison.roles.get(name) == "training"
        partial = model != model.full or model.split == "row"
        untested = name not in comparison.sets
        return model.training in others, untested, not made_for_it, partial, model.training

    return min(trained(comparison), key=order).training


def trained(comparison: Comparison) -> Mapping[Model, Sequence[Run]]:
    """Return the finished runs alone, of which validation rows are known; no bundles."""
    every = comparison.models.items()
    return {model: runs for model, runs in every if model.role != BUNDLE}


def is_evaluated(comparison: Comparison, model: Model, *, name: str) -> bool:
    """Tell whether a model has figures on a set: it fits its robot and its columns.

    Args:
        comparison: what has been evaluated.
        model: one of its models.
        name: of one of its sets.
    """
    rows = pick(comparison.rows, tested_on=name, kind="set", **model._asdict())
    return any(row["metric"] not in UNFIT for row in rows)


def ranked(comparison: Comparison, training: str) -> list[Model]:
    """Return the models of a training, best balanced accuracy on validation rows first."""
    shares = {}
    for model, runs in trained(comparison).items():
        if model.training == training:
            shares[model] = _shown(runs)
    return sorted(shares, key=lambda model: (-shares[model], model.classifier))


def closely(models: Mapping[Model, Sequence[Run]], roles: Mapping[str, str]) -> dict[str, Model]:
    """Return the best learned model of each training that is made to be used, by training.

    The others are tested against it: of sets made for training, or of all if there are none, where
    a bare threshold is among them.
    """
    compared = {model.training for model in models if model.role == "baseline"}
    made = [model for model in models if roles.get(model.trained_on) == "training"]
    best: dict[str, Model] = {}
    for model in made or models:
        if model.role != "learned" or model != model.full or model.training not in compared:
            continue
        known = best.setdefault(model.training, model)
        if _shown(models[model]) > _shown(models[known]):
            best[model.training] = model
    return best


def _shown(runs: Sequence[Run]) -> float:
    """Return the mean balanced accuracy of runs on their own validation rows."""
    return mean(map(_validated, runs))


def chosen(comparison: Comparison) -> Model:
    """Return the headline's best learned model, or its best baseline if none is learned."""
    models = ranked(comparison, headline(comparison))
    # A baseline may well be best, but what is exported should have learned something.
    learned = [model for model in models if model.role == "learned"]
    return (learned or models)[0]


def chosen_run(comparison: Comparison) -> Run:
    """Return the run that is worth exporting: the best seed of the chosen model."""
    runs = comparison.models[chosen(comparison)]
    return max(runs, key=lambda run: (_validated(run), -run.seed))


def drawn(comparison: Comparison) -> list[Model]:
    """Return the headline's models that are drawn: the best of each family, and `ALSO_DRAWN`.

    A family is a method on a view: networks on columns and on covariances are two.
    """
    found = []
    families = set()
    for model in ranked(comparison, headline(comparison)):
        family = (model.method, view_of(comparison.models[model][0].inputs))
        if family not in families or model.classifier in ALSO_DRAWN:
            found.append(model)
        families.add(family)
    return found


def _validated(run: Run) -> float:
    return float(run.metrics["validation"]["balanced_accuracy"])


def away(comparison: Comparison) -> str:
    """Return the set whose curves are drawn: the first made for testing, or the last one."""
    for name, dataset in comparison.sets.items():
        if dataset.manifest["plan"]["role"] == "test":
            return name
    return list(comparison.sets)[-1]
