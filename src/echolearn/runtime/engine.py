"""Engines: where many independent jobs are done.

    for every job, in any order, in any process, on any machine:  work(job)

`generate` writes each shard of a set as one job, so the engine decides how long a set takes and
never what is in it: a job depends on its arguments alone, is computed by one thread, and leaves its
result on a disk that all share. An engine therefore carries no results. It says which job is done
as soon as it is, and when one fails it cancels what has not begun and raises that job's own error.

Implementations stand in `engines/`, one module each, chosen by a YAML file in `conf/engine`.
"""

from collections.abc import Callable, Generator, Sequence
from typing import Protocol, TypeVar

T = TypeVar("T")


class Engine(Protocol):
    """What does many jobs."""

    def __call__(self, work: Callable[[T], object], jobs: Sequence[T]) -> Generator[T, None, None]:
        """Do `work(job)` for each job, and yield every job when it is done, in any order.

        Args:
            work: what to do; picklable, and harmless when done twice, since an engine repeats what
                a lost worker began.
            jobs: arguments of `work`, at least one, picklable.

        Raises:
            BadValue: the engine itself cannot work; whatever else `work` raises comes through as it
                is.
        """
