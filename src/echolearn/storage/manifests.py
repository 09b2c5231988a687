"""Finished folders: manifests with checksums, and shards that are resumed.

A folder is *finished* when it has a manifest, written last of all: `manifest.json`, the
`metrics.json` of a trained run, or the `bundle.json` of a bundle. The manifest names every other
file with its size and SHA-256, and carries a checksum of itself.

    shard-00000.npy + shard-00000.json  --finish-->  shard-00000.npy, listed in manifest.json

While a folder is being made, the checksum of each shard stands beside it. So the same command after
an interruption, or after damage, redoes only the shards that `missing_shards` returns.

The same input gives the same bytes: nothing carries a time stamp. How a file is written is told in
`storage.files`.
"""

import hashlib
import json
import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath
from typing import Any

from numpy.typing import NDArray

from echolearn.checks import BadValue, check
from echolearn.storage import known
from echolearn.storage.advice import MEND, repair_hint
from echolearn.storage.files import (
    check_file,
    json_bytes,
    load_json,
    save_array,
    save_json,
    sha256,
    write_atomic,
)
from echolearn.storage.identity import canonical, digest

MANIFEST = "manifest.json"
METRICS = "metrics.json"
BUNDLE = "bundle.json"

Contents = dict[str, bytes]
"""Files by name."""

LARGEST = 64 << 20
"""Bytes that a manifest may have; it holds about 130 for each file."""

FOREIGN = 8 << 20
"""Bytes that the manifest of a stranger may have."""

MOST = 500_000
"""Shards that a set may have, so that its manifest is within `LARGEST`."""


def finish(
    folder: Path,
    about: Mapping[str, Any],
    *,
    files: Iterable[str],
    last: str = MANIFEST,
    largest: int = LARGEST,
) -> dict[str, Any]:
    """Declare a folder finished: write its manifest, which names every file, last of all.

    Args:
        folder: where the files are.
        about: what describes them; the key `command`, if any, is what `verify` advises against
            damage.
        files: names, relative to `folder`.
        last: name of the manifest, `MANIFEST`, `METRICS` or `BUNDLE`.
        largest: bytes that the manifest may have, as who reads it will limit it.

    Returns:
        The manifest.

    Raises:
        BadValue: the manifest would be larger, or cannot be written. The folder is as it was.
    """
    folder = Path(folder)
    entries = {name: _entry(folder / name) for name in files}
    manifest = with_checksum({**about, "files": entries})
    text = json_bytes(manifest)
    check(
        len(text) <= largest,
        f"{folder / last}",
        f"{len(text)} bytes",
        allowed=f"at most {largest} bytes",
        hint=f"it names {len(entries)} files; of a set, make plan.shard_rows larger",
    )
    write_atomic(folder / last, text)
    known.remember(manifest["sha256"], known.MADE)

    # Their checksums stand in the manifest now.
    for spent in folder.glob("shard-*.json"):
        spent.unlink()
    return manifest


def _entry(path: Path) -> dict[str, Any]:
    return {"bytes": path.stat().st_size, "sha256": sha256(path)}


