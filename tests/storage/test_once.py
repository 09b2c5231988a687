"""A thing is made once, by one process and one thread at a time, whoever is killed meanwhile."""

import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from echolearn.checks import BadValue
from echolearn.storage.files import clean
from echolearn.storage.once import locked, once, presence


def python(code, path):
    """Start a Python process that knows a path."""
    code = f"""
import os, sys, time
from pathlib import Path
from echolearn.storage.once import locked, presence
path = Path(sys.argv[1])
{code}"""
    return subprocess.Popen(
        [sys.executable, "-c", code, str(path)], text=True, stdout=subprocess.PIPE
    )


COUNT = """
for _ in range(100):
    with locked(path):
        path.write_text(str(int(path.read_text()) + 1))
"""


def test_processes_and_threads_change_a_file_one_at_a_time(tmp_path):
    path = tmp_path / "count"
    path.write_text("0")
    counting = [python(COUNT, path) for _ in range(2)]
    with ThreadPoolExecutor() as pool:
        list(pool.map(exec, [COUNT] * 2, [{"path": path, "locked": locked}] * 2))
    assert [process.wait() for process in counting] == [0, 0]
    assert path.read_text() == "400"
    assert list(tmp_path.iterdir()) == [path]


HOLD = """
with locked(path):
    if os.fork() == 0:
        os.setsid()
        time.sleep(60)  # a worker that outlives it
        os._exit(0)
    print("held", flush=True)
    time.sleep(60)
"""


def test_whoever_waits_says_so_once_and_comes_next_when_the_holder_is_killed(tmp_path, capfd):
    path = tmp_path / "new" / "folder"
    with python(HOLD, path) as holder:
        assert holder.stdout.readline() == "held\n"
        began = time.monotonic()
        threading.Timer(0.3, holder.kill).start()
        with locked(path, waiting="waiting for another"):
            assert holder.wait() == -signal.SIGKILL
            assert time.monotonic() - began < 50, "its child holds nothing"
            assert [path.name for path in path.parent.iterdir()] == [".folder.lock"]
    with locked(path, waiting="never said"):
        assert not path.exists()
    assert list(path.parent.iterdir()) == []
    assert capfd.readouterr().err == "waiting for another\n"


def test_an_error_inside_lets_the_next_in_and_leaves_nothing(tmp_path):
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt), locked(tmp_path / "a"), locked(tmp_path / "b"):
            raise KeyboardInterrupt
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    said = r"/\.b\.lock: cannot be written \(.+\); is the folder the right one\?$"
    with pytest.raises(BadValue, match=said), locked(tmp_path / "file" / "b"):
        pass


def test_a_thing_is_made_once_whoever_comes_second(tmp_path, capfd):
    made = []
    begun = threading.Event()

    def make():
        begun.set()
        time.sleep(0.2)
        made.append(1)
        return 1

    def found():
        return made[0] if made else None

    def ask():
        return once(tmp_path / "thing", finished=found, make=make, doing="makes it")

    with ThreadPoolExecutor() as pool:
        first = pool.submit(ask)
        begun.wait()
        assert ask() == first.result() == ask() == 1
    assert made == [1]
    assert capfd.readouterr().err == "thing: waiting for another command that makes it\n"


PRESENT = """
with presence(path):
    print("here", flush=True)
    time.sleep(60)
"""


def test_a_presence_lasts_as_long_as_its_process(tmp_path):
    place = tmp_path / "data"
    with presence(place) as mark:
        clean(place)
        assert mark.is_file()
    assert not place.exists(), "nothing came of it"

    with python(PRESENT, place) as holder:
        holder.stdout.readline()
        os.kill(holder.pid, signal.SIGKILL)
    [mark] = place.iterdir()
    clean(place)
    assert not mark.exists()


def test_a_lock_left_beside_what_is_finished_goes_and_a_held_one_stays(tmp_path):
    folder = tmp_path / "thing [1]"
    folder.mkdir()
    left, others = tmp_path / ".thing [1].lock", tmp_path / ".thing 1.lock"
    for lock in (left, others):
        lock.touch()

    def take():
        return once(folder, finished=lambda: "made", make=lambda: "again", doing="makes it")

    assert take() == "made" and not left.exists() and others.exists()
    with locked(folder):
        assert take() == "made" and left.exists()
