"""Work in a process beside the test: begun, killed in the middle, or gone."""

import signal
import sys
import time
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path


def may_be_copied() -> bool:
    """Tell whether copies of this process can do all that it can.

    No copy can use CUDA once this process has asked for it, and training asks, on the CPU, too: the
    optimiser looks for a graph that is being captured.
    """
    torch = sys.modules.get("torch")
    return torch is None or not torch.cuda.is_available()


def begin(work: Callable[[], object]) -> BaseProcess:
    """Start work, which can be pickled, in a process of its own, a copy of this where it may be."""
    child = get_context("fork" if may_be_copied() else "spawn").Process(target=work)
    child.start()
    return child


def kill_when(ready: Callable[[], object], work: Callable[[], object]) -> None:
    """Do work in a process of its own, and kill it with SIGKILL as soon as `ready`."""
    child = begin(work)
    while child.is_alive() and not ready():
        time.sleep(0.001)
    child.kill()
    child.join()
    assert child.exitcode == -signal.SIGKILL


def is_alive(pid: int) -> bool:
    """Tell whether a process runs, whoever has begun it."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
