"""Worker processes: one thread each, gone with their parent, nothing begun after an error."""

import gc
import os
import signal
import subprocess
import sys
import time
from contextlib import nullcontext
from weakref import ref

import numpy as np
import pytest

from children import is_alive
from echolearn.runtime.processes import processes, single_threads

pytestmark = pytest.mark.usefixtures("anew")

PARENT = """
import os, time
from echolearn.runtime.processes import processes
with processes(1) as pool:
    print(pool.submit(os.getpid).result(), flush=True)
    time.sleep(3600)
"""


def test_workers_end_when_their_parent_is_killed():
    command = [sys.executable, "-c", PARENT]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as parent:
        worker = int(parent.stdout.readline())
        assert is_alive(worker)
        parent.send_signal(signal.SIGKILL)
    # Far less than the minutes that it would sleep.
    deadline = time.monotonic() + 300
    while is_alive(worker) and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not is_alive(worker)


def test_workers_compute_with_one_thread(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    with processes(1) as pool:
        assert pool.submit(os.getenv, "OMP_NUM_THREADS").result() == "1"
    with pytest.raises(KeyError), single_threads():
        raise KeyError
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "MKL_NUM_THREADS" not in os.environ


@pytest.mark.parametrize("error", [None, KeyError()])
def test_what_was_there_before_can_be_collected_after(error):
    """Also what has become garbage in a circle, which nothing but the collector finds."""
    circle = [np.empty(0)]
    circle.append(circle)
    gone = ref(circle[0])
    with nullcontext() if error is None else pytest.raises(KeyError), processes(1):
        assert gc.get_freeze_count() > 0
        if error is not None:
            raise error
    del circle
    gc.collect()
    assert gc.get_freeze_count() == 0 and gone() is None


def test_an_error_cancels_what_has_not_begun():
    with pytest.raises(KeyError), processes(1) as pool:
        waiting = [pool.submit(time.sleep, 0.5) for _ in range(60)]
        raise KeyError
    assert sum(job.cancelled() for job in waiting) > 50
