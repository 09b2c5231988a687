"""Runs of one classifier with several settings: what each is called, and which of them is shown.

    what a sweep varies --text--> c10, in the run's name --> a classifier of its own: svm_pair-c10
    runs without it whose settings differ --what differs--> the same
    select=best --balanced accuracy on a run's own validation rows--> one for each classifier

No test set and no survey has a say in that choice.
"""

import re
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fnmatch import fnmatchcase
from pathlib import Path
from statistics import mean
from typing import Any

from echolearn.checks import check, check_choice, printable
from echolearn.evaluation.rows import Model
from echolearn.storage import files
from echolearn.storage.identity import KIND, digest
from echolearn.training.runs import Run, load_runs

SELECTIONS = ("all", "best")
"""Which settings of a classifier a comparison shows."""

LONGEST = 40
"""Characters of what is varied, in a name; a longer text becomes its digest."""


def variant_text(varied: Mapping[str, Any]) -> str:
    """Return settings as a part of a name: `{"classifier.c_grid": [10.0]}` is `c10`.

    Of a dotted key only the end is told, where no other one ends in the same way.
    """
    ends = [_end(key) for key in varied]
    parts = []
    for key, value in varied.items():
        end = _end(key)
        if end == "_target_":
            # What a class is called says enough; with its package it would be a digest.
            parts.append(_plain(str(value).rpartition(".")[2]))
            continue
        name = end if ends.count(end) == 1 else key.removeprefix("classifier.")
        text = _plain(value)
        parts.append(f"{name}{text}" if text[:1].isdecimal() else f"{name}_{text}")
    text = "-".join(parts)
    return text if len(text) <= LONGEST else digest(text)


def _end(key: str) -> str:
    # A grid of one value is that value.
    return key.rpartition(".")[2].removesuffix("_grid")


def _plain(value: Any) -> str:
    """Return a value as text that can stand in the name of a folder."""
    if isinstance(value, list | tuple):
        return "_".join(map(_plain, value))
    if isinstance(value, float) and value.is_integer():
        value = int(value)
    return re.sub(r"[^\w.+-]+", "_", str(value)).strip("_")


@dataclass(frozen=True)
class Wanted:
    """Which finished runs are wanted.

    Attributes:
        among: patterns of names of runs or classifiers, as `trees_*`; none for all of them.
        select: one of `SELECTIONS`; best shows of each classifier, training set and label the
            settings of the largest mean balanced accuracy on validation rows.
    """

    among: Sequence[str] = ()
    select: str = "all"

    def __post_init__(self) -> None:
        check_choice("select", self.select, *SELECTIONS)


EVERY = Wanted()
"""All finished runs."""


def find_runs(runs: Path, wanted: Wanted = EVERY) -> tuple[list[Run], dict[Model, int]]:
    """Return finished runs, and of how many settings each model that was selected is the best.

    Raises:
        BadValue: a run is damaged or renamed, or a pattern has none.
    """
    among = wanted.among
    found = load_runs(runs)
    known = ", ".join(sorted({str(run.metrics["name"]) for run in found}))
    for pattern in among:
        allowed = f"must name one run at least under {runs / 'train'}"
        hint = f"there are those of {printable(known)}" if known else "there are none"
        check(any(_has(run, pattern) for run in found), "runs", pattern, allowed=allowed, hint=hint)
    chosen = [run for run in found if not among or any(_has(run, each) for each in among)]
    apart = told_apart(chosen)
    return best_of(apart) if wanted.select == "best" else (apart, {})


def _has(run: Run, pattern: str) -> bool:
    names = (run.identity, run.model.classifier, str(run.metrics["name"]))
    begins = run.identity.startswith(f"{pattern}-")
    return begins or any(fnmatchcase(name, pattern) for name in names)


def told_apart(found: Sequence[Run]) -> list[Run]:
    """Return runs of which no two have one model and seed: other settings, other name.

    What is there twice, as with and without cross-validation, is returned once.
    """
    groups = defaultdict(list)
    for run in found:
        groups[run.model].append(run)
    named: dict[tuple[Model, int], Run] = {}
    for group in groups.values():
        # Those of several seeds are one model; so they remain where nothing else is there.
        alone = len({run.seed for run in group}) == len(group)
        for run in group if alone else _named(group):
            known = named.setdefault((run.model, run.seed), run)
            if run.metrics.get("cross_validation") and not known.metrics.get("cross_validation"):
                named[run.model, run.seed] = run
    return sorted(named.values(), key=lambda run: run.identity)


def _named(group: Sequence[Run]) -> Iterator[Run]:
    """Yield runs of one model, each named after those of its settings that not all have."""
    settings = [dict(_settings(run)) for run in group]
    keys = dict.fromkeys(key for each in settings for key in each)
    varied = [key for key in keys if len({str(each.get(key)) for each in settings}) > 1]
    for run, each in zip(group, settings, strict=True):
        own = {key: each[key] for key in varied if key in each}
        yield replace(run, settings=variant_text(own))


def _settings(run: Run) -> Iterator[tuple[str, Any]]:
    """Yield what a run was made with, by dotted key, but for what a `Model` and its seed tell."""
    config = files.load_json(run.folder / "config.json")
    yield from _flat("classifier", config["classifier"])
    yield from ((key, config[key]) for key in ("calibration", "aim") if key in config)
    told = ("data", "test_share", "validation_share")
    yield from ((key, run.metrics[key]) for key in told)


def _flat(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """Yield the values of nested mappings, by dotted key; a kind by the name of what it is."""
    if not isinstance(value, Mapping):
        yield name, value
        return
    for key, item in value.items():
        yield from _flat(name if key == KIND else f"{name}.{key}", item)


def best_of(found: Sequence[Run]) -> tuple[list[Run], dict[Model, int]]:
    """Return the runs of the best settings of each classifier, and of how many they are the best.

    The figure is balanced accuracy on a run's own validation rows, the mean over its seeds.
    """
    variants: dict[Model, dict[Model, list[Run]]] = defaultdict(lambda: defaultdict(list))
    for run in found:
        classifier = run.model._replace(classifier=str(run.metrics["name"]))
        variants[classifier][run.model].append(run)
    shown = []
    selected = {}
    for each in variants.values():
        best = max(each, key=lambda model: (_validated(each[model]), model.classifier))
        shown += each[best]
        if len(each) > 1:
            selected[best] = len(each)
    return sorted(shown, key=lambda run: run.identity), selected


def _validated(runs: Sequence[Run]) -> float:
    return mean(float(run.metrics["validation"]["balanced_accuracy"]) for run in runs)


def selection_lines(selected: Mapping[Model, int]) -> list[str]:
    """Return what a table says of models that were selected from several settings."""
    rule = "balanced accuracy on its own validation rows alone"
    return [
        f"{model.classifier}, trained on {model.training}: the best of {count} settings by {rule}"
        for model, count in selected.items()
    ]
