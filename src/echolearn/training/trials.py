"""The trials of a search, by Optuna, in a journal that several processes write.

    journal --next_trial--> a trial that nobody works at --suggest, fit, score--> journal

Each value of trial k is drawn by a seed of its own, so it depends on the trials that ended before
it and on nothing else. Whoever works at a trial holds a lock that the system frees when the process
ends, even by SIGKILL; another one, or the same command again, then takes the trial over with the
values that it has. A line that a killed process has left half written is cut off.
"""

from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Any

import optuna
from optuna.pruners import MedianPruner
from optuna.samplers import TPESampler
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, Trial, TrialState

from echolearn.storage.identity import digest
from echolearn.storage.once import claimed, locked
from echolearn.training.search_space import Space

JOURNAL = "journal.log"

FIRST = 10
"""Trials that are drawn blindly before any is drawn near the good ones."""

WARM_UP = 5
"""Epochs before a network may be stopped for being worse than the median of others."""

DONE = (TrialState.COMPLETE, TrialState.PRUNED, TrialState.FAIL)


class JournalLock:
    """Keeps processes from writing one journal at once; a killed one keeps nobody out."""

    def __init__(self, journal: Path) -> None:
        """Make a lock for a journal, which need not exist."""
        self.journal = journal
        self.held: AbstractContextManager[Path] | None = None

    def acquire(self) -> bool:
        """Wait for the lock, and cut off what a killed process has not written whole."""
        self.held = locked(self.journal)
        self.held.__enter__()
        if self.journal.exists():
            content = self.journal.read_bytes()
            whole = content.rfind(b"\n") + 1
            if whole < len(content):
                with self.journal.open("r+b") as file:
                    file.truncate(whole)
        return True

    def release(self) -> None:
        """Let others write."""
        if self.held is not None:
            self.held.__exit__(None, None, None)


def open_study(folder: Path) -> optuna.Study:
    """Return the study whose journal lies in a folder, begun if there is none."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    journal = folder / JOURNAL
    lock: Any = JournalLock(journal)
    storage = JournalStorage(JournalFileBackend(str(journal), lock))
    pruner = MedianPruner(n_startup_trials=FIRST // 2, n_warmup_steps=WARM_UP)
    with locked(folder / "asking"):
        return optuna.create_study(
            storage=storage,
            study_name="study",
            direction="maximize",
            pruner=pruner,
            load_if_exists=True,
        )


@contextmanager
def next_trial(study: optuna.Study, folder: Path, *, trials: int) -> Iterator[Any]:
    """Yield a trial that nobody else works at, or None if all are done or in other hands.

    Args:
        study: whose trials.
        folder: of the study.
        trials: number of them in the end.
    """
    with ExitStack() as held:
        trial = None
        with locked(folder / "asking"):
            for left in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
                # Whoever worked at it has ended without an end of it.
                if held.enter_context(claimed(_mark(folder, left))):
                    trial = Trial(study, left._trial_id)
                    break
            if trial is None and len(study.get_trials(deepcopy=False)) < trials:
                trial = study.ask()
                held.enter_context(claimed(_mark(folder, trial)))
        yield trial


def suggested(study: optuna.Study, trial: Trial, *, space: Space, seed: int) -> dict[str, Any]:
    """Return the settings of a trial by key; those that it has already stay.

    Args:
        study: whose trial.
        trial: one of `next_trial`.
        space: what may be tried.
        seed: of the search.
    """
    values = {}
    for index, (key, each) in enumerate(space.items()):
        # Each has a seed of its own: whoever goes on in the middle draws the rest alike.
        own = int(digest([seed, trial.number, index])[:8], 16)
        study.sampler = TPESampler(seed=own, n_startup_trials=FIRST)
        values[key] = each.suggest(trial, key)
    return values


def _mark(folder: Path, trial: Trial | FrozenTrial) -> Path:
    return folder / f"trial-{trial.number}"


def is_done(study: optuna.Study, trials: int) -> bool:
    """Tell whether a study has so many trials, and all of its trials have ended."""
    every = study.get_trials(deepcopy=False)
    return len(every) >= trials and all(each.state in DONE for each in every)


def completed(study: optuna.Study) -> list[FrozenTrial]:
    """Return the trials that have a value, in the order of their numbers."""
    return study.get_trials(deepcopy=False, states=(TrialState.COMPLETE,))


def importance(study: optuna.Study) -> dict[str, float]:
    """Return how much of the value's variation each key explains; nothing after few trials."""
    known = completed(study)
    if len(known) < FIRST or len({trial.value for trial in known}) < 2:
        return {}
    evaluator = optuna.importance.FanovaImportanceEvaluator(seed=0)
    return optuna.importance.get_param_importances(study, evaluator=evaluator)
