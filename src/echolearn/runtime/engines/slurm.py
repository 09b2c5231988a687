"""Jobs shared out by Dask among workers that SLURM starts.

This process is the scheduler, so it runs where the nodes can reach it, on the login node, as long
as the work lasts. SLURM starts `jobs` jobs of `cores` workers each, in its own time: work begins
with the first, and a job that reaches its wall time is followed by another. All end with this
process.
"""

import logging
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from echolearn.checks import BadValue, check, check_list, check_whole
from echolearn.runtime.engine import T
from echolearn.runtime.engines.dask import installed, interrupts_held, quiet, share_out

if TYPE_CHECKING:
    from dask_jobqueue import SLURMCluster


@dataclass(frozen=True)
class DaskSlurm:
    """Workers in jobs of SLURM.

    Attributes:
        jobs: SLURM jobs at a time.
        cores: of each job, with one worker on each.
        memory: of each job, such as 16GB.
        walltime: of each job, hours:minutes:seconds.
        queue: the partition; None for the default one.
        account: to be charged; None for the default one.
        interface: network interface by which workers and scheduler meet, such as ib0; None for the
            default one.
        directives: further options of sbatch, such as --constraint=skylake.
        prologue: shell lines before the workers start, such as "module load python".
        logs: folder for what the jobs print.
    """

    jobs: int = 1
    cores: int = 16
    memory: str = "16GB"
    walltime: str = "04:00:00"
    queue: str | None = None
    account: str | None = None
    interface: str | None = None
    directives: Sequence[str] = ()
    prologue: Sequence[str] = ()
    logs: str = "runs/slurm"

    def __post_init__(self) -> None:
        check_whole("engine.jobs", self.jobs, low=1, high=10_000)
        check_whole("engine.cores", self.cores, low=1, high=1024)
        check_size("engine.memory", self.memory)
        timed = re.fullmatch(r"(\d+-)?\d{1,3}:\d\d(:\d\d)?", str(self.walltime))
        check(
            timed is not None,
            "engine.walltime",
            self.walltime,
            allowed="hours:minutes:seconds, such as 04:00:00",
        )
        check_list("engine.directives", self.directives)
        check_list("engine.prologue", self.prologue)

    def __call__(self, work: Callable[[T], object], jobs: Sequence[T]) -> Generator[T, None, None]:
        """Do the jobs; see `Engine`."""
        with (
            installed("dask_slurm"),
            quiet(),
            self.started(len(jobs)) as cluster,
            cluster.get_client() as client,
        ):
            yield from share_out(client, work, jobs)

    @contextmanager
    def started(self, shares: int) -> Iterator["SLURMCluster"]:
        """Submit SLURM's jobs for the time of a `with` block, no more than have a share of the
        work.

        Raises:
            BadValue: SLURM is not here, or refuses such jobs.
        """
        allowed = "a machine with SLURM's sbatch; run this on a login node"
        check(shutil.which("sbatch") is not None, "engine", "dask_slurm", allowed=allowed)
        with interrupts_held():
            cluster = self.cluster()
        with cluster:
            accept(cluster)
            jobs = min(self.jobs, -(-shares // self.cores))
            taken = submit(cluster, jobs)
            said = (
                f"engine=dask_slurm: SLURM took {taken} of {jobs} jobs, {self.cores} workers each"
            )
            check(
                taken > 0,
                "engine",
                "dask_slurm",
                allowed="jobs that SLURM takes; is there a limit on their number?",
            )
            print(f"{said}; waiting for the first", file=sys.stderr, flush=True)
            cluster.adapt(minimum_jobs=jobs, maximum_jobs=jobs)
            yield cluster

    def cluster(self) -> "SLURMCluster":
        """Return the cluster: a scheduler in this process, and no jobs yet."""
        from dask_jobqueue import SLURMCluster

        return SLURMCluster(
            cores=self.cores,
            processes=self.cores,
            memory=self.memory,
            walltime=self.walltime,
            queue=self.queue,
            account=self.account,
            interface=self.interface,
            job_extra_directives=list(self.directives),
            job_script_prologue=["export NUMBA_NUM_THREADS=1", *self.prologue],
            job_name="echolearn",
            log_directory=str(Path(self.logs).resolve()),
            scheduler_options={"dashboard_address": "127.0.0.1:0"},
            silence_logs=logging.CRITICAL + 1,
        )


def check_size(name: str, size: object) -> None:
    """Raise `BadValue` unless `size` is a number of bytes with its unit."""
    number, unit = str(size)[:-2], str(size)[-2:]
    sized = number.strip().replace(".", "", 1).isdecimal() and unit in ("MB", "GB", "TB")
    check(
        sized, name, size, allowed="a size such as 16GB", hint="of a whole job, all cores together"
    )


def accept(cluster: "SLURMCluster") -> None:
    """Ask SLURM whether it would accept the cluster's jobs: a refusal later on has no text."""
    command = ["sbatch", "--test-only"]
    answer = subprocess.run(
        command, input=cluster.job_script(), capture_output=True, text=True, check=False
    )
    if answer.returncode:
        raise BadValue(
            f"engine=dask_slurm: SLURM refuses its jobs; {' '.join(answer.stderr.split())}"
        )


def submit(cluster: "SLURMCluster", jobs: int) -> int:
    """Submit so many jobs, and return how many of them SLURM took."""
    from distributed.core import Status

    cluster.scale(jobs=jobs)
    while len(cluster.workers) < jobs:
        time.sleep(0.05)
    refused = [job for job in cluster.workers.values() if job.job_id is None]
    for job in refused:
        job.status = Status.failed  # or the cluster cannot be closed
    return jobs - len(refused)
