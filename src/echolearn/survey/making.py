"""A survey that a command makes: file by file, so that a killed command loses nothing.

    about, files one after the other --made--> the folder, with what it is made from in `begun`

By the file `begun` a survey is known as ours: a command never writes into a folder that holds
recordings of another origin. The manifest comes last (`storage.journal`).
"""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from echolearn.checks import BadValue, check
from echolearn.storage import journal, manifests
from echolearn.storage.once import once


def made_once(
    folder: Path,
    about: Mapping[str, Any],
    *,
    begun: str,
    contents: Callable[[], Iterator[journal.Content]],
    command: str | None,
) -> Path:
    """Return the folder of a survey, made if it is not there.

    Args:
        folder: where it goes.
        about: what it is made from, and its kind.
        begun: name of the file that holds `about`, such as `simulated.json`.
        contents: yields its files in their order.
        command: what makes it again, for the manifest; None says nothing about it.

    Raises:
        BadValue: recordings of another origin, or a survey made with other settings.
    """

    def make() -> Path:
        """Write those files that are not there yet, and declare the survey finished."""
        names = journal.make_missing(folder, about, contents=contents(), begun=begun)
        try:
            # Of a survey that was mended the manifest still holds, as whoever made it had it.
            manifests.verify(folder)
        except BadValue:
            made = {**about, **manifests.command_entry(command)}
            manifests.finish(folder, made, files=names, largest=manifests.FOREIGN)
        journal.end(folder)
        return folder

    finished = partial(_finished, folder, about, begun=begun)
    return once(folder, finished=finished, make=make, doing="records this survey")


def _finished(folder: Path, about: Mapping[str, Any], *, begun: str) -> Path | None:
    """Return the folder if the survey stands there whole; a damaged one is to be made again.

    Raises:
        BadValue: recordings of another origin, or a survey made with other settings.
    """
    empty = not folder.is_dir() or not any(folder.glob("[!.]*"))
    # `begun` may have been lost: any of the others tells as well that it is ours.
    signs = (begun, journal.JOURNAL, manifests.MANIFEST)
    ours = empty or any((folder / name).is_file() for name in signs)
    kind = begun.removesuffix(".json")
    allowed = f"must be a new name, or that of {'an' if kind[0] in 'aeiou' else 'a'} {kind} survey"
    hint = f"{folder} holds recordings of another origin"
    check(ours, "name", folder.name, allowed=allowed, hint=hint)

    try:
        manifest = manifests.load_manifest(folder)
    except BadValue:
        return None
    allowed = "must be a new name, or that of a survey made with the same settings"
    hint = f"{folder} was made with others, or by echolearn 0.1; remove it to make it anew"
    same = all(manifest.get(key) == value for key, value in about.items())
    check(same, "name", folder.name, allowed=allowed, hint=hint)

    try:
        manifests.verify(folder)
    except BadValue:
        return None
    journal.end(folder)
    return folder
