"""Processes of this machine: each computes with one thread, and ends with the process that started
it.

A process with no thread but its own is forked: its children have at once what it has imported.
    Otherwise they are begun
anew, for half a second of imports each, since a thread may hold a lock that nobody would release in
a copy.
"""

import ctypes
import gc
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from pathlib import Path
from signal import SIG_DFL, SIGINT, signal
from threading import Thread
from threading import enumerate as enumerate_threads
from typing import TypeVar

T = TypeVar("T")

THREADED = ("torch", "sklearn", "numba", "dask")
"""Libraries that begin threads when they are used: how many they decided when they were imported.
"""

WATCH = "waits for the parent's end"
"""Name of the thread with which a process ends when the one that started it does."""

MMAP_THRESHOLD, TRIM_THRESHOLD, LARGE = -3, -1, 1 << 30
"""Numbers of settings in glibc's malloc.h, and a value of both that no array reaches."""


@contextmanager
def processes(
    count: int, *, begin: Callable[[], object] | None = None
) -> Iterator[ProcessPoolExecutor]:
    """Start `count` processes for the time of a `with` block; an error or interrupt cancels what
    has not begun.

    Args:
        count: how many.
        begin: what each of them does first; picklable.
    """
    context = get_context("fork" if is_alone() else "spawn")
    gc.freeze()  # what is there stays: looking through it again would only copy it into every process
    try:
        with (
            single_threads(),
            ProcessPoolExecutor(count, context, initializer=_begin, initargs=(begin,)) as pool,
        ):
            try:
                yield pool
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
    finally:
        gc.unfreeze()


def is_alone() -> bool:
    """Tell whether this process can be forked: it runs no second thread, also none of a library.

    But for the one that waits for the parent's end (`_begin`), which holds no lock.
    """
    threads, known = (
        Path("/proc/self/task"),
        1 + sum(thread.name == WATCH for thread in enumerate_threads()),
    )
    return (
        not sys.modules.keys() & set(THREADED)
        and threads.is_dir()
        and len(list(threads.iterdir())) == known
    )


def meanwhile(work: Callable[[], T], other: Callable[[], object]) -> T:
    """Return what `work` returns or raise what it raises, done by a copy of this process while this
    one does `other`.

    Args:
        work: done here, and nothing else, where this process cannot be forked; done here once more
            if the copy fails, so that an error comes from where it arose; its result is picklable.
        other: what this process will need anyway.
    """
    if not is_alone():
        return work()
    context = get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    copy = context.Process(target=_tell, args=(theirs, work), daemon=True)
    copy.start()
    theirs.close()
    other()
    with suppress(EOFError):  # it failed, could not send what it found, or was killed
        found: T = ours.recv()
        copy.join()
        return found
    return work()


def _tell(theirs: Connection, work: Callable[[], object]) -> None:
    signal(SIGINT, SIG_DFL)
    with suppress(Exception):
        theirs.send(work())


def keep_memory() -> None:
    """Let this process keep the memory of arrays that it frees for those to come.

    Else the system takes it back and has to clear it anew for each block of observations, a tenth
    of all the time.
    """
    library = ctypes.CDLL(None)
    if sys.platform == "linux" and hasattr(library, "mallopt"):
        for option in (MMAP_THRESHOLD, TRIM_THRESHOLD):
            library.mallopt(option, LARGE)


@contextmanager
def single_threads() -> Iterator[None]:
    """Let processes started inside compute with one thread each, or two of them fight over two
    cores.
    """
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})


def _begin(first: Callable[[], object] | None) -> None:
    """Die of an interrupt at once, and with the parent, even if it was killed: a pool's workers
    would wait forever.
    """
    signal(SIGINT, SIG_DFL)
    Thread(target=_end_with_parent, daemon=True, name=WATCH).start()
    if first is not None:
        first()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
