"""Many jobs, wherever they run: all are done, failures are named, results come in order, each has
one thread."""

import errno
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from echolearn.checks import BadValue
from echolearn.cli.config import UsageError
from echolearn.cli.sweeps import JobsFailed, complaint, run_all

pytestmark = pytest.mark.usefixtures("anew")

ROOTS = [(f"x={x:g}", x) for x in (4.0, -1.0, -4.0, 9.0, 2.25)]

HERE = {}
PROCESSES = {"workers": 2}
SUBMITTED = {"launcher": ["hydra/launcher=submitit_local", "hydra.launcher.timeout_min=2"]}
JOBLIB = {"launcher": ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2"]}
SLURM = {
    "launcher": [
        "hydra/launcher=submitit_slurm",
        "hydra.launcher.partition=short",
        "hydra.launcher.timeout_min=2",
    ]
}
BASIC = {"launcher": ["hydra/launcher=basic"]}
EVERYWHERE = {
    "here": HERE,
    "processes": PROCESSES,
    "basic": BASIC,
    "joblib": JOBLIB,
    "submitit": SUBMITTED,
    "slurm": SLURM,
}


@pytest.fixture(autouse=True)
def slurm(tmp_path, monkeypatch):
    """Put a SLURM on the path that runs its jobs on this machine; return where it keeps them."""
    home = tmp_path.with_name(f"{tmp_path.name}-slurm")
    monkeypatch.setenv("PATH", f"{Path(__file__).parent / 'slurm'}:{os.environ['PATH']}")
    monkeypatch.setenv("SLURM_HOME", str(home))
    return home


@pytest.mark.parametrize("where", EVERYWHERE)
def test_all_jobs_are_done_and_failures_are_named(where, tmp_path, capsys):
    # Where each job is a process of its own, three have to do.
    jobs = ROOTS[:3] if where in ("submitit", "slurm") else ROOTS
    with pytest.raises(JobsFailed, match=f"^2 of {len(jobs)} jobs failed: x=-1; x=-4$"):
        run_all(math.sqrt, jobs, place=tmp_path / "it's = here", **EVERYWHERE[where])
    out, err = capsys.readouterr()
    assert out.split() == ["2.0", "3.0", "1.5"][: len(jobs) - 2]
    failures = [line for line in err.splitlines() if "error" in line]
    assert failures == [f"error: x={x}: ValueError: math domain error" for x in (-1, -4)]
    assert {path.name for path in tmp_path.iterdir()} == (
        {"it's = here"} if "launcher" in EVERYWHERE[where] else set()
    )


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (errno.EACCES, "runs/a b: Permission denied; may you read and write there?"),
        (errno.ENOTDIR, "runs/a b: Not a directory; there is a file where a folder should be"),
        (errno.ENAMETOOLONG, "runs/a b: File name too long; choose a shorter name"),
        (errno.EIO, "runs/a b: Input/output error; is it the right one?"),
    ],
)
def test_errors_of_the_system_name_the_file_and_what_to_do(number, said):
    error = OSError(number, os.strerror(number), "runs/a\nb")
    assert complaint(error, trace=False, about="seed=1") == f"error: seed=1: {said}"
    assert complaint(OSError("odd"), trace=False) == "error: OSError: odd"


@pytest.mark.parametrize("said", ["seed=-1: must be 0", "seed=-1 s: must be 0"])
def test_a_job_that_is_named_by_what_is_refused_is_named_once(said):
    assert complaint(BadValue(said), trace=False, about="seed=-1") == f"error: {said}"
    assert complaint(BadValue(said), trace=False, about="seed=-") == f"error: seed=-: {said}"


@pytest.mark.parametrize("where", ["processes", "joblib"])
def test_processes_compute_with_one_thread(where, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    run_all(
        os.getenv,
        [("a", "OMP_NUM_THREADS"), ("b", "NUMBA_NUM_THREADS")],
        place=tmp_path,
        **EVERYWHERE[where],
    )
    assert capsys.readouterr().out.split() == ["1", "1"]
    assert os.environ["OMP_NUM_THREADS"] == "7"


SLEEPERS = """
import time
from echolearn.cli.sweeps import run_all
run_all(time.sleep, [("one", 0), ("two", 3600), ("three", 3600), ("four", 3600)], workers=2)
"""


def test_an_interrupt_ends_all_processes_at_once():
    with subprocess.Popen(
        [sys.executable, "-c", SLEEPERS], start_new_session=True, stderr=subprocess.PIPE
    ) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        while process.poll() is None and len(children.read_text().split()) < 2:
            time.sleep(0.05)  # they are 3 if they are not forked
        time.sleep(1.0)
        os.killpg(process.pid, signal.SIGINT)
        err = process.communicate(timeout=600)[1]
    assert b"KeyboardInterrupt" in err


def test_a_traceback_comes_from_where_the_error_arose(capsys):
    with pytest.raises(JobsFailed):
        run_all(math.sqrt, [("x=-1", -1.0)], workers=2, trace=True)
    err = capsys.readouterr().err
    assert "Traceback (most recent call last)" in err
    assert err.endswith("error: x=-1: ValueError: math domain error\n")


def test_a_job_without_a_result_says_nothing(capsys):
    run_all(os.getenv, [("none", "NO_SUCH_VARIABLE")])
    assert capsys.readouterr() == ("", "")


def test_slurm_is_asked_for_an_array_of_jobs_of_one_thread(tmp_path, slurm, capsys, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    run_all(
        os.getenv, [("a", "OMP_NUM_THREADS"), ("b", "SLURM_ARRAY_TASK_ID")], place=tmp_path, **SLURM
    )
    assert capsys.readouterr().out.split() == ["1", "1"]
    [script] = slurm.glob("*.sh")
    asked = set(script.read_text().splitlines())
    assert asked >= {
        "#SBATCH --array=0-1%2",
        "#SBATCH --partition=short",
        "#SBATCH --time=2",
        "#SBATCH --nodes=1",
    }


def test_a_launcher_that_is_not_there_is_one_mistake_of_the_command_line(tmp_path):
    with pytest.raises(
        UsageError, match=r"(?s)^hydra/launcher=moon: .*; pip install 'echolearn\[cluster\]'$"
    ):
        run_all(math.sqrt, ROOTS, launcher=["hydra/launcher=moon"], place=tmp_path)


def ended(signal):
    """Return a signal's number, after sending it to this process unless it is 0."""
    if signal:
        os.kill(os.getpid(), signal)
    return signal


def test_a_killed_process_costs_its_own_job(capsys):
    jobs = [("one", 0), ("two", 9), ("three", 0), ("four", 9), ("five", 0)]
    with pytest.raises(JobsFailed, match="2 of 5 jobs failed: two; four"):
        run_all(ended, jobs, workers=2)
    said = capsys.readouterr()
    assert said.out == "0\n" * 3
    assert said.err.count("its process was killed") == 2
