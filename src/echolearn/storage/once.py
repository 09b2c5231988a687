"""A thing is made once: whoever comes second takes what is there, or waits for the first.

    finished? -> lock -> finished meanwhile? -> make -> declare finished

Looking twice costs little: a finished thing is found without a lock, and whoever had to wait for
one finds what the other command has made. What `make` leaves is finished only when it says so
itself, last of all (`manifests.finish`).

A lock is a hidden file beside what it protects. The system frees it when its holder ends, even by
SIGKILL, and a forked worker does not inherit it. The file is removed when the lock is released, so
that folders of results, and the pages of a repository, hold nothing but what people want there.
"""

import secrets
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from glob import escape
from pathlib import Path
from typing import TypeVar

from filelock import FileLock, Timeout

from echolearn.storage.files import clean, unwritable

T = TypeVar("T")


def once(folder: Path, *, finished: Callable[[], T | None], make: Callable[[], T], doing: str) -> T:
    """Return what stands in a folder if it is finished, or else make it, one process at a time.

    Args:
        folder: place of what is made; it need not exist.
        finished: returns what is there if it is finished, else None; it is called again when the
            lock is held.
        make: makes it, and returns the same as `finished`.
        doing: what another command is doing if one has to wait for it, as in "trains this run".

    Raises:
        BadValue: the folder beside which the lock stands cannot be written.
    """
    found = finished()
    if found is not None:
        # Whoever made it may have been killed between its last word and the end of its lock.
        if lock_of(folder).exists():
            clean(folder.parent, escape(folder.name))
        return found

    with locked(folder, waiting=f"{folder.name}: waiting for another command that {doing}"):
        found = finished()
        return make() if found is None else found


def lock_of(path: Path) -> Path:
    """Return the file by which a path is locked."""
    return Path(path).parent / f".{Path(path).name}.lock"


@contextmanager
def locked(path: Path, *, waiting: str = "") -> Iterator[Path]:
    """Wait until nobody else, process or thread, is within this block for the same path.

    Args:
        path: a file or folder that the block changes; it need not exist.
        waiting: text for stderr if somebody else is there.

    Yields:
        The lock's file, `.<name>.lock` beside the path.

    Raises:
        BadValue: the folder beside the path cannot be written.
    """
    file = lock_of(path)
    # A disk without locks is an error: a file that merely exists would outlive a killed holder.
    lock = FileLock(file, fallback_to_soft=False)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        _acquire(lock, waiting=waiting)
    except OSError as error:
        raise unwritable(file, error) from error

    try:
        yield file
    finally:
        # Removed while it is still held: whoever waits for it sees that it has lost its name, and
        # locks a new one.
        with suppress(OSError):
            file.unlink()
        lock.release()


@contextmanager
def claimed(path: Path) -> Iterator[bool]:
    """Yield whether nobody else is within this block for the same path; who is keeps others out.

    Args:
        path: what is claimed; it need not exist, but its folder must.
    """
    file = Path(path).parent / f".{Path(path).name}.lock"
    lock = FileLock(file, fallback_to_soft=False)
    try:
        lock.acquire(timeout=0)
    except Timeout:
        yield False
        return
    try:
        yield True
    finally:
        # While it is held, as in `locked`.
        with suppress(OSError):
            file.unlink()
        lock.release()


@contextmanager
def presence(folder: Path) -> Iterator[Path]:
    """Keep a file in a folder by which others, on other machines too, know that they see the same.

    Args:
        folder: made if it is missing, and removed again if nothing else has come into it.

    Yields:
        The file; `files.clean` removes what a killed holder left.

    Raises:
        BadValue: the folder cannot be written.
    """
    try:
        with locked(Path(folder) / secrets.token_hex(6)) as mark:
            yield mark
    finally:
        with suppress(OSError):
            Path(folder).rmdir()


def _acquire(lock: FileLock, *, waiting: str) -> None:
    try:
        lock.acquire(timeout=0)
    except Timeout:
        if waiting:
            print(waiting, file=sys.stderr, flush=True)
        lock.acquire()
