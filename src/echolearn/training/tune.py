"""A search over a classifier's settings: which do best on validation rows.

    space, trial --suggest--> settings --fit on training rows--> decision on validation rows --> AUC
    all trials --best--> an experiment that `train` takes, a table, a page

Test rows have no part in it. Bayesian optimisation by tree-structured Parzen estimators (Bergstra
et al., NeurIPS 2011); networks whose validation figure is below the median of others' at an epoch
are stopped there. AUC and average precision look at the order of decisions alone, which no
calibration changes.

A study is continued by the same command, killed or not, and by several at once. `study.json` says
what it is about, `journal.log` keeps its trials; `manifest.json`, written last, says that all are
done. One process alone finds the same trials however often it was killed.
"""

import json
import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from echolearn.checks import BadValue, check, check_choice, check_name, check_whole
from echolearn.classifiers.classifier import Classifier
from echolearn.evaluation import metrics
from echolearn.evaluation.rows import to_csv
from echolearn.storage import files, manifests
from echolearn.storage.identity import canonical, plain
from echolearn.storage.once import locked
from echolearn.training.fitting import examples_of
from echolearn.training.search_space import Space
from echolearn.training.split import LearningProblem
from echolearn.training.tune_page import FoundSettings, experiment, tune_page

if TYPE_CHECKING:
    import optuna

ABOUT = "study.json"
PAGE = "tune.html"
TRIALS = "trials.csv"

METRICS = ("auc", "average_precision")


class Stopped(Exception):
    """A trial is worse than others were at that epoch."""


@dataclass(frozen=True)
class Tuning:
    """What is searched.

    Attributes:
        problem: what to learn from which rows.
        classifier: name of the classifier, as its configuration file has it.
        make: makes it, unfitted, with other values at some dotted keys.
        config: what it is made from without these, as plain containers, part of the identity.
        space: what the search may try.
        metric: figure on validation rows that shall be large, one of `METRICS`.
        seed: of the search; that of the problem is the classifier's, in all trials.
    """

    problem: LearningProblem
    classifier: str
    make: Callable[[Mapping[str, Any]], Classifier]
    config: Mapping[str, Any]
    space: Space
    metric: str = "auc"
    seed: int = 0

    def __post_init__(self) -> None:
        check_choice("metric", self.metric, *METRICS)
        check_whole("search_seed", self.seed, low=0, high=10_000)

    def identity(self) -> dict[str, Any]:
        """Return what tells this search from all others, whatever its number of trials."""
        told = ("classifier", "config", "space", "metric", "seed")
        about = {key: getattr(self, key) for key in told}
        return plain(about | {"problem": self.problem.identity()})


def tune(
    order: Tuning, *, name: str, runs: Path, trials: int = 50, command: str | None = None
) -> Path:
    """Search until there are so many trials; return the study's folder.

    Args:
        order: what is searched.
        name: of the folder under `runs/tune`, and of the experiment.
        runs: folder of everything generated.
        trials: number of them, with those of before.
        command: what continues the search, for its manifest.

    Raises:
        BadValue: the folder holds another search, or no trial came to an end.
    """
    check_name("name", name)
    check_whole("trials", trials, low=1, high=100_000)
    folder = Path(runs) / "tune" / name
    if _finished(folder, order, trials=trials):
        return folder
    # What is wrong with the settings, the space or the set is told before anything is written.
    order.problem.inputs(order.make({}).inputs)
    order.problem.parts()
    _begin(folder, order)

    from echolearn.training.trials import is_done, next_trial, open_study

    study = open_study(folder)
    while True:
        with next_trial(study, folder, trials=trials) as trial:
            if trial is None:
                break
            _try(study, trial, order=order)
    with locked(folder / "writing"):
        if not is_done(study, trials):
            print(f"{name}: another command is at the last trials", file=sys.stderr, flush=True)
        elif not _finished(folder, order, trials=trials):
            _write(folder, order, study=study, command=command)
    return folder


def _finished(folder: Path, order: Tuning, *, trials: int) -> bool:
    """Tell whether a folder holds this search whole, with so many trials at least."""
    try:
        found = manifests.verify(folder)
        same = canonical(files.load_json(folder / ABOUT)) == canonical(order.identity())
    except BadValue:
        return False
    return same and found["trials"] >= trials


