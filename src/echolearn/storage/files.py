"""Files that are whole or absent: atomic writes, checksums, JSON and arrays as the same bytes for
the same input.

A file is written under a temporary name in its own folder, synced and renamed, so at its final name
it is either the old one or the new one, whatever happens in between. Formats alone let most single
flipped bits through in silence, so what is read is proved by size and SHA-256 first. Nothing here
reads or writes pickles; JSON has sorted keys and shortest floats.
"""

import errno
import fcntl
import hashlib
import json
import mmap
import os
import secrets
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue
from echolearn.storage.identity import canonical

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors against which more room helps."""

MEND = "make it again as it was made"
"""What to do about a damaged file whose manifest names no `command`."""


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file, as 64 hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_atomic(path: Path, content: bytes | Callable[[BinaryIO], object]) -> None:
    """Write a file so that at `path` stands either the old content or all of the new one, never a
    part.

    Args:
        path: where; missing folders are made.
        content: the bytes, or a function that writes them to the open file it is given.

    Raises:
        BadValue: the disk is full or the folder cannot be written. `path` is as it was, the
            temporary is gone.
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
        raise unwritable(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def unwritable(path: Path, error: OSError) -> BadValue:
    """Return the one line about a file that cannot be written."""
    reason = error.strerror or error
    advice = (
        "make room and run the same command again"
        if error.errno in FULL
        else "is the folder the right one?"
    )
    return BadValue(f"{path}: cannot be written ({reason}); {advice}")


def sync_folder(folder: Path) -> None:
    """Make renames in `folder` survive a power cut."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


MARKS: set[BinaryIO] = set()
"""Open files by which this process is known to be present; its copies close theirs, lest they seem
to be it."""

os.register_at_fork(after_in_child=lambda: [file.close() for file in MARKS])


@contextmanager
def presence(folder: Path) -> Iterator[Path]:
    """Keep an empty file in `folder` for the time of a `with` block, by which others know that it
    is the same folder.

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
    """Give the pages of a memory-mapped array back to the system, which keeps them cached; a later
    look maps anew.
    """
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
