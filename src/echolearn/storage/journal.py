"""Folders whose files are made one after the other: what a killed command has made is kept.

    (name, make), ... --make_missing--> files, each with a line in the journal --end--> finished

The journal is a hidden file: the digest of what the folder is made from, then a line of JSON for
each file with its size and SHA-256, as manifests have them. Its last line may be torn; a file that
is not named, or is not as it is named, is made again. Of a finished folder the manifest tells.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from echolearn.checks import BadValue
from echolearn.storage import files, manifests
from echolearn.storage.identity import digest

JOURNAL = ".journal"

Content = tuple[str, Callable[[], bytes]]
"""Name of a file, and what makes its content."""

Entries = dict[str, Any]
"""Size and SHA-256 of files, by name."""


def make_missing(
    folder: Path, about: Mapping[str, Any], *, contents: Iterator[Content], begun: str
) -> list[str]:
    """Write those files of a folder that are not there yet, and return the names of all.

    Args:
        folder: where they go.
        about: what they are made from.
        contents: files in their order.
        begun: name of a file that says what they are made from, written first of all.
    """
    there = known_files(folder, about)
    first, make = next(contents)
    # Made before any is written: what cannot be made leaves nothing.
    content = None if manifests.is_whole(folder / first, there.get(first)) else make()

    # Also where nothing was finished: the first file of a folder in it may have been cut short.
    for place in (folder, *(path for path in folder.rglob("*") if path.is_dir())):
        files.clean(place)
    files.save_json(folder / begun, about)
    lines = [digest(about), *(json.dumps({name: entry}) for name, entry in there.items())]
    files.write_atomic(folder / JOURNAL, "".join(f"{line}\n" for line in lines).encode())
    if content is not None:
        _write(folder, name=first, content=content)
    names = [begun, first]
    for name, make in contents:
        if not manifests.is_whole(folder / name, there.get(name)):
            _write(folder, name=name, content=make())
        names.append(name)
    return names


def known_files(folder: Path, about: Mapping[str, Any]) -> Entries:
    """Return size and checksum of the files of a folder that were made from this, by name."""
    with suppress(BadValue):
        manifest = manifests.load_manifest(folder)
        same = all(manifest.get(key) == value for key, value in about.items())
        return dict(manifest["files"]) if same else {}
    lines = []
    with suppress(OSError, UnicodeDecodeError):
        lines = (folder / JOURNAL).read_text().splitlines()
    found: Entries = {}
    for line in lines[1:] if lines[:1] == [digest(about)] else ():
        with suppress(ValueError, TypeError):
            found |= json.loads(line)
    return found


def end(folder: Path) -> None:
    """Remove the journal of a folder, which is finished now."""
    with suppress(OSError):
        (folder / JOURNAL).unlink(missing_ok=True)


def _write(folder: Path, *, name: str, content: bytes) -> None:
    """Write a file, and a line about it into the journal."""
    files.write_atomic(folder / name, content)
    entry = {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    with (folder / JOURNAL).open("a") as journal:
        journal.write(json.dumps({name: entry}) + "\n")