def _begin(folder: Path, order: Tuning) -> None:
    """Say in a folder what is searched there.

    Raises:
        BadValue: something else is.
    """
    with locked(folder / "asking"):
        if not (folder / ABOUT).exists():
            files.save_json(folder / ABOUT, order.identity())
        same = canonical(files.load_json(folder / ABOUT)) == canonical(order.identity())
    allowed = "must be a search of the same classifier, set, space and seed"
    check(same, "folder", folder, allowed=allowed, hint="remove it, or give another name=")


def _try(study: "optuna.Study", trial: Any, *, order: Tuning) -> None:
    """Do one trial, and note its value, that it was stopped, or why it failed."""
    from optuna.trial import TrialState

    from echolearn.training.trials import suggested

    def watch(epoch: int, figure: float) -> None:
        """Note a network's figure of an epoch; stop it if others were better there."""
        trial.report(figure, epoch)
        if trial.should_prune():
            raise Stopped

    values = suggested(study, trial, space=order.space, seed=order.seed)
    try:
        value = score(order, values, watch=watch)
        check(math.isfinite(value), order.metric, value, allowed="must be a number")
    except Stopped:
        study.tell(trial, state=TrialState.PRUNED)
    except (BadValue, ArithmeticError) as error:
        trial.set_user_attr("error", f"{error}")
        study.tell(trial, state=TrialState.FAIL)
    else:
        study.tell(trial, value)
    ended = study.get_trials(deepcopy=False)[trial.number]
    result = f"{order.metric} {ended.value:.4f}" if ended.state.name == "COMPLETE" else ""
    shown = " ".join(f"{key}={_short(value)}" for key, value in values.items())
    print(f"trial {trial.number}: {result or ended.state.name.lower()} {shown}", file=sys.stderr)


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else json.dumps(value)


def score(
    order: Tuning, values: Mapping[str, Any], *, watch: Callable[[int, float], None] | None = None
) -> float:
    """Return the figure on validation rows of a classifier with these values.

    Args:
        order: what is searched.
        values: by dotted key.
        watch: called after each epoch of a network, with its number and a figure.
    """
    problem = order.problem
    model = order.make(values)
    with TemporaryDirectory() as place:
        about: Any = {"folder": Path(place), "watch": watch}
        examples = examples_of(model, problem, parts=problem.parts(), **about)
        model.fit(examples)
        unseen, labels = examples.validation
        decision = model.decision(unseen)
    return float(metrics.orders(labels, decision)[order.metric])


def _write(folder: Path, order: Tuning, *, study: "optuna.Study", command: str | None) -> None:
    """Write what came of a study; the manifest comes last.

    Raises:
        BadValue: no trial has a value.
    """
    from echolearn.training.trials import completed, importance

    every = study.get_trials(deepcopy=False)
    errors = [str(trial.user_attrs.get("error", "")) for trial in every]
    hint = next(filter(None, reversed(errors)), "")
    allowed = "must have one at least that came to an end"
    check(bool(completed(study)), "trials", len(every), allowed=allowed, hint=hint)
    # The last figure of a trial that was stopped is one of training, nothing to compare.
    values = {each.number: each.value for each in completed(study)}
    search = FoundSettings(
        folder.name,
        order.classifier,
        order.metric,
        order.space,
        [(n.number, n.state.name.lower(), values.get(n.number), n.params) for n in every],
        importance(study),
        command or "",
    )
    keys = list(order.space)
    rows = [
        {"number": number, "state": state, "value": "" if value is None else value}
        | {key: params.get(key, "") for key in keys}
        for number, state, value, params in search.trials
    ]
    made = {
        TRIALS: to_csv(rows, ["number", "state", "value", *keys]),
        f"experiment/{folder.name}.yaml": experiment(search).encode(),
        PAGE: tune_page(search),
    }
    for file, content in made.items():
        files.write_atomic(folder / file, content)
    about = {"kind": "tune", "trials": len(every), "best": search.best[1]}
    about |= manifests.command_entry(command)
    manifests.finish(folder, about, files=[ABOUT, *made])
    for line in search.edges():
        print(line, file=sys.stderr, flush=True)
