"""Engines: the same set whoever computes it, and the error of whoever fails.

Workers, schedulers and what they die of are real.
"""

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import dask
import numpy as np
import pytest
from distributed import Client, get_worker

from children import is_alive
from echolearn.checks import BadValue
from echolearn.cli.compose import compose
from echolearn.cli.config import build
from echolearn.cli.main import main
from echolearn.cli.own import folder
from echolearn.dataset import generate as generation
from echolearn.dataset.generate import _write, folder_of, generate
from echolearn.dataset.records import records
from echolearn.runtime.engines.dask import Dask, do_alone, versions
from echolearn.runtime.engines.serial import Serial
from echolearn.storage import manifests
from echolearn.storage.once import presence

ENGINES = sorted(path.stem for path in (folder() / "engine").glob("*.yaml"))
BASE = "plan=tiny scene.probe.length=6000 localizer.azimuths=36 plan.room.t60=0.25"
SMALL = f"{BASE} plan.step=4.0 plan.height=3.0 plan.shard_rows=1".split()
"""Six rows in six shards."""

MANY = f"{BASE} plan.step=1.4 plan.shard_rows=4".split()
"""A set that takes two workers a second: 90 rows in 23 shards."""

Files = dict[str, bytes]


# ---------------------------------------------------------------- the world around


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Work in an empty folder, and return it."""
    place = tmp_path / "here"
    place.mkdir()
    monkeypatch.chdir(place)
    return place


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return what finds the shards of a set by its command line, made by one process."""
    made = {}

    def find(words):
        if str(words) not in made:
            runs = tmp_path_factory.mktemp("whole")
            made[str(words)] = shards(generate(plan_of(words), runs=runs, engine=Serial()))
        return made[str(words)]

    return find


def plan_of(words):
    """Return the plan of a command line."""
    [(_, config)] = compose("generate", words)
    return build(config["plan"], "plan")


def engine(option, workers):
    """Return an engine as the command line chooses it."""
    [(_, config)] = compose("generate", [f"engine={option}", f"workers={workers}"])
    return build(config["engine"], "engine")


def shards(place):
    """Return the bytes of every shard by its name."""
    return {path.name: path.read_bytes() for path in place.glob("*.npy")}


def finished(where):
    """Return how many shards tell that they are finished."""
    return len(list(where.glob("runs/data/*/shard-*.json")))


def started(*words):
    """Start a Python process that leads a group of its own."""
    command = [sys.executable, *map(str, words)]
    quiet = subprocess.DEVNULL
    return subprocess.Popen(
        command, text=True, stdout=quiet, stderr=subprocess.PIPE, start_new_session=True
    )


def wait_for(condition, seconds=600.0):
    """Wait until something holds."""
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "waited in vain"
        time.sleep(0.01)


@contextmanager
def running(role, about, *options, code=""):
    """Run a scheduler or a worker of Dask; the scheduler describes itself in the file `about`."""
    begin = f"{code}\nfrom distributed.cli.dask_{role} import main; main()"
    common = ["--no-dashboard", "--scheduler-file", about, *options]
    with started("-c", begin, *common) as process:
        try:
            wait_for(lambda: about.is_file() and about.read_text().endswith("}"))
            yield process
        finally:
            process.kill()
            process.communicate()


def scheduler(about, code="", protocol="tcp"):
    options = ["--port", "0", "--host", "127.0.0.1", "--protocol", protocol]
    return running("scheduler", about, *options, code=code)


def worker(about, code=""):
    scratch = about.parent / "scratch"
    options = ["--nthreads", "1", "--no-nanny", "--local-directory", scratch]
    return running("worker", about, *options, code=code)


@pytest.fixture(scope="module")
def about(tmp_path_factory):
    """Return the file of a running scheduler, without workers."""
    file = tmp_path_factory.mktemp("scheduler") / "scheduler.json"
    with scheduler(file):
        yield file


def address(about):
    return str(json.loads(about.read_text())["address"])


# ---------------------------------------------------------------- the contract


