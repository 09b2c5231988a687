"""What the keys of a configuration stand for: paths, sets, surveys, and what a YAML builds.

    configuration, keys --built--> arguments of a call
    configuration       --open_set, recorded_survey--> what a command reads

What is not there is told with the command that makes it.
"""

import re
import shlex
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from echolearn.cli.config import Config
    from echolearn.comparison.walk_cells import Cell
    from echolearn.dataset.labelled_set import Dataset

RECORDED = "must be a folder in the recorded-survey format"


def open_set(config: "Config") -> "Dataset":
    """Open the set of a configuration's plan."""
    from echolearn.checks import check
    from echolearn.dataset.generate import folder_of, generate
    from echolearn.dataset.hypothesis_records import HypothesisPlan
    from echolearn.dataset.walk_plan import WalkPlan
    from echolearn.runtime.engines.processes import Processes

    if config["recorded"]:
        return opened_set(Path(config["recorded"]).resolve())
    plan = built(config, "plan")["plan"]
    place = folder_of(plan, runs=Path(config["runs"]))
    allowed = f"must be a set that exists under {place.parent}"
    hint = f"run: {_generating(config)}"
    check(place.is_dir(), "plan", place.name, allowed=allowed, hint=hint)
    if isinstance(plan, WalkPlan):
        # What is learned from walks are their wall hypotheses, sought once and kept.
        wanted = HypothesisPlan(plan)
        place = generate(wanted, runs=Path(config["runs"]), engine=Processes(workers=2))
    return opened_set(place.resolve())


def walk_cells(config: "Config", runs: Path, *, plan_of: "Callable[[Any], object]") -> "list[Cell]":
    """Open a configuration's sets of walks with their hypotheses, which are sought once and kept.

    Args:
        config: in plain containers.
        runs: folder of everything generated.
        plan_of: the plan that a set was made by.
    """
    from echolearn.checks import BadValue, check_list
    from echolearn.comparison.finding import find_set
    from echolearn.comparison.walk_cells import Cell
    from echolearn.dataset.generate import generate
    from echolearn.dataset.hypothesis_records import HypothesisPlan
    from echolearn.dataset.walk_plan import WalkPlan
    from echolearn.dataset.walk_set import WalkSet
    from echolearn.runtime.engines.processes import Processes

    check_list("walks", config["walks"])
    engine = Processes(workers=config["workers"])
    cells = []
    for name in config["walks"]:
        walks = WalkSet(find_set(runs, name))
        plan = plan_of(walks)
        if not isinstance(plan, WalkPlan):
            raise BadValue(f"walks={name}: must be a set of walks that was made on this machine")
        place = generate(HypothesisPlan(plan), runs=runs, engine=engine)
        cells.append(Cell(walks, opened_set(place.resolve())))
    return cells


def _generating(config: "Config") -> str:
    """Return the command line that makes the set on which a job trains: its words about the set."""
    from echolearn.cli.own import folder

    known = (folder() / "generate.yaml").read_text()
    words = shlex.split(config["command"])[2:]
    keys = [re.split(r"[.@=]", word)[0] for word in words]
    found = [re.search(rf"(?m)^(  - )?{re.escape(key)}:", known) for key in keys]
    options = [word.startswith("--config-dir=") for word in words]
    own = [word for word, *there in zip(words, found, options, strict=True) if any(there)]
    return shlex.join(["echolearn", "generate", *own])


@cache
def opened_set(place: Path) -> "Dataset":
    """Open a set once for all the jobs of a multirun: every byte of it is checked."""
    from echolearn.dataset.labelled_set import Dataset

    return Dataset(place)


def built(config: "Config", keys: str, *, prefix: str = "") -> "Config":
    """Return some keys of a configuration, built.

    Args:
        config: in plain containers.
        keys: their names, separated by blanks.
        prefix: what messages call the configuration that they stand in, "scene.".
    """
    from echolearn.cli.config import build

    return {key: build(config[key], f"{prefix}{key}") for key in keys.split()}


def without_inputs(classifier: "Config", columns: list[str]) -> "Config":
    """Return a classifier's configuration without some of its inputs.

    Raises:
        BadValue: one that it does not have, or all of them.
    """
    from echolearn.checks import check, check_list

    check_list("without", columns)
    inputs = list(classifier["inputs"])
    unknown = [name for name in columns if name not in inputs]
    check(not unknown, "without", unknown, allowed=f"must be some of {', '.join(inputs)}")
    left = [name for name in inputs if name not in columns]
    allowed = f"must leave one at least of {', '.join(inputs)}"
    check(bool(left), "without", columns, allowed=allowed)
    return {**classifier, "inputs": left}


def path_of(text: str | None) -> Path | None:
    """Return a path, or None where nothing is named."""
    return Path(text) if text else None


def recorded_survey(config: "Config", hint: str = "") -> Path:
    """Return the folder of the survey that a command reads, which is named or called by its path.

    Where none is named, the hint says what else could be given.

    Raises:
        BadValue: none is named, or no survey has the name.
    """
    given = needed(config, "survey", allowed=RECORDED, other=hint)
    return called(given, "survey", config=config, key="survey")


def named(config: "Config", key: str, *, place: str) -> Path | None:
    """Return the folder that a key names or whose path it is, or None where it is null.

    Args:
        config: in plain containers.
        key: its name.
        place: folder under `runs` where such folders lie.

    Raises:
        BadValue: the beginning of several names.
    """
    given = config[key]
    return called(given, place, config=config, key=key) if given else None


def called(given: str, place: str, *, config: "Config", key: str) -> Path:
    """Return the folder that a value names or whose path it is.

    Args:
        given: the value.
        place: folder under `runs` where such folders lie.
        config: in plain containers.
        key: whose value it is.

    Raises:
        BadValue: the name of nothing, or the beginning of several.
    """
    from echolearn.checks import check, suggest
    from echolearn.storage.kinds import KINDS, elsewhere
    from echolearn.storage.named import folder_named

    base = Path(config["runs"]) / place
    found = folder_named(given, place, runs=Path(config["runs"]), key=key)
    # What is a path is refused by whoever reads it, who knows why.
    if "/" in given or found.exists():
        return found
    known = sorted(each.name for each in base.glob("*") if each.is_dir())
    kind = next(name for name, each in KINDS.items() if each.place == place)
    hint = elsewhere(given, wanted=kind, runs=Path(config["runs"]))
    allowed = f"must be a folder, or the name of one under {base}"
    check(not (known or hint), key, given, allowed=allowed, hint=hint or suggest(given, known))
    return found


def needed(config: "Config", key: str, *, allowed: str, other: str = "") -> str:
    """Return what a key names that has no default: a folder, by its name or its path.

    Args:
        config: in plain containers.
        key: its name.
        allowed: what must be named.
        other: what could be given instead.
    """
    from echolearn.checks import check

    hint = f"name it: {' '.join(config['command'].split()[:2])} {key}=<folder>"
    if other:
        hint = f"{hint}, or {other}"
    check(bool(config[key]), key, config[key], allowed=allowed, hint=hint)
    return str(config[key])


def leave_out(beginnings: tuple[str, ...], command: str) -> str:
    """Return a command line without the words that have no influence on what it makes."""
    words = [word for word in shlex.split(command) if not word.startswith(beginnings)]
    return shlex.join(words)
