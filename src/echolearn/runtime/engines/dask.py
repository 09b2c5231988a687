"""Jobs shared out by a Dask scheduler: among processes of this machine, or workers wherever they
run.

    address or scheduler_file -> that scheduler, with its workers; neither -> a cluster of this
    machine, for this run

Dask gives the jobs of a worker that was killed to another one, and at most `AHEAD` jobs are with
the scheduler at a time, so its memory does not grow with their number. A worker refuses jobs from
another version of echolearn or of what it computes with, since the bytes could differ. What Dask
logs is not shown: failures come back as errors.
"""

import copy
import logging
import re
import signal
import sys
import warnings
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import CancelledError
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import metadata
from itertools import islice
from multiprocessing import resource_tracker
from pathlib import Path
from pkgutil import resolve_name
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

import echolearn
from echolearn.checks import BadValue, check, check_number, check_whole
from echolearn.runtime.engine import T
from echolearn.runtime.processes import single_threads
from echolearn.storage.files import load_json

if TYPE_CHECKING:
    from distributed import Client

AHEAD = 2000
"""Jobs that are with the scheduler at a time."""

AGAIN = "the same command continues with what is finished"

INSTALL = "install there what is installed here"

LOGGERS = ("distributed", "distributed.client", "tornado", "tornado.application", "asyncio")


@dataclass(frozen=True)
class Dask:
    """Workers of a Dask scheduler.

    Attributes:
        workers: processes of this machine, if neither an address nor a file is given.
        address: of a running scheduler, tcp://host:port.
        scheduler_file: written by `dask scheduler --scheduler-file`, instead of an address.
        timeout: for an answer of the scheduler, in s.
    """

    workers: int = 2
    address: str | None = None
    scheduler_file: str | None = None
    timeout: float = 10.0

    def __post_init__(self) -> None:
        check_whole("workers", self.workers, low=1, high=1024)
        check_number("engine.timeout", self.timeout, low=0.1, high=86400.0, unit="s")
        both = self.address is not None and self.scheduler_file is not None
        check(
            not both,
            "engine.address",
            self.address,
            allowed="an address or a scheduler_file, not both",
        )
        if self.address is not None:
            check_address("engine.address", self.address)

    def __call__(self, work: Callable[[T], object], jobs: Sequence[T]) -> Generator[T, None, None]:
        """Do the jobs; see `Engine`."""
        with installed("dask"), quiet(), self._client(len(jobs)) as client:
            yield from share_out(client, work, jobs)

    def _client(self, jobs: int) -> AbstractContextManager["Client"]:
        if self.scheduler_file is not None:
            return connected(
                "engine.scheduler_file", address_in(Path(self.scheduler_file)), timeout=self.timeout
            )
        if self.address is not None:
            return connected("engine.address", self.address, timeout=self.timeout)
        return started(min(self.workers, jobs))


def check_address(name: str, address: object) -> None:
    """Raise `BadValue` unless `address` is that of a scheduler: scheme, host, port."""
    form = re.fullmatch(r"(tcp|tls)://(\[[0-9a-fA-F:.%]+\]|[\w.-]+):\d{1,5}", str(address))
    hint = "" if "://" in str(address) else "is tcp:// missing?"
    check(
        form is not None,
        name,
        address,
        allowed="an address, tcp://host:port, as the scheduler prints it",
        hint=hint,
    )


def address_in(path: Path) -> str:
    """Return the address that a scheduler has written into its file."""
    check(
        path.is_file(),
        "engine.scheduler_file",
        path,
        allowed="a file that dask scheduler --scheduler-file writes",
    )
    about = load_json(path)
    address = about.get("address") if isinstance(about, dict) else None
    check_address("engine.scheduler_file", address)
    return str(address)


@contextmanager
def installed(name: str) -> Iterator[None]:
    """Say what to install where Dask is missing."""
    try:
        import distributed  # noqa: F401
    except ImportError as error:
        raise BadValue(
            f"engine={name}: needs {error.name}; pip install 'echolearn[cluster]'"
        ) from None
    yield


@contextmanager
def quiet() -> Iterator[None]:
    """Let Dask log nothing in this process, and warn of nothing."""
    loggers = [logging.getLogger(name) for name in LOGGERS]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module=r"distributed\.")
            yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)


