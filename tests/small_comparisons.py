"""Comparisons by hand: rows, models with runs that have a validation figure, and nothing else."""

from dataclasses import replace
from pathlib import Path

from echolearn.comparison.choice import Comparison
from echolearn.evaluation.rows import Model, Recordings
from echolearn.training.runs import Run

COLUMNS = ("toa",)
TENSOR = ("covariance",)


def row(classifier, trained_on, tested_on, value, **more):
    """Return a row of results on a set with the mean over seeds."""
    role, split, target = ("reference", "", "") if trained_on == "-" else LEARNED
    model = Model(classifier, trained_on, role, "", split, target)
    common = {"seed": "", "snr_db": "", "metric": "auc", "value": value}
    return model.columns() | Recordings(tested_on, "set")._asdict() | common | more


LEARNED = ("learned", "position", "reflector")


def trained(classifier, trained_on, *balanced, method="svm", **more):
    """Return a model with a run per seed that has these validation figures."""
    inputs = TENSOR if classifier.startswith("covnet") else COLUMNS
    role = "baseline" if method == "threshold" else "learned"
    model = Model(classifier, trained_on, role, method, "position", "reflector")._replace(**more)
    runs = []
    for seed, share in enumerate(balanced):
        figures = {"validation": {"balanced_accuracy": share}, "seed": seed, "inputs": inputs}
        figures["data"] = trained_on
        runs.append(Run(Path(), figures))
    return model, runs


def bare(*models, **more):
    """Return a comparison that knows nothing else."""
    return replace(Comparison(dict(models), {}, {}, {}, [], []), **more)
