"""Files that are whole or absent: atomic writes, checksums, JSON and arrays of repeatable bytes.

A file is written under a temporary name in its own folder, synced and renamed, so at its final name
it is either the old one or the new one, whatever happens in between. Formats alone let most single
flipped bits through in silence, so what is read is checked by size and SHA-256 first. Nothing here
reads or writes pickles. JSON has sorted keys and shortest floats, so the same input gives the same
bytes.
"""

import errno
import fcntl
import hashlib
import json
import mmap
import os
import secrets
import stat
from collections.abc import Callable
from contextlib import suppress
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from echolearn.checks import BadValue
from echolearn.storage.advice import MEND
from echolearn.storage.identity import canonical

LARGEST = 64 << 30
"""Bytes that a file may have; shards of the largest sets have fewer."""

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Errors against which more room helps."""


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file, as 64 hexadecimal digits."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_atomic(path: Path, content: bytes | Callable[[BinaryIO], object]) -> None:
    """Write a file so that `path` holds the old content or all of the new one, never a part.

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
            # The lock tells `clean` that this writer is alive.
            fcntl.flock(file, fcntl.LOCK_EX)
            content(file) if callable(content) else file.write(content)

            # The content is on the disk before it has the name, and the name before we go on.
            file.flush()
            os.fsync(file.fileno())
            temporary.replace(path)
        _sync_folder(path.parent)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        with suppress(OSError):
            temporary.unlink()


def unwritable(path: Path, error: OSError) -> BadValue:
    """Return the one line about a file that cannot be written."""
    advice = "is the folder the right one?"
    if error.errno in FULL:
        advice = "make room and run the same command again"
    return BadValue(f"{path}: cannot be written ({error.strerror or error}); {advice}")


def _sync_folder(folder: Path) -> None:
    """Make renames in a folder survive a power cut."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def clean(folder: Path, name: str = "*") -> None:
    """Remove the temporaries and locks that killed commands left in a folder, not living ones'.

    Args:
        folder: of results, in which nobody else keeps hidden files of such names.
        name: of the file that they belong to; * is any.
    """
    own = f".{name}.{'[0-9a-f]' * 12}.tmp"
    for left in chain(Path(folder).glob(own), Path(folder).glob(f".{name}.lock")):
        with suppress(OSError), left.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            left.unlink()


def save_array(path: Path, array: NDArray[Any]) -> None:
    """Write an array as `.npy`, atomically and without pickle."""
    buffer = BytesIO()
    np.save(buffer, array, allow_pickle=False)
    write_atomic(path, buffer.getvalue())


def save_json(path: Path, plain: Any) -> None:
    """Write plain containers as readable JSON, atomically, with sorted keys."""
    write_atomic(path, json_bytes(plain))


def json_bytes(plain: Any) -> bytes:
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


def open_array(path: Path, *, size: int, sha256: str, mend: str = MEND) -> NDArray[Any]:
    """Map an `.npy` file into memory, read-only, after checking that it is whole.

    Args:
        path: the file.
        size: expected, in bytes.
        sha256: expected, 64 hexadecimal digits.
        mend: what the error advises.

    Raises:
        BadValue: the file is missing, its size or checksum differs, or it holds Python objects.
    """
    check_file(path, size=size, expected=sha256, mend=mend)
    try:
        return np.load(path, mmap_mode="r", allow_pickle=False)
    except ValueError as error:
        raise BadValue(f"{path}: not a plain array ({one_line(error)}); {mend}") from None


def let_go(array: NDArray[Any]) -> None:
    """Give the pages of a memory-mapped array back to the system; a later look maps them anew."""
    mapping = getattr(array, "_mmap", None)
    if mapping is not None and hasattr(mmap, "MADV_DONTNEED"):
        mapping.madvise(mmap.MADV_DONTNEED)


def check_file(path: Path, *, size: int, expected: str, mend: str = MEND) -> None:
    """Raise `BadValue` unless a plain file is whole.

    Args:
        path: the file.
        size: expected, in bytes.
        expected: its SHA-256, 64 hexadecimal digits.
        mend: what the error advises.
    """
    damage = ""
    try:
        about = Path(path).stat()
        # The cheapest look comes first: a device or a pipe could be read for ever.
        if not stat.S_ISREG(about.st_mode):
            damage = "no plain file"
        elif about.st_size > LARGEST:
            # Of which nothing may be there, and a manifest that names it may be a stranger's.
            damage = f"{about.st_size} bytes, more than {LARGEST}"
        elif about.st_size != size:
            damage = f"{about.st_size} bytes instead of {size}"
        elif sha256(path) != expected:
            damage = "its SHA-256 differs"
    except OSError as error:
        raise BadValue(f"{path}: cannot be read ({error.strerror or error}); {mend}") from None
    if damage:
        raise BadValue(f"{path}: damaged, {damage}; {mend}")


def one_line(error: BaseException) -> str:
    """Return an exception's message without line breaks, and without advice to programmers."""
    return " ".join(str(error).partition("; use sys.set_int_max_str_digits()")[0].split())