def with_checksum(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return content as JSON gives it back, with its own SHA-256 under the key `sha256`."""
    rest = {key: value for key, value in content.items() if key != "sha256"}
    text = canonical(rest)
    return {**json.loads(text), "sha256": hashlib.sha256(text).hexdigest()}


def load_manifest(folder: Path, *, largest: int = LARGEST) -> dict[str, Any]:
    """Return the manifest of a finished folder, checked against its own checksum.

    Args:
        folder: where it is.
        largest: bytes that it may have; `FOREIGN` if a stranger may have made it.

    Raises:
        BadValue: the folder is not finished, or the manifest is damaged.
    """
    path = _manifest_of(folder)
    size = path.stat().st_size
    allowed = f"at most {largest} bytes"
    check(size <= largest, f"{path}", f"{size} bytes", allowed=allowed, hint=MEND)

    found = load_json(path)
    try:
        manifest = with_checksum(found if isinstance(found, dict) else {})
    except BadValue:
        # Python reads NaN, which no JSON has.
        manifest = {}
    if "files" not in manifest or json_bytes(manifest) != path.read_bytes():
        raise BadValue(f"{path}: damaged, its SHA-256 differs; {MEND}")
    if not _names_files(manifest["files"]):
        allowed = "bytes and sha256 of files inside the folder, by name"
        raise BadValue(f"{path} files: must be {allowed}; {MEND}")
    return manifest


def _manifest_of(folder: Path) -> Path:
    for name in (MANIFEST, METRICS, BUNDLE):
        if (Path(folder) / name).is_file():
            return Path(folder) / name
    check_folder("folder", folder, allowed="must be a folder that echolearn made")
    lacking = f"there is no {MANIFEST}, {METRICS} or {BUNDLE} in it"
    raise BadValue(f"{folder}: not finished, or not made by echolearn: {lacking}; {MEND}")


def check_folder(name: str, folder: Path, *, allowed: str, hint: str = "") -> None:
    """Raise `BadValue` unless there is a folder; it says whether there is something else.

    Args:
        name: key that gave the folder.
        folder: where it should be.
        allowed: what would be accepted.
        hint: what to do about it.
    """
    found = "it is a file" if Path(folder).exists() else "there is no such folder"
    hint = f"{found}; {hint}" if hint else found
    check(Path(folder).is_dir(), name, folder, allowed=allowed, hint=hint)


def _names_files(entries: Any) -> bool:
    """Tell whether these are sizes and checksums by names that stay inside the folder."""
    if not isinstance(entries, dict):
        return False
    for name, entry in entries.items():
        inside = name and "\0" not in name and not {"..", "/"} & {*PurePosixPath(name).parts}
        if not inside or not isinstance(entry, dict):
            return False
        if {key: type(value) for key, value in entry.items()} != {"bytes": int, "sha256": str}:
            return False
    return True


def check_own_name(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Raise `BadValue` if the folder of a set or run has the name of another.

    Surveys, bundles and maps may have any name, and so may a set whose name ends in no digest.
    """
    named = manifest.get("run")
    if manifest.get("kind") in ("set", "walks") and isinstance(manifest.get("plan"), dict):
        named = set_name(manifest)
    elif "kind" in manifest:
        return
    found = Path(folder).resolve().name
    same = found == named or not re.search("-[0-9a-f]{12}$", found)
    allowed = f"must be a folder called {named}"
    check(named is None or same, "folder", folder, allowed=allowed, hint="was it renamed?")


def set_name(about: Mapping[str, Any]) -> str:
    """Return what a set's folder is called, by `format` and `plan` of its manifest."""
    made_from = {key: about.get(key) for key in ("format", "plan")}
    return f"{about['plan'].get('name')}-{digest(made_from)}"


def is_finished(folder: Path) -> bool:
    """Tell whether a folder has a sound manifest."""
    try:
        load_manifest(folder)
    except BadValue:
        return False
    return True


def verify(folder: Path) -> dict[str, Any]:
    """Check every byte of a finished folder, and return its manifest.

    Raises:
        BadValue: names the first file that is missing or damaged, and the command that mends it.
    """
    manifest = load_manifest(folder)
    mend = repair_hint(manifest, Path(folder))
    for name, entry in manifest["files"].items():
        path = Path(folder) / name
        check_file(path, size=entry["bytes"], expected=entry["sha256"], mend=mend)
    return manifest


def listed_bytes(folder: Path, manifest: Mapping[str, Any], *, names: Iterable[str]) -> Contents:
    """Return contents of files as a manifest names them, whoever writes to the folder meanwhile.

    Args:
        folder: where they are.
        manifest: of the folder, as it was read.
        names: of the files; those that it does not name are left out.

    Raises:
        BadValue: one is another by now.
    """
    found = {}
    for name in names:
        entry = manifest["files"].get(name)
        if entry is None:
            continue
        path = Path(folder) / name
        check_file(path, size=entry["bytes"], expected=entry["sha256"])
        found[name] = path.read_bytes()
        # Another command may have written it since the line before the last.
        same = hashlib.sha256(found[name]).hexdigest() == entry["sha256"]
        check(same, str(path), "changed", allowed="must stay as it is while it is read")
    return found


def command_entry(command: str | None) -> dict[str, str]:
    """Return what a manifest says about the command that made it: nothing if there was none."""
    return {} if command is None else {"command": command}


def shard_name(index: int) -> str:
    """Return the file name of a shard."""
    return f"shard-{index:05d}.npy"


def sidecar(path: Path) -> Path:
    """Return where the checksum of a shard stands until its folder is finished."""
    return Path(path).with_suffix(".json")


def write_shard(folder: Path, index: int, *, array: NDArray[Any]) -> None:
    """Write one shard, and then its size and checksum beside it.

    Args:
        folder: set or study that is being made.
        index: number of the shard, from 0.
        array: rows of the shard.
    """
    path = Path(folder) / shard_name(index)
    save_array(path, array)
    save_json(sidecar(path), _entry(path))


def missing_shards(folder: Path, count: int) -> list[int]:
    """Return which of the shards 0 ... count - 1 are absent, torn or damaged.

    The reference is the manifest of a finished folder, or else the checksum beside each shard, so
    running the command that made a set again mends a damaged one and redoes nothing else.
    """
    try:
        entries = load_manifest(folder)["files"]
    except BadValue:
        entries = {}
    missing = []
    for index in range(count):
        path = Path(folder) / shard_name(index)
        with suppress(BadValue):
            if is_whole(path, entries.get(path.name) or load_json(sidecar(path))):
                continue
        missing.append(index)
    return missing


def is_whole(path: Path, entry: Any) -> bool:
    """Tell whether a file has the size and the checksum of a manifest's entry, if that is one."""
    try:
        check_file(path, size=entry["bytes"], expected=entry["sha256"])
    except (BadValue, KeyError, TypeError):
        return False
    return True
