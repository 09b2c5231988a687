"""Finished folders: manifests with checksums, resumable shards.

A folder becomes *finished* when its `manifest.json`, written last, names every file with its size
and SHA-256; the manifest carries a checksum of itself. While a folder is being made, each shard
`shard-00000.npy` has its checksum beside it in `shard-00000.json`; an interrupted run, or one whose
shard was damaged later, redoes only what `missing_shards` returns. `finish` moves those checksums
into the manifest.

The same input gives the same bytes: nothing carries a time stamp. How files are written is in
    `disk`.
"""

import hashlib
import json
import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check
from echolearn.storage.files import (
    MEND,
    canonical,
    load_json,
    prove,
    readable,
    save_array,
    save_json,
    sha256,
    write_atomic,
)

MANIFEST = "manifest.json"
METRICS = "metrics.json"
BUNDLE = "bundle.json"
"""A folder is finished when it has one of the three: a manifest, the metrics of a trained run, or a
bundle's."""

LARGEST, FOREIGN = 64 << 20, 8 << 20
"""Bytes that a manifest may have, and one from a stranger; it holds about 130 for each file."""

MOST = 500_000
"""Shards of a set, so that its manifest is within `LARGEST`."""


def finish(
    folder: Path,
    about: Mapping[str, Any],
    files: Iterable[str],
    *,
    last: str = MANIFEST,
    largest: int = LARGEST,
) -> dict[str, Any]:
    """Declare a folder finished: write its manifest, with size and SHA-256 of each file, last of
    all.

    Args:
        folder: where the files are.
        about: what describes them; the key `command`, if any, is what `verify` advises against
            damage.
        files: their names, relative to `folder`.
        last: name of the manifest, `MANIFEST`, `METRICS` or `BUNDLE`.
        largest: bytes that the manifest may have, as who reads it will limit it.

    Returns:
        The manifest.

    Raises:
        BadValue: the manifest would be larger, or cannot be written. The folder is as it was.
    """
    folder = Path(folder)
    entries = {
        name: {"bytes": (folder / name).stat().st_size, "sha256": sha256(folder / name)}
        for name in files
    }
    manifest = stamped({**about, "files": entries})
    text, hint = (
        readable(manifest),
        f"it names {len(entries)} files; of a set, make plan.shard_rows: larger",
    )
    check(
        len(text) <= largest,
        f"{folder / last}",
        f"{len(text)} bytes",
        allowed=f"at most {largest} bytes",
        hint=hint,
    )
    write_atomic(folder / last, text)
    for spent in folder.glob("shard-*.json"):
        spent.unlink()
    return manifest


