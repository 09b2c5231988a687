"""Jobs shared out among processes of this machine."""

from collections.abc import Callable, Generator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass

from echolearn.checks import BadValue, check_whole
from echolearn.runtime.engine import T
from echolearn.runtime.processes import keep_memory, processes


@dataclass(frozen=True)
class Processes:
    """Processes of one thread each, as long as the jobs last.

    Attributes:
        workers: how many.
    """

    workers: int = 2

    def __post_init__(self) -> None:
        check_whole("workers", self.workers, low=1, high=1024)

    def __call__(self, work: Callable[[T], object], jobs: Sequence[T]) -> Generator[T, None, None]:
        """Do the jobs; see `Engine`."""
        try:
            with processes(min(self.workers, len(jobs)), begin=keep_memory) as pool:
                begun = {pool.submit(work, job): job for job in jobs}
                for done in as_completed(begun):
                    done.result()
                    yield begun.pop(done)
        except BrokenProcessPool:
            reason = "all must live, and one was killed, perhaps for lack of memory"
            hint = "the same command continues with what is finished"
            raise BadValue(
                f"workers={self.workers}: {reason}; {hint}, engine=dask survives this"
            ) from None