@pytest.mark.usefixtures("anew")
@pytest.mark.parametrize("option", ENGINES)
def test_every_engine_makes_the_same_set_and_redoes_nothing(option, here, tmp_path, whole):
    """One shard of six is there already."""
    plan = plan_of(SMALL)
    place = folder_of(plan, tmp_path)
    manifests.write_shard(place, 3, array=records(plan, range(3, 4)))
    before = (place / manifests.shard_name(3)).stat().st_mtime_ns
    assert generate(plan, runs=tmp_path, engine=engine(option, 2)) == place
    assert shards(place) == whole(SMALL)
    assert {path.name for path in place.iterdir()} == {"manifest.json", *whole(SMALL)}
    assert (place / manifests.shard_name(3)).stat().st_mtime_ns == before
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("option", ENGINES)
def test_every_engine_raises_the_error_of_the_job_and_cancels_the_others(option):
    began = time.monotonic()
    with pytest.raises(ValueError, match="^sleep length must be non-negative$"):
        list(engine(option, 1)(time.sleep, [0.0, -1.0, *[0.5] * 1000]))
    assert time.monotonic() - began < 400, "all of them take 500 s"


def test_shards_that_do_not_arrive_are_missed(tmp_path, monkeypatch):
    """Workers that see another disk say that they have done all jobs."""
    monkeypatch.setattr(generation, "PATIENCE", 0.1)
    said = "^runs=.*: .*a folder that all workers see and write to at the same path; some"
    with pytest.raises(BadValue, match=said):
        generate(plan_of(SMALL), runs=tmp_path, engine=lambda work, jobs: (job for job in jobs))
    assert not list(tmp_path.glob("data/*/manifest.json"))


def test_a_worker_that_does_not_find_the_mark_writes_nothing(tmp_path):
    """The folder of the same path may exist on another machine, too."""
    place = tmp_path / "data"
    with pytest.raises(BadValue, match=f"^runs={place}: .*a folder that all workers see"):
        _write(0, plan=plan_of(SMALL), mark=place / "mark")
    assert not place.exists()


def at_an_odd_byte(array):
    """Return the same numbers as they lie in a message from the network."""
    moved = np.frombuffer(b"-" + array.tobytes(), dtype=array.dtype, offset=1)
    assert not moved.flags.aligned
    return moved.reshape(array.shape)


def test_a_worker_computes_the_same_wherever_the_arrays_of_a_job_lie(here, whole):
    plan = plan_of(SMALL)
    for holder, name in ((plan.scene.array, "positions"), (plan.scene.probe, "samples")):
        object.__setattr__(holder, name, at_an_odd_byte(getattr(holder, name)))
    with presence(here) as mark:
        for shard in range(6):
            do_alone(partial(_write, plan=plan, mark=mark), versions(), shard)
    assert shards(here) == whole(SMALL)


# ---------------------------------------------------------------- Dask, wherever it runs


def test_the_command_line_reaches_a_running_scheduler(about, here, whole):
    """By its address, before there is a worker; a second one is lost in the middle of the work."""
    words = ["generate", *MANY, "engine=dask", f"engine.address={address(about)}"]
    with worker(about), worker(about) as second, started("-m", "echolearn", *words) as client:
        wait_for(lambda: finished(here) > 2)
        second.kill()
        done = finished(here)
        err = client.communicate(timeout=600)[1]
    [made] = here.glob("runs/data/*")
    assert 2 < done < 23
    assert client.returncode == 0
    assert err.splitlines()[-1] == f"generate {made.name}: 23 of 23 shards"
    waiting = f"engine.address={address(about)}: no workers yet, waiting for the first"
    told = (f"generate {made.name}: ", waiting)
    said = [line for line in err.splitlines() if not line.startswith(told)]
    # Dask itself may say that it asks again for what only the lost worker held.
    assert [line for line in said if "Couldn't gather" not in line] == []
    assert shards(made) == whole(MANY)
    assert [path.name for path in here.iterdir()] == ["runs"]


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import sys; sys.modules['echolearn'] = None", "no echolearn; install there what"),
        (
            "import echolearn; echolearn.__version__ = '0.0.9'",
            r"echolearn 0.0.9 instead of \d.*; install there what is installed here",
        ),
    ],
)
def test_a_worker_that_cannot_do_the_same_is_refused(about, code, said):
    with worker(about, code):
        with Client(scheduler_file=about, set_as_default=False) as client:
            client.wait_for_workers(1, timeout=600)
        with pytest.raises(BadValue, match=f"^engine: a worker has {said}"):
            list(Dask(scheduler_file=str(about))(math.sqrt, [4.0]))


