"""Names of the folders of a multirun: no two jobs write one.

    jobs --default names--> those that meet --what differs between them--> names of their own

A name that was given holds. Walks, checks and maps whose usual names meet are named after what the
sweep varies besides: `walk-best-resolution_0.02`. Other commands, whose tables and bundles have a
name to be known by, leave that to whoever types: two jobs of one name are refused before the first.
Trained runs tell what a sweep varies of their classifier, `svm_pair-paper-s0-c10-<digest>`; that is
no part of their identity.
"""

import re
import shlex
from collections import defaultdict
from collections.abc import Mapping, Sequence
from glob import escape
from pathlib import Path
from typing import Any

from echolearn.checks import LONGEST_NAME, check
from echolearn.cli.config import UsageError
from echolearn.cli.own import options_of
from echolearn.storage.advice import PLACES, assignment, own_command, shell, text_of
from echolearn.storage.identity import digest
from echolearn.storage.kinds import check_kind
from echolearn.storage.manifests import MANIFEST, METRICS, load_manifest
from echolearn.storage.named import folder_named

Job = tuple[str, dict[str, Any]]

BY_CONTENT = ("generate", "label", "train")
"""Commands that name their folders after all that goes into them."""

BY_SWEEP = ("check", "fit", "import", "live", "map", "survey")
"""Commands that name theirs after what a sweep varies, where usual names meet."""


SETTINGS = (
    "classifier.",
    "+classifier.",
    "calibration=",
    "aim=",
    "test_share=",
    "validation_share=",
)
"""Beginnings of words that make another model of the same name."""

CHOOSING = "*?["
"""Characters of a pattern of names."""


def chosen_runs(text: str) -> tuple[Path, list[str]]:
    """Return the folder of everything generated and patterns of its runs, from a value of `runs`.

    That is a folder, or names or folders of runs: `trees_*,mlp_*`, in another folder
    `elsewhere/trees_*` or `elsewhere/train/trees_*`.

    Raises:
        UsageError: runs in several folders.
    """
    if not {*text} & {*CHOOSING, ","} and not _is_run(Path(text)):
        return Path(text), []
    paths = [Path(each.strip()) for each in text.split(",") if each.strip()]
    places = {path.parent.parent if path.parent.name == "train" else path.parent for path in paths}
    if len(places) != 1:
        raise UsageError(f"runs={text}: must be names of runs in one folder")
    [place] = places
    return (Path("runs") if place == Path() else place), [path.name for path in paths]


def _is_run(path: Path) -> bool:
    """Tell whether a path is a run, or the name of one or of several in the usual folder."""
    if path.is_dir():
        return (path / METRICS).is_file()
    usual = Path("runs/train")
    found = [usual / path / METRICS, *usual.glob(f"{escape(path.name)}-*/{METRICS}")]
    return len(path.parts) == 1 and any(each.is_file() for each in found)


def plan_of_folder(words: Sequence[str]) -> list[str]:
    """Return words in which a set, `plan=<its folder or name>`, is told by the words that made it.

    Raises:
        BadValue: the set was made elsewhere, so that nothing is known of its plan, or lies there.
    """
    typed = {word.partition("=")[0]: text_of(word.partition("=")[2]) for word in words}
    runs = Path(typed.get("runs", "runs"))
    given = typed.get("plan", "")
    if not given or given in options_of("plan"):
        return list(words)
    place = folder_named(given, "data", runs=runs, key="plan")
    if not (place / MANIFEST).is_file():
        return list(words)
    check_kind("plan", place, wanted="set", allowed="must be the name of a plan, or of a set")
    manifest = load_manifest(place)
    index = next(i for i, word in enumerate(words) if word.startswith("plan="))
    # What was recorded has no plan: it is named instead of one.
    if manifest["plan"].get("kind") == "recorded":
        return [*words[:index], assignment("recorded", str(place)), *words[index + 1 :]]
    made = shlex.split(own_command(manifest))[2:]
    allowed = "must be the name of a plan, or a set that was made here"
    check(bool(made), "plan", given, allowed=allowed, hint="of another set, type its plan")
    there = place.resolve().parent == (runs / "data").resolve()
    hint = f"add {assignment('runs', str(place.parents[1]))}"
    check(there, "plan", given, allowed=f"must be a set under {runs / 'data'}", hint=hint)
    own = [word for word in made if not word.startswith(("runs=", "--"))]
    return [*words[:index], *own, *words[index + 1 :]]


def with_adapted(words: Sequence[str]) -> list[str]:
    """Return words; those that adapt a filter, `init=`, and choose no classifier with a regression.

    A filter that is adapted has been chosen already, so the usual classifier is not meant.
    """
    typed = {word.partition("=")[0]: text_of(word.partition("=")[2]) for word in words}
    adapts = typed.get("init", "null") not in ("", "null")
    return [*words, "classifier=adapted"] if adapts and "classifier" not in typed else [*words]


def as_one_text(word: str) -> str:
    """Return a word, several names of runs as the one text that they are, not as a sweep."""
    key, _, value = word.partition("=")
    several = key == "runs" and "," in value and value[:1] not in "'\"["
    return assignment(key, value) if several else word


