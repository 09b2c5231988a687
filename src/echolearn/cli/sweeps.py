"""Many jobs: here one after another, in processes of this machine, or wherever a launcher of Hydra
takes them.

    for every (name, argument), in any order, in any process:  work(argument) -> result, or one line
    about an error

A failing job stops no other one; it is named at the end. Hydra gets the numbers of the jobs alone:
their configurations are composed before (`config.compose`), so a job is the same wherever it runs.
Processes compute with one thread each.
"""

import errno
import os
import sys
import traceback
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echolearn.checks import BadValue
from echolearn.cli.config import UsageError, folder
from echolearn.runtime.processes import processes, single_threads

if TYPE_CHECKING:
    from omegaconf import DictConfig

Job = tuple[str, Any]
Attempt = Callable[[Job], tuple[Any, str]]


ADVICE = {
    errno.EACCES: "may you read and write there?",
    errno.EPERM: "may you read and write there?",
    errno.ENOTDIR: "there is a file where a folder should be",
    errno.EISDIR: "there is a folder where a file should be",
    errno.ENAMETOOLONG: "choose a shorter name",
    errno.ENOSPC: "make room and run the same command again",
    errno.EROFS: "choose a place that can be written",
}
"""What to do about errors of the system."""


class JobsFailed(Exception):
    """Some jobs failed; each has been reported."""


def run_all(
    work: Callable[[Any], Any],
    jobs: Sequence[Job],
    *,
    workers: int = 1,
    launcher: Sequence[str] = (),
    place: Path = Path("sweeps"),
    trace: bool = False,
) -> None:
    """Do every job, and print the results in the order of the jobs.

    Args:
        work: what to do; picklable unless it is done here.
        jobs: names, and arguments of `work`.
        workers: processes.
        launcher: overrides that choose and set a launcher of Hydra instead; none for none.
        place: folder for what such a launcher writes.
        trace: print tracebacks, too.

    Raises:
        JobsFailed: some jobs failed.
        UsageError: a launcher that is not installed, or a setting that it does not know.
    """
    trying, failed = partial(attempt, work, trace=trace), []
    if launcher:
        results = by_hydra(trying, jobs, words=launcher, place=place)
    else:
        results = in_processes(trying, jobs, workers=workers) if workers > 1 else map(trying, jobs)
    for (name, _), (result, error) in zip(jobs, results, strict=True):
        if error:
            failed.append(name)
            print(error, file=sys.stderr, flush=True)
        say(result)
    if failed:
        raise JobsFailed(f"{len(failed)} of {len(jobs)} jobs failed: {'; '.join(failed)}")


def say(result: object) -> None:
    """Print what a command returns, if anything."""
    if result is not None:
        print(result, flush=True)


def attempt(work: Callable[[Any], Any], job: Job, *, trace: bool) -> tuple[Any, str]:
    """Do one job; return its result, and a text about its error that any process can send."""
    name, argument = job
    try:
        return work(argument), ""
    except Exception as error:
        return None, complaint(error, trace=trace, about=f"{name}: ")


def complaint(error: Exception, *, trace: bool, about: str = "") -> str:
    """Return one line about an error, after its traceback if wanted."""
    before = "".join(traceback.format_exception(error)) if trace else ""
    if isinstance(error, OSError) and error.filename is not None:
        reason = f"{os.fsdecode(error.filename)}: {error.strerror}; {ADVICE.get(error.errno or 0, 'is it the right one?')}"
        return f"{before}error: {about}{' '.join(reason.split())}"
    kind = (
        "" if isinstance(error, BadValue | UsageError | JobsFailed) else f"{type(error).__name__}: "
    )
    hint = "; pip install 'echolearn[lab]'" if isinstance(error, ModuleNotFoundError) else ""
    return f"{before}error: {about}{kind}{' '.join(str(error).split())}{hint}"


def in_processes(
    trying: Attempt, jobs: Sequence[Job], *, workers: int
) -> Iterable[tuple[Any, str]]:
    """Yield what comes of each job in turn, done by so many processes of this machine, which die of
    an interrupt.
    """
    with processes(min(workers, len(jobs))) as pool:
        yield from pool.map(trying, jobs)


def by_hydra(
    trying: Attempt, jobs: Sequence[Job], *, words: Sequence[str], place: Path
) -> Iterable[tuple[Any, str]]:
    """Return what comes of each job, done by a launcher of Hydra."""
    from hydra import initialize_config_dir
    from hydra.core.global_hydra import GlobalHydra
    from hydra.errors import HydraException

    quoted = str(place.resolve()).replace("'", "\\'")
    settings = [
        f"hydra.sweep.dir='{quoted}'",
        "hydra.sweep.subdir=.",
        "hydra.output_subdir=null",
        *words,
    ]
    settings += ["hydra/job_logging=none", "hydra/hydra_logging=none", f"+job=range({len(jobs)})"]
    with initialize_config_dir(version_base="1.3", config_dir=str(folder())), single_threads():
        hydra = GlobalHydra.instance().hydra
        assert hydra is not None
        try:
            batches = hydra.multirun(
                None, partial(_take, trying, jobs), settings, with_log_configuration=False
            )
        except HydraException as error:
            reason = str(error).split("\nSee http")[0]
            hint = "; pip install 'echolearn[cluster]'" if "Could not find" in reason else ""
            raise UsageError(f"{' '.join(words)}: {reason}{hint}") from error
    return [done.return_value for batch in batches for done in batch]


def _take(trying: Attempt, jobs: Sequence[Job], config: "DictConfig") -> tuple[Any, str]:
    return trying(jobs[config.job])