def test_a_worker_that_comes_later_is_asked_by_its_jobs():
    said = "^engine: a worker has numpy .* instead of 1.0; install there what is"
    with pytest.raises(BadValue, match=said):
        do_alone(math.sqrt, versions() | {"numpy": "1.0"}, 4.0)


@pytest.mark.filterwarnings("error")
def test_a_scheduler_of_another_version_is_refused(tmp_path):
    code = (
        "import importlib.metadata as m; version = m.version\n"
        "m.version = lambda name: '1.0' if name == 'distributed' else version(name)"
    )
    with scheduler(tmp_path / "about", code), pytest.raises(BadValue, match="here, not 1.0$"):
        list(Dask(address=address(tmp_path / "about"))(math.sqrt, [4.0]))


def test_the_loss_of_the_scheduler_is_one_error(tmp_path):
    about = tmp_path / "about"
    with scheduler(about) as process, worker(about):
        jobs = Dask(address=address(about), timeout=1.0)(time.sleep, [0.0, 600.0])
        assert next(jobs) == 0.0
        process.kill()
        said = "^engine: the scheduler was lost, or cancelled the jobs; the same command"
        with pytest.raises(BadValue, match=said):
            next(jobs)


INTRUDER = """
import sys, distributed
for address in sys.argv[2:]:
    try:
        client = distributed.Client(address, timeout=1)
        client.submit(open, sys.argv[1], "w").result(timeout=3)
    except Exception:
        print(address.partition(":")[0], "refused")
"""
"""What another user of this machine could run: a client without the key of the workers."""


def intrude(folder):
    """Try, from a job, which knows where the scheduler is, to have work done as an intruder."""
    own = get_worker().scheduler.address
    command = [sys.executable, "-c", INTRUDER, folder / "done", own, own.replace("tls", "tcp")]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    (folder / "told").write_text(done.stdout)


def test_only_who_has_the_key_of_the_run_can_submit_work(tmp_path):
    list(Dask(workers=1)(intrude, [tmp_path]))
    assert (tmp_path / "told").read_text() == "tls refused\ntcp refused\n"
    assert not (tmp_path / "done").exists()


@pytest.mark.release
def test_a_cluster_with_a_key_as_advised_takes_work_from_its_owner_alone(here, whole, monkeypatch):
    page = (folder().parent / "docs" / "scaling.md").read_text()
    advice = page[page.index("    umask 077") :].partition("\n\n")[0]
    subprocess.run(["bash", "-ec", advice], check=True, capture_output=True)
    about = here / "about"
    for name in ("key.pem", "tls.yaml"):
        assert (here / "dask" / name).stat().st_mode & 0o077 == 0
    words = ["generate", *SMALL, "engine=dask", f"engine.scheduler_file={about}"]
    monkeypatch.setenv("DASK_CONFIG", str(here / "dask" / "tls.yaml"))
    with scheduler(about, protocol="tls"), worker(about):
        done = subprocess.run([sys.executable, "-m", "echolearn", *words], check=False)
        monkeypatch.delenv("DASK_CONFIG")
        command = [sys.executable, "-c", INTRUDER, here / "done", address(about)]
        told = subprocess.run(command, check=True, capture_output=True, text=True)
        with pytest.raises(BadValue, match="does DASK_CONFIG name its key"):
            list(Dask(scheduler_file=str(about))(math.sqrt, [4.0]))
    assert done.returncode == 0 and told.stdout == "tls refused\n"
    assert not (here / "done").exists()
    [made] = here.glob("runs/data/*")
    assert shards(made) == whole(SMALL)


