"""The command `tune`."""

import shlex
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from echolearn.cli.keys import built, leave_out, open_set

if TYPE_CHECKING:
    from echolearn.cli.config import Config


def tune_classifier(config: "Config") -> Path:
    """Search over a classifier's settings by its validation rows; continues where it was killed."""
    from echolearn.checks import check
    from echolearn.cli.config import build
    from echolearn.cli.own import search_space
    from echolearn.cli.searches import fitted_to
    from echolearn.storage.identity import by_short_names
    from echolearn.training.search_space import read_space, with_values
    from echolearn.training.split import LearningProblem
    from echolearn.training.tune import Tuning, tune

    allowed = "must be there"
    there = find_spec("optuna") is not None
    check(there, "library", "optuna", allowed=allowed, hint="pip install 'echolearn[tune]'")
    classifier = config["classifier"]
    if config["space"] is None:
        plain, file = search_space(config["choice"]["classifier"])
    else:
        plain, file = fitted_to(config["space"], classifier), "space"
    space = read_space(plain, name=file)
    # A key that is not there is told before any work.
    with_values(classifier, space)
    division = built(config, "target seed split test_share validation_share train_rows")
    order = Tuning(
        LearningProblem(open_set(config), **division),
        config["choice"]["classifier"],
        lambda values: build(with_values(classifier, values), "classifier"),
        config=by_short_names(classifier),
        space=space,
        metric=config["metric"],
        seed=config["search_seed"],
    )
    command = leave_out(("trials=",), config["command"])
    return tune(
        order,
        name=config["name"],
        runs=Path(config["runs"]),
        trials=config["trials"],
        command=shlex.join([*shlex.split(command), f"trials={config['trials']}"]),
    )
