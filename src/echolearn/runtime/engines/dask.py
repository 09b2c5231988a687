"""Jobs shared out by a Dask scheduler: among processes of this machine, or workers anywhere.

    address or scheduler_file -> that scheduler, with its workers
    neither                   -> a cluster of this machine, for this run, with a key of its own

Dask gives the jobs of a worker that was killed to another one, and at most `AHEAD` jobs are with
the scheduler at a time, so its memory does not grow with their number. A worker refuses jobs from
another version of echolearn or of what it computes with, since the bytes could differ. What Dask
logs is not shown: failures come back as errors.
"""

import copy
import json
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
from importlib.util import find_spec
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
        workers: number of processes of this machine, if neither an address nor a file is given.
        address: tls://host:port of a running scheduler, or tcp://host:port of one without a key.
        scheduler_file: path of what `dask scheduler --scheduler-file` writes, instead.
        timeout: longest wait for an answer of the scheduler, in s.
    """

    workers: int = 2
    address: str | None = None
    scheduler_file: str | None = None
    timeout: float = 10.0

    def __post_init__(self) -> None:
        check_whole("workers", self.workers, low=1, high=1024)
        check_number("engine.timeout", self.timeout, low=0.1, high=86400.0, unit="s")
        if self.address is not None:
            allowed = "must not be given together with a scheduler_file"
            check(self.scheduler_file is None, "engine.address", self.address, allowed=allowed)
            _check_address("engine.address", self.address)

    def __call__(self, work: Callable[[T], object], jobs: Sequence[T]) -> Generator[T, None, None]:
        """Do the jobs; see `Engine`."""
        hint = "pip install 'echolearn[cluster]'"
        for name in ("distributed", "cryptography"):
            allowed = f"needs {name}"
            check(find_spec(name) is not None, "engine", "dask", allowed=allowed, hint=hint)
        with _quiet(), self._client(len(jobs)) as client:
            yield from _share_out(client, work, jobs=jobs)

    def _client(self, jobs: int) -> AbstractContextManager["Client"]:
        if self.scheduler_file is not None:
            address = _address_in(Path(self.scheduler_file))
            return _connected("engine.scheduler_file", address, timeout=self.timeout)
        if self.address is not None:
            return _connected("engine.address", self.address, timeout=self.timeout)
        return _started(min(self.workers, jobs))


def _check_address(name: str, address: object) -> None:
    """Raise `BadValue` unless this is the address of a scheduler: scheme, host, port."""
    form = re.fullmatch(r"(tcp|tls)://(\[[0-9a-fA-F:.%]+\]|[\w.-]+):\d{1,5}", str(address))
    allowed = "must be an address, tcp://host:port or tls://host:port, as the scheduler prints it"
    hint = "" if "://" in str(address) else "is tcp:// missing?"
    check(form is not None, name, address, allowed=allowed, hint=hint)


def _address_in(path: Path) -> str:
    """Return the address that a scheduler has written into its file."""
    name = "engine.scheduler_file"
    allowed = "must be a file that dask scheduler --scheduler-file writes"
    check(path.is_file(), name, path, allowed=allowed)
    try:
        about = json.loads(path.read_bytes())
    except ValueError:
        about = None
    address = about.get("address") if isinstance(about, dict) else None
    _check_address(name, address)
    return str(address)


@contextmanager
def _quiet() -> Iterator[None]:
    """Let Dask log nothing in this process, and warn of nothing."""
    before = {name: logging.getLogger(name).level for name in LOGGERS}
    for name in LOGGERS:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", module=r"distributed\.")
            yield
    finally:
        for name, level in before.items():
            logging.getLogger(name).setLevel(level)


@contextmanager
def _started(workers: int) -> Iterator["Client"]:
    """Start a cluster on this machine, which ends with this process, however that ends.

    Its ports are open to all users of the machine, so it speaks to those alone who have the key
    that is made here, and has no pages.
    """
    import dask
    from distributed import Client, LocalCluster, Security

    keys = [f"distributed.{role}.http.routes" for role in ("scheduler", "worker")]
    with (
        dask.config.set(dict.fromkeys(keys, [])),
        TemporaryDirectory(prefix="echolearn-dask-", ignore_cleanup_errors=True) as scratch,
        single_threads(),
    ):
        with _interrupts_held():
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=0,
                dashboard_address="127.0.0.1:0",
                local_directory=scratch,
                silence_logs=logging.CRITICAL + 1,
                security=Security.temporary(),
            )
        with cluster, Client(cluster, set_as_default=False) as client:
            yield client


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Hold back interrupts, and for good from all threads and processes begun inside.

    An interrupt reaches every process of a terminal. This one ends the others, which shall not
    complain of it, too.
    """
    # Started later, it would let interrupts through again.
    resource_tracker.ensure_running()
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})


