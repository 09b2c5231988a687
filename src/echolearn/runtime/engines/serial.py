"""One job after another, in this process."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from echolearn.runtime.engine import T
from echolearn.runtime.processes import single_threads


@dataclass(frozen=True)
class Serial:
    """No other process: for debuggers, profilers and single cores."""

    def __call__(self, work: Callable[[T], object], jobs: Sequence[T]) -> Generator[T, None, None]:
        """Do the jobs in their order, with one thread as everywhere; see `Engine`."""
        with single_threads(), threadpool_limits(1):
            for job in jobs:
                work(job)
                yield job
