"""Many jobs: one after another here, in processes of this machine, or by a launcher of Hydra.

    for every (name, argument), in any process:  work(argument) -> result, or a line about an error

A failing job stops no other one; it is named at the end. Hydra gets the numbers of the jobs alone:
their configurations are composed before (`compose`), so a job is the same wherever it runs.
Processes compute with one thread each.
"""

import errno
import os
import sys
import traceback
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echolearn.checks import BadValue, printable
from echolearn.cli.config import UsageError
from echolearn.cli.own import folder
from echolearn.runtime.processes import processes, single_threads
from echolearn.storage.files import one_line

if TYPE_CHECKING:
    from omegaconf import DictConfig

Job = tuple[str, Any]
"""Name and argument."""

Outcome = tuple[Any, str]
"""Result, and a line about an error; one of them is empty."""

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


KILLED = "its process was killed; was there too little memory? the same command tries it again"
"""What is said of a job whose process ended before it."""


EXTRAS = {
    "distributed": "cluster",
    "numba": "walls",
    "onnxruntime": "maps",
    "optuna": "tune",
    "rir_generator": "peers",
    "rosbags": "ros",
    "soundfile": "maps",
}
"""Smallest extra that brings a module which the laboratory does not need alone."""


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
        workers: number of processes.
        launcher: overrides that choose and set a launcher of Hydra instead; none for none.
        place: folder for what such a launcher writes.
        trace: whether to print tracebacks, too.

    Raises:
        JobsFailed: some jobs failed.
        UsageError: a launcher that is not installed, or a setting that it does not know.
    """
    trying = partial(_attempt, work, trace=trace)
    outcomes: Iterable[Outcome]
    if launcher:
        outcomes = _by_hydra(trying, jobs, launcher=launcher, place=place)
    elif workers > 1:
        outcomes = _in_processes(trying, jobs, workers=workers)
    else:
        outcomes = map(trying, jobs)

    failed = []
    for (name, _), (result, error) in zip(jobs, outcomes, strict=True):
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


def _attempt(work: Callable[[Any], Any], job: Job, *, trace: bool) -> Outcome:
    """Do one job; its error becomes a text, which any process can send."""
    name, argument = job
    try:
        return work(argument), ""
    except Exception as error:
        return None, complaint(error, trace=trace, about=name)


def complaint(error: Exception, *, trace: bool, about: str = "") -> str:
    """Return one line about an error.

    Args:
        error: what was raised.
        trace: whether its traceback stands before the line.
        about: name of the job, with which the line begins.
    """
    reason = f"{type(error).__name__}: {one_line(error)}"
    if isinstance(error, BadValue | UsageError | JobsFailed):
        reason = f"{error}"
    elif isinstance(error, ModuleNotFoundError):
        reason += f"; pip install 'echolearn[{EXTRAS.get(str(error.name), 'lab')}]'"
    elif isinstance(error, OSError) and error.filename is not None:
        advice = ADVICE.get(error.errno or 0, "is it the right one?")
        reason = f"{os.fsdecode(error.filename)}: {error.strerror}; {advice}"
    before = "".join(traceback.format_exception(error)) if trace else ""
    # What is refused is often what names the job: survey=nope, plan.step=0 m.
    if about and not reason.startswith((f"{about}:", f"{about} ")):
        reason = f"{about}: {reason}"
    # One line, but with its blanks: two of them may belong to the name that it says how to quote.
    line = " ".join(part.strip() for part in reason.splitlines() if part.strip())
    return f"{before}error: {printable(line)}"


def _in_processes(
    trying: Callable[[Job], Outcome], jobs: Sequence[Job], *, workers: int
) -> Iterable[Outcome]:
    """Yield what comes of each job, in order; a killed process costs the job it was at."""
    outcomes: dict[int, Outcome] = {}
    running: dict[Future[Outcome], tuple[int, ProcessPoolExecutor]] = {}
    begun = 0
    with ExitStack() as stack:
        # A pool of several would give up all that they do when one of them is killed.
        idle = [stack.enter_context(processes(1)) for _ in range(min(workers, len(jobs)))]
        for index in range(len(jobs)):
            while index not in outcomes:
                while idle and begun < len(jobs):
                    pool = idle.pop()
                    running[pool.submit(trying, jobs[begun])] = (begun, pool)
                    begun += 1
                for done in wait(running, return_when=FIRST_COMPLETED).done:
                    number, pool = running.pop(done)
                    try:
                        outcomes[number] = done.result()
                    except BrokenProcessPool:
                        outcomes[number] = (None, f"error: {jobs[number][0]}: {KILLED}")
                        pool = stack.enter_context(processes(1))
                    idle.append(pool)
            yield outcomes.pop(index)


def _by_hydra(
    trying: Callable[[Job], Outcome], jobs: Sequence[Job], *, launcher: Sequence[str], place: Path
) -> list[Outcome]:
    """Return what comes of each job, done by a launcher of Hydra."""
    from hydra import initialize_config_dir
    from hydra.core.global_hydra import GlobalHydra
    from hydra.errors import HydraException

    quoted = str(place.resolve()).replace("'", "\\'")
    settings = [
        f"hydra.sweep.dir='{quoted}'",
        "hydra.sweep.subdir=.",
        "hydra.output_subdir=null",
        *launcher,
        "hydra/job_logging=none",
        "hydra/hydra_logging=none",
        f"+job=range({len(jobs)})",
    ]
    work = partial(_take, trying, jobs)
    with initialize_config_dir(version_base="1.3", config_dir=str(folder())), single_threads():
        hydra = GlobalHydra.instance().hydra
        assert hydra is not None
        try:
            batches = hydra.multirun(None, work, settings, with_log_configuration=False)
        except HydraException as error:
            reason = str(error).split("\nSee http")[0]
            hint = "; pip install 'echolearn[cluster]'" if "Could not find" in reason else ""
            raise UsageError(f"{' '.join(launcher)}: {reason}{hint}") from error
    return [done.return_value for batch in batches for done in batch]


def _take(trying: Callable[[Job], Outcome], jobs: Sequence[Job], config: "DictConfig") -> Outcome:
    return trying(jobs[config.job])
