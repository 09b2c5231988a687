"""Files that are whole or absent: atomic writes, checksums, manifests, resumable shards.

A file is written under a temporary name in its own folder, synced and renamed, so at its final name it is
either the old one or the new one, whatever happens in between. A folder becomes *finished* when its
`manifest.json`, written last, names every file with its size and SHA-256; the manifest carries a checksum of
itself. Every read proves these figures first: formats alone let most single flipped bits through in silence.

While a folder is being made, each shard `shard-00000.npy` has its checksum beside it in `shard-00000.json`;
an interrupted run, or one whose shard was damaged later, redoes only what `missing_shards` returns. `finish`
moves those checksums into the manifest. Nothing here reads or writes pickles.

The same input gives the same bytes: JSON has sorted keys and shortest floats, and nothing carries a time stamp.
"""

import errno
import fcntl
import hashlib
import json
import mmap
import os
import secrets
import shlex
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from echolearn.types import Array, BadValue, check

MANIFEST = "manifest.json"
METRICS = "metrics.json"
BUNDLE = "bundle.json"
"""A folder is finished when it has one of the three: a manifest, the metrics of a trained run, or a bundle's."""

LARGEST, FOREIGN = 64 << 20, 8 << 20
"""Bytes that a manifest may have, and one from a stranger; it holds about 130 for each file."""

MOST = 500_000
"""Shards of a set, so that its manifest is within `LARGEST`."""

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors against which more room helps."""

MEND = "make it again as it was made"
"""What to do about a damaged file whose manifest names no `command`."""


def canonical(plain: Any) -> bytes:
    """Return the one JSON text of plain containers: sorted keys, no blanks, floats by `repr`.

    Raises:
        BadValue: NaN, infinity, or anything that JSON cannot hold.
    """
    try:
        return json.dumps(plain, sort_keys=True, separators=(",", ":"), allow_nan=False).encode()
    except (TypeError, ValueError, RecursionError) as error:
        raise BadValue(f"config={plain!r:.200}: plain finite numbers, texts, lists and mappings; {error}") from None


def digest(plain: Any) -> str:
    """Return the identity of plain containers: the first 12 hexadecimal digits of their SHA-256."""
    return hashlib.sha256(canonical(plain)).hexdigest()[:12]


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file, as 64 hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_atomic(path: Path, content: bytes | Callable[[BinaryIO], object]) -> None:
    """Write a file so that at `path` stands either the old content or all of the new one, never a part.

    Args:
        path: where; missing folders are made.
        content: the bytes, or a function that writes them to the open file it is given.

    Raises:
        BadValue: the disk is full or the folder cannot be written. `path` is as it was, the temporary is gone.
    """
    path = Path(path)
    temporary = path.parent / f".{path.name}.{secrets.token_hex(6)}.tmp"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("xb") as file:
            fcntl.flock(file, fcntl.LOCK_EX)  # tells `clean` that this writer is alive
            content(file) if callable(content) else file.write(content)
            file.flush()
            os.fsync(file.fileno())
            temporary.replace(path)
        sync_folder(path.parent)
    except OSError as error:
        reason = error.strerror or error
        advice = "make room and run the same command again" if error.errno in FULL else "is the folder the right one?"
        raise BadValue(f"{path}: cannot be written ({reason}); {advice}") from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def sync_folder(folder: Path) -> None:
    """Make renames in `folder` survive a power cut."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


MARKS: set[BinaryIO] = set()
"""Open files by which this process is known to be present; its copies close theirs, lest they seem to be it."""

os.register_at_fork(after_in_child=lambda: [file.close() for file in MARKS])


@contextmanager
def presence(folder: Path) -> Iterator[Path]:
    """Keep an empty file in `folder` for the time of a `with` block, by which others know that it is the same folder.

    Raises:
        BadValue: the folder cannot be written.
    """
    mark = Path(folder) / f".{secrets.token_hex(6)}.tmp"
    write_atomic(mark, b"")
    with mark.open("rb+") as file:
        fcntl.flock(file, fcntl.LOCK_EX)  # tells `clean` that somebody is here
        MARKS.add(file)
        try:
            yield mark
        finally:
            MARKS.discard(file)
            mark.unlink(missing_ok=True)
            with suppress(OSError):
                mark.parent.rmdir()  # if nothing came of it