def test_a_job_that_kills_its_workers_is_given_up():
    said = "^engine: a job was lost 2 times with its worker, last on tls://127[^\n]+$"
    fewer = dask.config.set({"distributed.scheduler.allowed-failures": 1})
    with fewer, pytest.raises(BadValue, match=said):
        list(Dask(workers=1)(os._exit, [1]))


def children(pid):
    """Return the processes below a process."""
    found = []
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in map(int, path.read_text().split()):
            found += [child, *children(child)]
    return found


def stopped(words, where, *, shards, number):
    """Stop a command by a signal once so many shards stand; return what it said."""
    with started("-m", "echolearn", *words) as client:
        wait_for(lambda: finished(where) >= shards)
        workers = children(client.pid)
        # A terminal sends its interrupt to all processes.
        send = os.killpg if number == signal.SIGINT else os.kill
        send(client.pid, number)
        err = client.communicate(timeout=300)[1]
        assert workers
        wait_for(lambda: not any(map(is_alive, workers)))
    return err


@pytest.mark.release
def test_a_command_that_was_stopped_leaves_no_process_and_is_continued(here, whole):
    def scratch():
        return set(Path(tempfile.gettempdir()).glob("echolearn-dask-*"))

    words = ["generate", *MANY, "engine=dask", "workers=1"]
    before = scratch()
    err = stopped(words, here, shards=1, number=signal.SIGINT)
    told = [line for line in err.splitlines() if not line.startswith("generate ")]
    assert told == ["error: interrupted; the same command continues with what is finished"]
    assert scratch() == before

    stopped(words, here, shards=finished(here) + 1, number=signal.SIGKILL)
    [made] = here.glob("runs/data/*")
    whole_shards = [p for p in made.glob("*.npy") if manifests.sidecar(p).exists()]
    times = {path: path.stat().st_mtime_ns for path in whole_shards}
    assert 1 < len(times) < 23
    assert not (made / manifests.MANIFEST).exists()

    assert main(words) == 0
    assert shards(made) == whole(MANY)
    assert {path: path.stat().st_mtime_ns for path in times} == times
    for path in scratch() - before:
        shutil.rmtree(path)


# ---------------------------------------------------------------- mistakes


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "engine.address=tcp://127.0.0.1:9 engine.timeout=0.5",
            "engine.address=tcp://127.0.0.1:9: must be a Dask scheduler that answers within 0.5 s;",
        ),
        ("engine.address=node1:8786", "engine.address=node1:8786: must be an address, tcp://host"),
        ("engine.address=tcp://node1", "engine.address=tcp://node1: must be an address, tcp://"),
        ("engine.address=8786", "engine.address=8786: must be an address, tcp://host:port"),
        (
            "engine.scheduler_file=no",
            "engine.scheduler_file=no: must be a file that dask scheduler",
        ),
        (
            "engine.scheduler_file=no engine.address=tcp://a:1",
            "engine.address=tcp://a:1: must not be given together with a scheduler_file",
        ),
        ("workers=0", "workers=0: must be a whole number from 1 to 1024"),
        ("engine.timeout=0", "engine.timeout=0 s: must be a number from 0.1 to 86400 s"),
    ],
)
def test_a_mistake_is_one_line(words, said, here, capsys):
    assert main(["generate", *SMALL, "engine=dask", *words.split()]) == 1
    err = capsys.readouterr().err
    assert err.startswith(f"error: {said}")
    assert err.count("\n") == 1
    assert not list(here.glob("runs/data/*"))


def test_without_dask_it_is_said_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(
        BadValue, match=r"^engine=dask: needs distributed; pip install 'echolearn\["
    ):
        list(Dask()(math.sqrt, [4.0]))
