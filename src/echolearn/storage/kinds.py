"""What a folder is, told by what is in it, and what to do where another kind was meant.

    folder --folder_kind--> "run"                      name that is not there --elsewhere--> a hint
    folder, kind wanted --check_kind--> nothing, or one line: what it is, and the step that leads on

A run where a bundle belongs, a survey where a set does: the folder is there and whole, so its
missing files would tell nothing. A name is looked for where such folders lie, where others lie, and
below the current folder, before it is said to be unknown.
"""

from contextlib import suppress
from glob import escape
from pathlib import Path
from typing import NamedTuple

from echolearn.checks import BadValue, check
from echolearn.storage import manifests
from echolearn.storage.manifests import BUNDLE, MANIFEST, METRICS


class Kind(NamedTuple):
    """A kind of folder.

    Attributes:
        called: what a message calls it.
        place: folder under `runs` where such folders lie.
        mark: file by which a finished one is known.
    """

    called: str
    place: str
    mark: str = MANIFEST


KINDS = {
    "bundle": Kind("a bundle", "bundles", BUNDLE),
    "run": Kind("a trained run", "train", METRICS),
    "survey": Kind("a recorded survey", "survey", "survey.yaml"),
    "set": Kind("a labelled set", "data"),
    "walks": Kind("a set of walks", "data"),
    "comparison": Kind("a comparison", "compare"),
    "map": Kind("a map", "maps"),
    "check": Kind("what check wrote", "check"),
    "fit": Kind("what fit wrote", "fit"),
    "study": Kind("a study", "study"),
    "tune": Kind("a search", "tune"),
}
"""Kinds by the name that their manifests have; what has a mark of its own is known by that."""

STEPS = {
    ("run", "bundle"): "export makes a bundle of it: echolearn export run={folder}",
    ("comparison", "bundle"): "export makes a bundle of its best: echolearn export best={folder}",
    ("comparison", "run"): "did you mean best={folder}?",
    ("run", "comparison"): "did you mean run={folder}?",
    ("survey", "set"): "label makes a set of it: echolearn label survey={folder}",
    ("set", "run"): "train makes runs on it: echolearn train plan={folder}",
    ("survey", "bundle"): "did you swap survey and bundle?",
    ("bundle", "survey"): "did you swap survey and bundle?",
}
"""What to do with a folder of one kind where another is wanted."""


def folder_kind(folder: Path) -> str:
    """Return the kind of a folder, a key of `KINDS`; nothing where that cannot be told."""
    for name, kind in KINDS.items():
        if kind.mark != MANIFEST and (folder / kind.mark).is_file():
            return name
    with suppress(BadValue):
        found = manifests.load_manifest(folder, largest=manifests.FOREIGN).get("kind")
        return found if found in KINDS else ""
    return ""


def check_kind(key: str, folder: Path, *, wanted: str, allowed: str, hint: str = "") -> None:
    """Raise `BadValue` unless a folder is there, and not one of another kind.

    Args:
        key: what names it.
        folder: where it should be.
        wanted: a key of `KINDS`.
        allowed: what would be accepted.
        hint: what to do if it is not there.
    """
    manifests.check_folder(key, folder, allowed=allowed, hint=hint)
    found = folder_kind(folder)
    check(
        found in ("", wanted), key, folder, allowed=allowed, hint=told_kind(folder, found, wanted)
    )


def told_kind(folder: Path, found: str, wanted: str) -> str:
    """Return what a folder is, and what leads from there to what is wanted; nothing if unknown.

    Args:
        folder: where it is.
        found, wanted: keys of `KINDS`, the first also empty.
    """
    if not found:
        return ""
    step = STEPS.get((found, wanted), "").format(folder=folder)
    return f"it is {KINDS[found].called}" + (f"; {step}" if step else "")


def elsewhere(name: str, *, wanted: str, runs: Path) -> str:
    """Return where a name leads instead, in words: below here, or to a kind that a step leads from.

    Args:
        name: name without a slash, or the beginning of one, that is not where it was looked for.
        wanted: a key of `KINDS`.
        runs: folder of everything generated.
    """
    if not name or "/" in name:
        return ""
    # No deeper: a home may hold anything.
    for depth in ("*", "*/*"):
        for mark in sorted(Path().glob(f"{depth}/{escape(name)}/{KINDS[wanted].mark}")):
            if folder_kind(mark.parent) == wanted:
                return f"is it {mark.parent}?"
    # What has the name by chance, as a comparison that of a plan, leads nowhere.
    for pattern in ("", "-*"):
        for folder in sorted(Path(runs).glob(f"*/{escape(name)}{pattern}/")):
            found = folder_kind(folder)
            if (found, wanted) in STEPS and KINDS[found].place == folder.parent.name:
                return f"{folder}: {told_kind(folder, found, wanted)}"
    return ""