def stamped(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return plain containers with the SHA-256 of all the rest under the key `sha256`, as JSON
    gives them back.
    """
    rest = {key: value for key, value in content.items() if key != "sha256"}
    text = canonical(rest)
    return {**json.loads(text), "sha256": hashlib.sha256(text).hexdigest()}


def load_manifest(folder: Path, *, largest: int = LARGEST) -> dict[str, Any]:
    """Return the manifest of a finished folder, or a run's metrics or bundle's, proved against its
    own checksum.

    Args:
        folder: where it is.
        largest: bytes that it may have; `FOREIGN` if a stranger may have made it.

    Raises:
        BadValue: the folder is not finished, or the manifest is damaged.
    """
    last = [
        path
        for path in (Path(folder) / name for name in (MANIFEST, METRICS, BUNDLE))
        if path.is_file()
    ]
    if not last:
        check_folder("folder", folder, allowed="one that echolearn made")
        lacking = f"there is no {MANIFEST}, {METRICS} or {BUNDLE}"
        raise BadValue(f"{folder}: not finished, {lacking}, or none of echolearn's; {MEND}")
    size = last[0].stat().st_size
    check(
        size <= largest,
        str(last[0]),
        f"{size} bytes",
        allowed=f"at most {largest} bytes",
        hint=MEND,
    )
    found = load_json(last[0])
    try:
        manifest = stamped(found if isinstance(found, dict) else {})
    except BadValue:  # NaN, say, which is not JSON
        manifest = {}
    if "files" not in manifest or readable(manifest) != last[0].read_bytes():
        raise BadValue(f"{last[0]}: damaged, its SHA-256 differs; {MEND}")
    if not _names_files(manifest["files"]):
        raise BadValue(
            f"{last[0]} files: bytes and sha256 of files inside the folder, by name; {MEND}"
        )
    return manifest


def check_folder(name: str, folder: Path, *, allowed: str, hint: str = "") -> None:
    """Raise `BadValue` unless there is a folder; it says whether there is something else."""
    told = "it is no folder" if Path(folder).exists() else "there is no such folder"
    check(
        Path(folder).is_dir(),
        name,
        folder,
        allowed=allowed,
        hint=f"{told}; {hint}" if hint else told,
    )


def _names_files(entries: Any) -> bool:
    """Tell whether a manifest's `files` are sizes and checksums by names that stay inside the
    folder.
    """
    return isinstance(entries, dict) and all(
        name
        and "\0" not in name
        and not {"..", "/"} & {*Path(name).parts}
        and isinstance(entry, dict)
        and {key: type(value) for key, value in entry.items()} == {"bytes": int, "sha256": str}
        for name, entry in entries.items()
    )


def is_finished(folder: Path) -> bool:
    """Tell whether a folder has a sound manifest."""
    try:
        load_manifest(folder)
    except BadValue:
        return False
    return True


def verify(folder: Path) -> dict[str, Any]:
    """Re-prove a finished folder, every byte of it, and return its manifest.

    Raises:
        BadValue: names the first file that is missing or damaged, and the command that mends it.
    """
    manifest = load_manifest(folder)
    for name, entry in manifest["files"].items():
        prove(
            Path(folder) / name,
            size=entry["bytes"],
            expected=entry["sha256"],
            mend=advice(manifest),
        )
    return manifest


def made_by(command: str | None) -> dict[str, str]:
    """Return what a manifest says about the command that made it: nothing if there was none."""
    return {} if command is None else {"command": command}


def advice(manifest: Mapping[str, Any]) -> str:
    """Return how to mend a damaged file of the folder with this manifest: by its command, if it is
    one of ours.
    """
    command = manifest.get("command")
    return f"run again: {command}" if is_command(command) else MEND


def is_command(text: object) -> bool:
    """Tell whether a text is one command line of echolearn, quoted as a shell needs it: nothing
    follows in its wake.
    """
    if not (isinstance(text, str) and text.startswith("echolearn ") and text.isprintable()):
        return False
    try:
        return shlex.join(shlex.split(text)) == text
    except ValueError:
        return False


def shard_name(index: int) -> str:
    """Return the file name of a shard."""
    return f"shard-{index:05d}.npy"


def sidecar(path: Path) -> Path:
    """Return where the checksum of a shard stands until its folder is finished."""
    return Path(path).with_suffix(".json")


def write_shard(folder: Path, index: int, array: Array) -> None:
    """Write one shard, and then its size and checksum beside it."""
    path = Path(folder) / shard_name(index)
    save_array(path, array)
    save_json(sidecar(path), {"bytes": path.stat().st_size, "sha256": sha256(path)})


def missing_shards(folder: Path, count: int) -> list[int]:
    """Return which of the shards 0 ... count - 1 have still to be written, because absent, torn or
    damaged.

    The reference is the manifest of a finished folder, or else the checksum beside each shard, so
    running the command that made a set again mends a damaged one and redoes nothing else.
    """
    try:
        entries = load_manifest(folder)["files"]
    except BadValue:
        entries = {}
    return [
        index for index in range(count) if not is_whole(Path(folder) / shard_name(index), entries)
    ]


def is_whole(path: Path, entries: Mapping[str, Any]) -> bool:
    """Tell whether a shard has the checksum in `entries`, or else the one in its sidecar."""
    try:
        entry = entries[path.name] if path.name in entries else load_json(sidecar(path))
        prove(path, size=entry["bytes"], expected=entry["sha256"])
    except (BadValue, KeyError, TypeError):
        return False
    return True
