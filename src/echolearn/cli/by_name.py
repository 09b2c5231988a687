"""Classifiers by name, as `classifier=<name>` builds them: `echolearn.filter`."""

from typing import Any

from echolearn.cli.compose import compose
from echolearn.cli.config import build
from echolearn.training.estimator import Filter


def filter_named(
    classifier: str = "trees_features", *, seed: int = 0, any_columns: bool = False, **settings: Any
) -> Filter:
    """Return a classifier as an estimator: `filter("svm_pair").fit(X, y).predict_proba(X)`.

    Args:
        classifier: name of a file in `conf/classifier`.
        seed: of everything random.
        any_columns: learn on whatever columns X has, rather than on those of the classifier.
        settings: keys of that file, as `iterations=50`.

    Raises:
        BadValue: no classifier of that name, no such key, or a value out of range.
    """
    [(_, config)] = compose("train", [f"classifier={classifier}"])
    return Filter(
        build(config["classifier"] | settings, "classifier"), seed=seed, any_columns=any_columns
    )
