"""Processes of this machine: each computes with one thread, and ends with the one that started it.

A process that runs no thread but its own is forked: its children have at once what it has imported.
Otherwise they are begun anew, for half a second of imports each, since a thread may hold a lock
that nobody would release in a copy.
"""

import ctypes
import gc
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from pathlib import Path
from signal import SIG_DFL, SIGINT, signal
from threading import Thread
from threading import enumerate as enumerate_threads

THREADED = frozenset({"torch", "sklearn", "numba", "dask"})
"""Libraries that begin threads when they are used: how many they decided when they were imported.
"""

THREAD_COUNTS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Variables of the environment from which libraries take their number of threads."""

WATCH = "waits for the parent's end"
"""Name of the thread with which a process ends when the one that started it does."""

MMAP_THRESHOLD = -3
TRIM_THRESHOLD = -1
"""Numbers of two settings in glibc's malloc.h."""

SELDOM = 100_000
"""Objects made, beyond those that are gone, until the collector looks for rings of them."""

LARGE = 1 << 30
"""Value of both, in bytes, that no array reaches."""


@contextmanager
def processes(
    count: int, *, begin: Callable[[], object] | None = None
) -> Iterator[ProcessPoolExecutor]:
    """Start processes for the time of a `with` block.

    An error or an interrupt in the block cancels what has not begun.

    Args:
        count: how many.
        begin: what each of them does first; picklable.
    """
    context = get_context("fork" if _can_be_forked() else "spawn")
    # The collector would look through all that is there in every process, and so copy it.
    gc.freeze()
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


def _can_be_forked() -> bool:
    """Tell whether this process runs no second thread, also none of a library.

    But for the one that waits for the parent's end (`_begin`), which holds no lock.
    """
    # A thread that holds a lock does not come along into a copy, so nobody would release it.
    known = 1 + sum(thread.name == WATCH for thread in enumerate_threads())
    threads = Path("/proc/self/task")
    if THREADED & sys.modules.keys() or not threads.is_dir():
        return False
    return len(list(threads.iterdir())) == known


@contextmanager
def single_threads() -> Iterator[None]:
    """Let processes started inside, and libraries loaded inside, compute with one thread each.

    Otherwise two processes would fight over two cores.
    """
    before = {name: os.environ.get(name) for name in THREAD_COUNTS}
    os.environ.update(dict.fromkeys(THREAD_COUNTS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name, None)
            if value is not None:
                os.environ[name] = value


def keep_memory() -> None:
    """Let this process keep the memory of arrays that it frees for those to come.

    Else the system takes it back and has to clear it anew for each block of observations, a tenth
    of all the time. Objects that refer to each other, which such work hardly makes, are sought
    seldom: looking through all that numba has made takes another thirtieth.
    """
    gc.set_threshold(SELDOM)
    library = ctypes.CDLL(None)
    if sys.platform == "linux" and hasattr(library, "mallopt"):
        library.mallopt(MMAP_THRESHOLD, LARGE)
        library.mallopt(TRIM_THRESHOLD, LARGE)


def _begin(first: Callable[[], object] | None) -> None:
    """Prepare a worker, which would otherwise outlive a parent that is killed, and wait for ever.

    An interrupt ends it at once.
    """
    # The pool hands an interrupt on only when a job ends, which may take minutes.
    signal(SIGINT, SIG_DFL)
    Thread(target=_end_with_parent, daemon=True, name=WATCH).start()
    if first is not None:
        first()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