@contextmanager
def _connected(name: str, address: str, *, timeout: float) -> Iterator["Client"]:
    """Connect to a running scheduler.

    Args:
        name: key that gave the address, for errors.
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
        except (OSError, TypeError) as error:  # the latter where there is no key for tls://
            allowed = f"must be a Dask scheduler that answers within {timeout:g} s"
            hint = "is it running, is the port right, and does DASK_CONFIG name its key?"
            raise BadValue(f"{name}={address}: {allowed}; {hint}") from error

        with client:
            theirs = found["scheduler"]["packages"]["distributed"]
            allowed = f"must have distributed {distributed.__version__} as here, not {theirs}"
            check(theirs == distributed.__version__, name, address, allowed=allowed)
            if not _count_workers(client):
                waiting = "no workers yet, waiting for the first"
                print(f"{name}={address}: {waiting}", file=sys.stderr, flush=True)
            yield client


def _count_workers(client: "Client") -> int:
    """Return how many workers there are, all with the same echolearn as here.

    One that has none would die of the first job, and nobody would learn why. All else is told to
    the jobs.
    """
    try:
        found = client.run(resolve_name, "echolearn:__version__")
    except ModuleNotFoundError as error:
        raise BadValue(f"engine: a worker has no echolearn; {INSTALL}") from error
    for version in found.values():
        _check_versions({"echolearn": version}, {"echolearn": echolearn.__version__})
    return len(found)


def _check_versions(found: dict[str, str], expected: dict[str, str]) -> None:
    """Raise `BadValue` unless a worker has the expected versions."""
    for name, version in expected.items():
        if found[name] != version:
            other = f"{name} {found[name]} instead of {version}"
            raise BadValue(f"engine: a worker has {other}; {INSTALL}")


def _share_out(
    client: "Client", work: Callable[[T], object], *, jobs: Sequence[T]
) -> Generator[T, None, None]:
    """Let a scheduler's workers do the jobs; see `Engine`."""
    from distributed import KilledWorker, as_completed

    rest = iter(jobs)
    expected = versions()

    def submit(count: int) -> dict[Any, T]:
        """Hand one job to the cluster."""
        return {
            client.submit(do_alone, work, expected, job, pure=False): job
            for job in islice(rest, count)
        }

    begun = submit(AHEAD)
    finished = as_completed(begun, loop=client.loop)
    try:
        for done in finished:
            done.result()
            # One comes for each that goes, so the scheduler never holds more.
            more = submit(1)
            begun |= more
            finished.update(more)
            yield begun.pop(done)
    except KilledWorker as error:
        times = error.allowed_failures + 1
        lost = f"a job was lost {times} times with its worker, last on {error.last_worker.address}"
        hint = f"is there memory for it? smaller plan.shard_rows need less; {AGAIN}"
        raise BadValue(f"engine: {lost}; {hint}") from error
    except CancelledError as error:
        raise BadValue(f"engine: the scheduler was lost, or cancelled the jobs; {AGAIN}") from error
    finally:
        with suppress(Exception):
            client.cancel(list(begun))


def do_alone(work: Callable[[T], object], expected: dict[str, str], job: T) -> None:
    """Do one job in a worker, with one thread.

    Args:
        work: what to do.
        expected: versions that the worker must have.
        job: argument of `work`.

    Raises:
        BadValue: the worker has other versions.
    """
    _check_versions(versions(), expected)
    threadpool_limits(1)
    # Arrays that came by the network lie at odd bytes, where sums round differently; copies do not.
    copy.deepcopy(work)(job)


@cache
def versions() -> dict[str, str]:
    """Return the versions of all that bytes depend on."""
    found = {name: metadata.version(name) for name in ("numpy", "scipy", "numba")}
    python = ".".join(map(str, sys.version_info[:2]))
    return {"echolearn": echolearn.__version__, "python": python, **found}