@contextmanager
def started(workers: int) -> Iterator["Client"]:
    """Start a cluster on this machine for the time of a `with` block: it ends with this process,
    however that ends.
    """
    from distributed import Client, LocalCluster

    with (
        TemporaryDirectory(prefix="echolearn-dask-", ignore_cleanup_errors=True) as scratch,
        single_threads(),
    ):
        with interrupts_held():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=0,
                dashboard_address="127.0.0.1:0",
                local_directory=scratch,
                silence_logs=logging.CRITICAL + 1,
            )
        with cluster, Client(cluster, set_as_default=False) as client:
            yield client


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Hold back interrupts for the time of a `with` block, and for good from all threads and
    processes begun in it.

    An interrupt reaches every process of a terminal: this one ends the others, which shall not
        complain of it, too.
    """
    resource_tracker.ensure_running()  # which would let them through again
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def connected(name: str, address: str, *, timeout: float) -> Iterator["Client"]:
    """Connect to a running scheduler for the time of a `with` block.

    Args:
        name: of the key that gave the address, for errors.
        address: of the scheduler.
        timeout: for its answer, in s.

    Raises:
        BadValue: no scheduler answers there, or one of another version does.
    """
    import dask
    import distributed

    with dask.config.set({"distributed.comm.timeouts.connect": timeout}):
        try:
            client = distributed.Client(address, timeout=timeout, set_as_default=False)
            found: Any = client.get_versions()
        except OSError as error:
            allowed = f"a Dask scheduler that answers within {timeout:g} s"
            raise BadValue(
                f"{name}={address}: {allowed}; is it running, and is the port right?"
            ) from error
        with client:
            ours, theirs = distributed.__version__, found["scheduler"]["packages"]["distributed"]
            check(
                theirs == ours, name, address, allowed=f"distributed {ours} as here, not {theirs}"
            )
            if not examine(client):
                print(
                    f"{name}={address}: no workers yet, waiting for the first",
                    file=sys.stderr,
                    flush=True,
                )
            yield client


def examine(client: "Client") -> int:
    """Return how many workers there are, all with the same echolearn as here.

    One that has none would die of the first job, and nobody would learn why. All else is told to
    the jobs.
    """
    try:
        found = client.run(resolve_name, "echolearn:__version__")
    except ModuleNotFoundError as error:
        raise BadValue(f"engine: a worker has no echolearn; {INSTALL}") from error
    for version in found.values():
        compare({"echolearn": version}, {"echolearn": echolearn.__version__})
    return len(found)


def compare(found: dict[str, str], expected: dict[str, str]) -> None:
    """Raise `BadValue` unless a worker has the expected versions."""
    other = [
        f"{name} {found[name]} instead of {value}"
        for name, value in expected.items()
        if found[name] != value
    ]
    if other:
        raise BadValue(f"engine: a worker has {', '.join(other)}; {INSTALL}")


def share_out(
    client: "Client", work: Callable[[T], object], jobs: Sequence[T]
) -> Generator[T, None, None]:
    """Let a scheduler's workers do the jobs; see `Engine`."""
    from distributed import KilledWorker, as_completed

    rest, expected = iter(jobs), versions()

    def submit(count: int) -> dict[Any, T]:
        return {
            client.submit(alone, work, expected, job, pure=False): job
            for job in islice(rest, count)
        }

    begun = submit(AHEAD)
    finished = as_completed(begun, loop=client.loop)
    try:
        for done in finished:
            done.result()
            more = submit(1)
            begun |= more
            finished.update(more)
            yield begun.pop(done)
    except KilledWorker as error:
        lost = f"a job was lost {error.allowed_failures + 1} times with its worker, last on {error.last_worker.address}"
        raise BadValue(
            f"engine: {lost}; is there memory for it? smaller plan.shard_rows need less; {AGAIN}"
        ) from error
    except CancelledError as error:
        raise BadValue(f"engine: the scheduler was lost, or cancelled the jobs; {AGAIN}") from error
    finally:
        with suppress(Exception):
            client.cancel(list(begun))


def alone(work: Callable[[T], object], expected: dict[str, str], job: T) -> None:
    """Do one job in a worker, with one thread.

    Raises:
        BadValue: the worker's versions are not the expected ones.
    """
    compare(versions(), expected)
    threadpool_limits(1)
    copy.deepcopy(work)(
        job
    )  # its arrays lie in what came from the network, at odd bytes, where sums round differently


@cache
def versions() -> dict[str, str]:
    """Return the versions of all that bytes depend on."""
    found = {name: metadata.version(name) for name in ("numpy", "scipy", "numba")}
    python = ".".join(map(str, sys.version_info[:2]))
    return {"echolearn": echolearn.__version__, "python": python, **found}