def clean(folder: Path) -> None:
    """Remove the temporaries that killed writers left in `folder`; those of living writers stay."""
    for temporary in Path(folder).glob(".*.tmp"):
        with suppress(OSError), temporary.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            temporary.unlink()


def save_array(path: Path, array: Array) -> None:
    """Write an array as `.npy`, atomically and without pickle."""
    buffer = BytesIO()
    np.save(buffer, array, allow_pickle=False)
    write_atomic(path, buffer.getvalue())


def save_json(path: Path, plain: Any) -> None:
    """Write plain containers as readable JSON, atomically, with sorted keys."""
    write_atomic(path, readable(plain))


def readable(plain: Any) -> bytes:
    """Return the text that `save_json` writes: that of `canonical` on many lines."""
    return (json.dumps(json.loads(canonical(plain)), sort_keys=True, indent=1) + "\n").encode()


def load_json(path: Path) -> Any:
    """Return what a JSON file holds.

    Raises:
        BadValue: the file is missing or not JSON.
    """
    try:
        return json.loads(Path(path).read_bytes())
    except (OSError, ValueError, RecursionError) as error:
        raise BadValue(f"{path}: cannot be read as JSON ({one_line(error)}); {MEND}") from None


def open_array(path: Path, *, size: int, sha256: str, mend: str = MEND) -> Array:
    """Map an `.npy` file into memory, read-only, after proving it whole.

    Args:
        path: the file.
        size: expected, in bytes.
        sha256: expected, 64 hexadecimal digits.
        mend: what the error advises.

    Raises:
        BadValue: the file is missing, its size or checksum differs, or it holds Python objects.
    """
    prove(path, size=size, expected=sha256, mend=mend)
    try:
        return np.load(path, mmap_mode="r", allow_pickle=False)
    except ValueError as error:
        raise BadValue(f"{path}: not a plain array ({one_line(error)}); {mend}") from None


def let_go(array: Array) -> None:
    """Give the pages of a memory-mapped array back to the system, which keeps them cached; a later look maps anew."""
    mapping = getattr(array, "_mmap", None)
    if mapping is not None and hasattr(mmap, "MADV_DONTNEED"):
        mapping.madvise(mmap.MADV_DONTNEED)


def prove(path: Path, *, size: int, expected: str, mend: str = MEND) -> None:
    """Raise `BadValue` unless at `path` is a plain file of that many bytes and that SHA-256."""
    try:
        about = Path(path).stat()
        found, plain = about.st_size, stat.S_ISREG(about.st_mode)
        whole = plain and found == size and sha256(path) == expected
    except OSError as error:
        raise BadValue(f"{path}: cannot be read ({error.strerror or error}); {mend}") from None
    if not whole:
        what = f"{found} bytes instead of {size}" if found != size else "its SHA-256 differs"
        what = what if plain else "no plain file"
        raise BadValue(f"{path}: damaged, {what}; {mend}")


def one_line(error: BaseException) -> str:
    """Return an exception's message without line breaks."""
    return " ".join(str(error).split())


def finish(
    folder: Path, about: Mapping[str, Any], files: Iterable[str], *, last: str = MANIFEST, largest: int = LARGEST
) -> dict[str, Any]:
    """Declare a folder finished: write its manifest, with size and SHA-256 of each file, last of all.

    Args:
        folder: where the files are.
        about: what describes them; the key `command`, if any, is what `verify` advises against damage.
        files: their names, relative to `folder`.
        last: name of the manifest, `MANIFEST`, `METRICS` or `BUNDLE`.
        largest: bytes that the manifest may have, as who reads it will limit it.

    Returns:
        The manifest.

    Raises:
        BadValue: the manifest would be larger, or cannot be written. The folder is as it was.
    """
    folder = Path(folder)
    entries = {name: {"bytes": (folder / name).stat().st_size, "sha256": sha256(folder / name)} for name in files}
    manifest = stamped({**about, "files": entries})
    text, hint = readable(manifest), f"it names {len(entries)} files; of a set, make plan.shard_rows: larger"
    check(len(text) <= largest, f"{folder / last}", f"{len(text)} bytes", allowed=f"at most {largest} bytes", hint=hint)
    write_atomic(folder / last, text)
    for spent in folder.glob("shard-*.json"):
        spent.unlink()
    return manifest


