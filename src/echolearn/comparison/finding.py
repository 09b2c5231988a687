"""Where the sets and surveys are that a comparison names, and what tells them from others."""

import re
from collections.abc import Collection
from difflib import get_close_matches
from glob import escape
from pathlib import Path

from echolearn.checks import check
from echolearn.dataset.labelled_set import FORMAT
from echolearn.storage.advice import assignment, command_line
from echolearn.storage.files import sha256
from echolearn.storage.identity import digest
from echolearn.storage.journal import JOURNAL
from echolearn.storage.kinds import check_kind, elsewhere
from echolearn.storage.manifests import MANIFEST, load_manifest, verify
from echolearn.storage.named import folder_called
from echolearn.survey.proof import used
from echolearn.survey.reader import read_survey

BEGUN = ("simulated.json", "imported.json")
"""Files of surveys that a command makes: without a manifest it has not finished them."""


def find_set(runs: Path, name: str, *, key: str = "tested") -> Path:
    """Return the folder of the one finished set called `name`, of its plan or in full, or there.

    Sets of another version are passed over: nothing but `verify` can read them.

    Args:
        runs: folder of everything generated.
        name: of the set's plan, or of its folder, or its path.
        key: what names it.

    Raises:
        BadValue: none, or several that differ in their settings.
    """
    whole = folder_called(name, "data", runs=runs)
    if whole is not None:
        return whole
    pattern = f"data/{escape(name)}-{'[!-]' * 12}/{MANIFEST}"
    # What follows the name is the digest alone: `grid-*` finds `grid-fine-<digest>`, too.
    named = sorted(each.parent for each in runs.glob(pattern))
    found = [each for each in named if load_manifest(each).get("format") == FORMAT]
    made = command_line("generate", assignment("plan", name), runs=runs)
    known = {each.parent.name.rpartition("-")[0] for each in runs.glob(f"data/*/{MANIFEST}")}
    hint = _other_hint(name, wanted="set", runs=runs, known=known, make=made)
    if found:
        hint = "remove the outdated: " + ", ".join(map(str, found))
    elif named:
        hint = f"{named[0]} was made by another version of echolearn; {hint}"
    allowed = "must be the name of exactly one finished set"
    check(len(found) == 1, key, name, allowed=allowed, hint=hint)
    return found[0]


def _other_hint(name: str, *, wanted: str, runs: Path, known: Collection[str], make: str) -> str:
    """Return where else a name leads, or which known one it is nearly, and what makes it.

    Args:
        name: that was not found.
        wanted: kind of folder, of `storage.kinds`.
        runs: folder of everything generated.
        known: names of folders of that kind.
        make: command that makes what has this name.
    """
    found = elsewhere(name, wanted=wanted, runs=runs)
    # Names that differ in a number, or end alike, may both be meant: only a slip is near.
    others = [each for each in sorted(known) if re.sub(r"\d", "", each) != re.sub(r"\d", "", name)]
    near = get_close_matches(name, others, n=1, cutoff=0.8)
    return found or "".join(f"did you mean {each}? else " for each in near) + f"run: {make}"


def find_survey(runs: Path, name: str, *, key: str = "surveys") -> Path:
    """Return the folder of a survey: a finished one of that name, or one that a robot recorded.

    Args:
        runs: folder of everything generated.
        name: name of a folder under `runs/survey`, or a path with a slash to any other.
        key: what names it.

    Raises:
        BadValue: there is none, or it is still being made.
    """
    folder = folder_called(name, "survey", runs=runs) or runs / "survey" / name
    allowed = "must be the name of a finished survey, or a folder in its format, ./walk"
    if "/" in name:
        check_kind(key, folder, wanted="survey", allowed=allowed)
    begun = any((folder / each).is_file() for each in (JOURNAL, *BEGUN))
    recorded = (folder / "survey.yaml").is_file() and not begun
    finished = (folder / MANIFEST).is_file() or recorded
    # Names of surveys begin like this unless they are given.
    usual = re.fullmatch(r"(\w+)_(-?[\d.]+)dB", name)
    words = [f"room={usual[1]}", f"snr_db={usual[2]}"] if usual else [assignment("name", name)]
    make = command_line("survey", *words, runs=runs)
    imported = re.fullmatch(r"(\w+)_(-?[\d.]+)dB_(\d+)", name)
    if imported:
        words = [f"source={imported[1]}", f"snr_db={imported[2]}", f"draw={imported[3]}"]
        make = command_line("import", *words, runs=runs)
    if not finished:
        known = {each.parent.name for each in runs.glob("survey/*/survey.yaml")}
        hint = _other_hint(name, wanted="survey", runs=runs, known=known, make=make)
        check(False, key, name, allowed=allowed, hint=hint)
    return folder


def survey_digest(folder: Path) -> str:
    """Return the digest of a survey's files: those that its manifest proves, or those in use."""
    if (folder / MANIFEST).is_file():
        return digest(verify(folder)["files"])
    # What a robot left has no manifest.
    present = [folder / name for name in used(read_survey(folder))]
    return digest({path.name: sha256(path) for path in present if path.is_file()})