def usual_name(command: str, config: Mapping[str, Any]) -> str:
    """Return the name of the folder that a job makes unless it is given another."""
    if config.get("name") is not None:
        return str(config["name"])
    sources = {"map": ("survey", "bundle"), "check": ("survey",), "fit": ("survey",)}.get(
        command, ("run", "best")
    )
    return "-".join(Path(config[key]).resolve().name for key in sources if config.get(key))


def named_apart(command: str, jobs: Sequence[Job]) -> list[Job]:
    """Return jobs whose folders are all different, named after what differs where that is needed.

    Args:
        command: what they do.
        jobs: what was swept and configuration of each.

    Raises:
        UsageError: two jobs of one name.
    """
    if len(jobs) == 1:
        return list(jobs)
    if command in BY_CONTENT:
        return with_variants(jobs) if command == "train" else list(jobs)
    meeting = defaultdict(list)
    for job in jobs:
        meeting[_folder(command, job[1])].append(job)
    named = {}
    for group in meeting.values():
        shared = set.intersection(*(set(_words(job)) for job in group))
        for job in group:
            given = any(word.startswith("name=") for word in _words(job))
            alone = len(group) == 1 or given or command not in BY_SWEEP
            named[id(job)] = job if alone else _named(command, job, shared=shared)
    found = [named[id(job)] for job in jobs]
    given = any(word.startswith("name=") for job in jobs for word in _words(job))
    _check_apart(command, found, given=given)
    return found


def with_variants(jobs: Sequence[Job]) -> list[Job]:
    """Return jobs of a training, each with the settings that others of its classifier do not share.

    They stand under the key `varied`; a job that shares all of them has none.
    """
    groups = defaultdict(list)
    for job in jobs:
        groups[str(job[1].get("name")), str(job[1].get("choice"))].append(_settings(job))
    shared = {key: set.intersection(*map(set, each)) for key, each in groups.items()}
    told = []
    for swept, config in jobs:
        common = shared[str(config.get("name")), str(config.get("choice"))]
        own = [word for word in _settings((swept, config)) if word not in common]
        varied = {key: _value(config, key) for key, _, _ in (word.partition("=") for word in own)}
        told.append((swept, {**config, "varied": varied}))
    return told


def _settings(job: Job) -> list[str]:
    """Return the words of a job that set what its classifier and the division of rows are like."""
    return [word for word in _words(job) if word.startswith(SETTINGS)]


def _value(config: Any, key: str) -> Any:
    """Return the value of a dotted key, an index of a list being a part of it, too."""
    for part in key.lstrip("+").split("."):
        config = config[int(part)] if isinstance(config, list) else config[part]
    return config


def _folder(command: str, config: Mapping[str, Any]) -> Path:
    """Return the folder that a job writes."""
    place = Path(config["runs"]).resolve() / PLACES[command]
    return place if command == "bench" else place / usual_name(command, config)


def _words(job: Job) -> list[str]:
    return shlex.split(job[1]["command"])[2:]


def _named(command: str, job: Job, *, shared: set[str]) -> Job:
    """Return a job with the name of what it does not share with those of the same usual name.

    Args:
        command: what it does.
        job: what was swept, and its configuration.
        shared: words that all of them have.
    """
    swept, config = job
    own = [word for word in _words(job) if word not in shared]
    if not own:
        return job
    parts = [usual_name(command, config)]
    for key, _, value in (word.partition("=") for word in own):
        plain = re.sub(r"[^\w.+-]+", "-", text_of(value)).strip("-")
        parts.append(f"{key.rpartition('.')[2]}_{plain}")
    name = "-".join(parts)
    if len(name.encode()) > LONGEST_NAME:
        name = f"{parts[0]}-{digest(own)}"
    word = shlex.quote(assignment("name", name))
    return swept, {**config, "name": name, "command": f"{config['command']} {word}"}


def _check_apart(command: str, jobs: Sequence[Job], *, given: bool) -> None:
    """Raise `UsageError` if two jobs write one folder.

    Args:
        command: what they do.
        jobs: what was swept and configuration of each.
        given: whether a name was typed.
    """
    seen: dict[Path, str] = {}
    for swept, config in jobs:
        folder = _folder(command, config)
        if folder in seen:
            both = " and ".join(dict.fromkeys(filter(None, (seen[folder], swept)))) or "two of them"
            advice = _advice(command, folder, swept=swept)
            if command in BY_SWEEP and not given:
                advice = "do they differ but in how they are written?"
            raise UsageError(f"{both}: both would write {folder}; {advice}")
        seen[folder] = swept


def _advice(command: str, folder: Path, *, swept: str) -> str:
    """Return how jobs that write one folder are told apart."""
    if command in BY_SWEEP:
        return "leave name= out, and each is named after what the sweep varies"
    if command == "bench":
        return f"run echolearn {command} once for each"
    key = swept.partition("=")[0] or "<key>"
    example = f"name='{folder.name}-${{{key}}}'"
    return f"give each a name, as by {shell(example)}"