def stamped(content: Mapping[str, Any]) -> dict[str, Any]:
    """Return plain containers with the SHA-256 of all the rest under the key `sha256`, as JSON gives them back."""
    rest = {key: value for key, value in content.items() if key != "sha256"}
    text = canonical(rest)
    return {**json.loads(text), "sha256": hashlib.sha256(text).hexdigest()}


def load_manifest(folder: Path, *, largest: int = LARGEST) -> dict[str, Any]:
    """Return the manifest of a finished folder, or a run's metrics or bundle's, proved against its own checksum.

    Args:
        folder: where it is.
        largest: bytes that it may have; `FOREIGN` if a stranger may have made it.

    Raises:
        BadValue: the folder is not finished, or the manifest is damaged.
    """
    last = [path for path in (Path(folder) / name for name in (MANIFEST, METRICS, BUNDLE)) if path.is_file()]
    if not last:
        raise BadValue(f"{folder}: not finished, there is no {MANIFEST}, {METRICS} or {BUNDLE}; {MEND}")
    size = last[0].stat().st_size
    check(size <= largest, str(last[0]), f"{size} bytes", allowed=f"at most {largest} bytes", hint=MEND)
    found = load_json(last[0])
    try:
        manifest = stamped(found if isinstance(found, dict) else {})
    except BadValue:  # NaN, say, which is not JSON
        manifest = {}
    if "files" not in manifest or readable(manifest) != last[0].read_bytes():
        raise BadValue(f"{last[0]}: damaged, its SHA-256 differs; {MEND}")
    if not _names_files(manifest["files"]):
        raise BadValue(f"{last[0]} files: bytes and sha256 of files inside the folder, by name; {MEND}")
    return manifest


def _names_files(entries: Any) -> bool:
    """Tell whether a manifest's `files` are sizes and checksums by names that stay inside the folder."""
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
        prove(Path(folder) / name, size=entry["bytes"], expected=entry["sha256"], mend=advice(manifest))
    return manifest


def made_by(command: str | None) -> dict[str, str]:
    """Return what a manifest says about the command that made it: nothing if there was none."""
    return {} if command is None else {"command": command}


def advice(manifest: Mapping[str, Any]) -> str:
    """Return how to mend a damaged file of the folder with this manifest: by its command, if it is one of ours."""
    command = manifest.get("command")
    return f"run again: {command}" if is_command(command) else MEND


def is_command(text: object) -> bool:
    """Tell whether a text is one command line of echolearn, quoted as a shell needs it: nothing follows in its wake."""
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
    """Return which of the shards 0 ... count - 1 have still to be written, because absent, torn or damaged.

    The reference is the manifest of a finished folder, or else the checksum beside each shard, so running the
    command that made a set again mends a damaged one and redoes nothing else.
    """
    try:
        entries = load_manifest(folder)["files"]
    except BadValue:
        entries = {}
    return [index for index in range(count) if not is_whole(Path(folder) / shard_name(index), entries)]


def is_whole(path: Path, entries: Mapping[str, Any]) -> bool:
    """Tell whether a shard has the checksum in `entries`, or else the one in its sidecar."""
    try:
        entry = entries[path.name] if path.name in entries else load_json(sidecar(path))
        prove(path, size=entry["bytes"], expected=entry["sha256"])
    except (BadValue, KeyError, TypeError):
        return False
    return True
