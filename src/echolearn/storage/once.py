"""A thing is made once: whoever comes second takes what is there, or waits for the first one to
finish it.

    finished? -> lock -> finished meanwhile? -> make -> declare finished

Looking twice costs little: a finished thing is found without a lock, and whoever had to wait for
    one finds what the
other command has made. What `make` leaves is finished only when it says so itself, last of all
(`manifests.finish`).
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from filelock import FileLock, Timeout

from echolearn.storage.files import unwritable

T = TypeVar("T")


def once(folder: Path, *, finished: Callable[[], T | None], make: Callable[[], T], doing: str) -> T:
    """Return what stands in a folder if it is finished, or else make it, one process at a time.

    Args:
        folder: what is made; it need not exist.
        finished: returns what is there if it is finished, else None; it is called again when the
            lock is held.
        make: makes it, and returns the same as `finished`.
        doing: what another command is doing if one has to wait for it, as in "trains this run".

    Raises:
        BadValue: the folder beside which the lock stands cannot be written.
    """
    found = finished()
    if found is not None:
        return found
    with locked(folder, waiting=f"{folder.name}: waiting for another command that {doing}"):
        found = finished()
        return make() if found is None else found


@contextmanager
def locked(path: Path, *, waiting: str = "") -> Iterator[None]:
    """Wait until no other process, or thread, is within this block for the same path, which need
    not exist.

    A file `.<name>.lock` stands beside the path. The system gives the lock of a killed holder to
    the next.

    Args:
        path: a file or folder that the block changes.
        waiting: what to say on stderr if another is there.

    Raises:
        BadValue: the folder beside the path cannot be written.
    """
    place = Path(path).parent / f".{Path(path).name}.lock"
    lock = FileLock(place)
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire(timeout=0)
        except Timeout:
            if waiting:
                print(waiting, file=sys.stderr, flush=True)
            lock.acquire()
    except OSError as error:
        raise unwritable(place, error) from error
    try:
        yield
    finally:
        lock.release()
