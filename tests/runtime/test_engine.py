"""Engines: the same set whoever computes it, the error of whoever fails, and nothing left of those
that were killed.

Workers, schedulers and what they die of are real; SLURM is played by the scripts in `tests/slurm`,
which run what they are given on this machine.
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
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import dask
import numpy as np
import pytest
from distributed import Client

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue
from echolearn.cli.compose import compose
from echolearn.cli.config import build, folder
from echolearn.cli.main import main
from echolearn.dataset import generate as generation
from echolearn.dataset.generate import _write, folder_of, generate
from echolearn.dataset.records import records
from echolearn.runtime.engines.dask import Dask, do_alone, versions
from echolearn.runtime.engines.serial import Serial
from echolearn.storage import manifests
from echolearn.storage.files import clean
from echolearn.storage.once import presence

ENGINES = sorted(path.stem for path in (folder() / "engine").glob("*.yaml"))

SMALL = (
    "plan=tiny plan.step=4.0 plan.height=3.0 plan.shard_rows=1 plan.room.t60=0.25 scene.probe.length=6000 "
    "localizer.azimuths=36"
).split()
"""Six rows in six shards."""

MANY = "plan=tiny plan.step=1.4 plan.shard_rows=4 plan.room.t60=0.4 scene.probe.length=10000 localizer.azimuths=36".split()
"""A set that takes two workers a second: 90 rows in 23 shards."""

SOURCE = Path(__file__).parents[2] / "src"


# ---------------------------------------------------------------- the world around


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in an empty folder, with a SLURM on the path, and return the folder."""
    monkeypatch.setenv("PYTHONPATH", f"{SOURCE}:{os.environ.get('PYTHONPATH', '')}")
    place = tmp_path / "here"
    place.mkdir()
    monkeypatch.chdir(place)
    return place


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Callable[[list[str]], dict[str, bytes]]:
    """Return what finds the files of a set by its command line, made by one process."""
    made: dict[str, dict[str, bytes]] = {}

    def find(words: list[str]) -> dict[str, bytes]:
        if str(words) not in made:
            made[str(words)] = contents(
                generated(words, Serial(), tmp_path_factory.mktemp("whole"))
            )
        return made[str(words)]

    return find


def generated(words: list[str], engine: Any, runs: Path) -> Path:
    """Make a set, and return its folder."""
    return generate(plan_of(words), runs=runs, engine=engine)


def plan_of(words: list[str]) -> Any:
    """Return the plan of a command line."""
    [(_, config)] = compose("generate", words)
    return build(config["plan"])


def contents(place: Path) -> dict[str, bytes]:
    """Return the bytes of every file by its name."""
    return {path.name: path.read_bytes() for path in place.iterdir()}


def shards(files: dict[str, bytes]) -> dict[str, bytes]:
    """Return those files that are shards: manifests name the command line."""
    return {name: content for name, content in files.items() if name.endswith(".npy")}


def started(*words: object, **options: Any) -> subprocess.Popen[str]:
    """Start a Python process that leads a group of its own."""
    command, quiet = [sys.executable, *map(str, words)], subprocess.DEVNULL
    return subprocess.Popen(
        command, text=True, stdout=quiet, stderr=subprocess.PIPE, start_new_session=True, **options
    )


def wait_for(condition: Callable[[], object], seconds: float = 60.0) -> None:
    """Wait until something holds."""
    until = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < until, "waited in vain"
        time.sleep(0.01)


def children(pid: int) -> list[int]:
    """Return the processes below a process."""
    found: list[int] = []
    for path in Path(f"/proc/{pid}/task").glob("*/children"):
        own = [int(word) for word in path.read_text().split()]
        found += own + [below for child in own for below in children(child)]
    return found


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def leftovers() -> set[str]:
    return {path.name for path in Path(tempfile.gettempdir()).glob("echolearn-dask-*")}


@contextmanager
def scheduler(about: Path, code: str = "") -> Iterator[subprocess.Popen[str]]:
    """Run a Dask scheduler that describes itself in the file `about`."""
    begin = f"{code}\nfrom distributed.cli.dask_scheduler import main; main()"
    options = ["--port", "0", "--host", "127.0.0.1", "--no-dashboard", "--scheduler-file", about]
    with started("-c", begin, *options) as process:
        try:
            wait_for(lambda: about.is_file() and about.read_text().endswith("}"))
            yield process
        finally:
            process.kill()
            process.communicate()


@contextmanager
def worker(about: Path, code: str = "") -> Iterator[subprocess.Popen[str]]:
    """Run a worker of that scheduler."""
    begin = f"{code}\nfrom distributed.cli.dask_worker import main; main()"
    options = [
        "--nthreads",
        "1",
        "--no-nanny",
        "--no-dashboard",
        "--local-directory",
        about.parent / "scratch",
    ]
    with started("-c", begin, "--scheduler-file", about, *options) as process:
        try:
            yield process
        finally:
            process.kill()
            process.communicate()


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Return the file of a running scheduler, without workers."""
    about = tmp_path_factory.mktemp("scheduler") / "scheduler.json"
    with scheduler(about):
        yield about


def arrived(about: Path) -> None:
    """Wait for a worker."""
    with Client(scheduler_file=about, set_as_default=False) as client:
        client.wait_for_workers(1, timeout=60)


def address(about: Path) -> str:
    return str(json.loads(about.read_text())["address"])


# ---------------------------------------------------------------- the contract


def engine(option: str, runs: Path, workers: int) -> Any:
    """Return an engine with so many workers, as the command line chooses it."""
    [(_, config)] = compose("generate", [f"engine={option}", f"workers={workers}"])
    return build(config["engine"], "engine")


@pytest.mark.parametrize("option", ENGINES)
def test_every_engine_makes_the_same_set_and_redoes_nothing(
    option: str, elsewhere: Path, tmp_path: Path, whole: Callable[[list[str]], dict[str, bytes]]
) -> None:
    """One shard of six is there already."""
    plan = plan_of(SMALL)
    place = folder_of(plan, tmp_path)
    manifests.write_shard(place, 3, records(plan, range(3, 4)))
    before = (place / manifests.shard_name(3)).stat().st_mtime_ns
    assert generated(SMALL, engine(option, tmp_path, 2), tmp_path) == place
    assert contents(place) == whole(SMALL)
    assert (place / manifests.shard_name(3)).stat().st_mtime_ns == before
    assert list(elsewhere.iterdir()) == []


@pytest.mark.parametrize("option", ENGINES)
def test_every_engine_raises_the_error_of_the_job_and_cancels_the_others(
    option: str, elsewhere: Path, tmp_path: Path
) -> None:
    jobs = engine(option, tmp_path, 1)(time.sleep, [0.0, -1.0, *[0.5] * 200])
    began = time.monotonic()
    with pytest.raises(ValueError, match="^sleep length must be non-negative$"):
        list(jobs)
    assert time.monotonic() - began < 40
    assert list(elsewhere.iterdir()) == []


def elsewhere_only(work: Callable[[int], object], jobs: list[int]) -> Iterator[int]:
    """Play workers that see another disk."""
    yield from jobs


def test_shards_that_do_not_arrive_are_missed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(generation, "PATIENCE", 0.1)
    with pytest.raises(
        BadValue,
        match="^runs=.*: a folder that all workers see and write to at the same path; some",
    ):
        generated(SMALL, elsewhere_only, tmp_path)
    assert not list(tmp_path.glob("data/*/manifest.json"))


def test_a_worker_that_does_not_find_the_mark_writes_nothing(tmp_path: Path) -> None:
    """The folder of the same path may exist on another machine, too."""
    place = tmp_path / "data"
    with presence(place) as mark:
        assert mark.is_file()
        clean(place)
        assert mark.is_file()
    assert not place.exists()
    with pytest.raises(BadValue, match=f"^runs={place}: a folder that all workers see"):
        _write(0, plan=plan_of(SMALL), mark=mark)
    assert not place.exists()


def at_an_odd_byte(array: Array) -> Array:
    """Return the same numbers as they lie in a message from the network."""
    moved: Array = np.frombuffer(b"-" + array.tobytes(), dtype=array.dtype, offset=1).reshape(
        array.shape
    )
    assert not moved.flags.aligned
    return moved


def test_a_worker_computes_the_same_wherever_the_arrays_of_a_job_lie(
    elsewhere: Path, whole: Callable[[list[str]], dict[str, bytes]]
) -> None:
    plan = plan_of(SMALL)
    object.__setattr__(plan.scene.array, "positions", at_an_odd_byte(plan.scene.array.positions))
    object.__setattr__(plan.scene.probe, "samples", at_an_odd_byte(plan.scene.probe.samples))
    with presence(elsewhere) as mark:
        for shard in range(6):
            do_alone(partial(_write, plan=plan, mark=mark), versions(), shard)
    assert shards(contents(elsewhere)) == shards(whole(SMALL))


# ---------------------------------------------------------------- Dask, wherever it runs


def test_the_command_line_reaches_a_running_scheduler(
    running: Path,
    elsewhere: Path,
    capsys: pytest.CaptureFixture[str],
    whole: Callable[[list[str]], dict[str, bytes]],
) -> None:
    """By its address, before there is a worker; a second one is lost in the middle of the work."""
    words = ["generate", *MANY, "engine=dask", f"engine.address={address(running)}"]
    with (
        worker(running),
        worker(running) as second,
        started("-m", "echolearn", *words, cwd=elsewhere) as client,
    ):
        wait_for(lambda: len(list(finished(elsewhere))) > 2)
        second.kill()
        done = len(list(finished(elsewhere)))
        err = client.communicate(timeout=60)[1]
    [made] = elsewhere.glob("runs/data/*")
    assert 2 < done < 23
    assert client.returncode == 0
    assert err.splitlines()[-1] == f"generate {made.name}: 23 of 23 shards"
    told = (
        f"generate {made.name}: ",
        f"engine.address={address(running)}: no workers yet, waiting for the first",
    )
    assert all(line.startswith(told) for line in err.splitlines())
    assert shards(contents(made)) == shards(whole(MANY))
    assert [path.name for path in elsewhere.iterdir()] == ["runs"]


@pytest.mark.parametrize(
    ("code", "said"),
    [
        (
            "import sys; sys.modules['echolearn'] = None",
            "engine: a worker has no echolearn; install there what is",
        ),
        (
            "import echolearn; echolearn.__version__ = '0.0.9'",
            "engine: a worker has echolearn 0.0.9 instead of 0.2.0; install there what is installed here",
        ),
    ],
)
def test_a_worker_that_cannot_do_the_same_is_refused(
    running: Path, tmp_path: Path, code: str, said: str
) -> None:
    with worker(running, code):
        arrived(running)
        with pytest.raises(BadValue) as refused:
            generated(SMALL, Dask(scheduler_file=str(running)), tmp_path)
    assert str(refused.value).startswith(said)


def test_a_worker_that_comes_later_is_asked_by_its_jobs() -> None:
    with pytest.raises(
        BadValue, match="^engine: a worker has numpy .* instead of 1.0; install there what is"
    ):
        do_alone(math.sqrt, versions() | {"numpy": "1.0"}, 4.0)


@pytest.mark.filterwarnings("error")
def test_a_scheduler_of_another_version_is_refused(tmp_path: Path) -> None:
    code = "import importlib.metadata as m; v = m.version; m.version = lambda n: '1.0' if n == 'distributed' else v(n)"
    with scheduler(tmp_path / "about", code), pytest.raises(BadValue, match="here, not 1.0$"):
        list(Dask(address=address(tmp_path / "about"))(math.sqrt, [4.0]))


def test_the_loss_of_the_scheduler_is_one_error(tmp_path: Path) -> None:
    about = tmp_path / "about"
    with scheduler(about) as process, worker(about):
        jobs = Dask(address=address(about), timeout=1.0)(time.sleep, [0.0, 60.0])
        assert next(jobs) == 0.0
        process.kill()
        with pytest.raises(
            BadValue,
            match="^engine: the scheduler was lost, or cancelled the jobs; the same command",
        ):
            next(jobs)


def test_a_job_that_kills_its_workers_is_given_up(tmp_path: Path) -> None:
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        pytest.raises(
            BadValue, match="^engine: a job was lost 2 times with its worker, last on tcp://127"
        ) as given,
    ):
        list(Dask(workers=1)(os._exit, [1]))
    assert "\n" not in str(given.value)


def test_a_command_that_was_stopped_leaves_no_process_and_is_continued(
    elsewhere: Path, whole: Callable[[list[str]], dict[str, bytes]]
) -> None:
    """First by the interrupt that a terminal sends to all, then by SIGKILL."""
    words, before = ["generate", *MANY, "engine=dask", "workers=1"], leftovers()
    err, seconds = stopped(
        words, elsewhere, shards=1, stop=lambda pid: os.killpg(pid, signal.SIGINT)
    )
    assert [line for line in err.splitlines() if not line.startswith("generate ")] == [
        "error: interrupted; the same command continues with what is finished"
    ]
    assert seconds < 15
    assert leftovers() == before
    stopped(
        words,
        elsewhere,
        shards=len(list(finished(elsewhere))) + 1,
        stop=lambda pid: os.kill(pid, signal.SIGKILL),
    )
    [made] = elsewhere.glob("runs/data/*")
    times = {
        path: path.stat().st_mtime_ns
        for path in made.glob("*.npy")
        if manifests.sidecar(path).exists()
    }
    assert 1 < len(times) < 23
    assert not (made / manifests.MANIFEST).exists()
    assert main(words) == 0
    assert shards(contents(made)) == shards(whole(MANY))
    assert {path: path.stat().st_mtime_ns for path in times} == times
    assert [path.name for path in elsewhere.iterdir()] == ["runs"]
    for name in leftovers() - before:  # of the one that was killed
        shutil.rmtree(Path(tempfile.gettempdir()) / name)


def finished(where: Path) -> Iterator[Path]:
    """Yield what tells that a shard is finished."""
    return where.glob("runs/data/*/shard-*.json")


def stopped(
    words: list[str], where: Path, *, shards: int, stop: Callable[[int], None]
) -> tuple[str, float]:
    """Stop a command once so many shards stand; return what it said and how long it took all its
    processes to end."""
    with started("-m", "echolearn", *words) as client:
        wait_for(lambda: len(list(finished(where))) >= shards)
        workers, began = children(client.pid), time.monotonic()
        stop(client.pid)
        err = client.communicate(timeout=30)[1]
        assert workers
        wait_for(lambda: not any(map(is_alive, workers)), 20)
    return err, time.monotonic() - began


# ---------------------------------------------------------------- mistakes


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (
            "engine=dask engine.address=tcp://127.0.0.1:9 engine.timeout=0.5",
            "engine.address=tcp://127.0.0.1:9: must be a Dask scheduler that answers within 0.5 s; is it running, and is the",
        ),
        (
            "engine=dask engine.address=node1:8786",
            "engine.address=node1:8786: must be an address, tcp://host:port, as the",
        ),
        (
            "engine=dask engine.address=tcp://node1",
            "engine.address=tcp://node1: must be an address, tcp://host:port",
        ),
        (
            "engine=dask engine.address=8786",
            "engine.address=8786: must be an address, tcp://host:port",
        ),
        (
            "engine=dask engine.scheduler_file=no",
            "engine.scheduler_file=no: must be a file that dask scheduler",
        ),
        (
            "engine=dask engine.scheduler_file=no engine.address=tcp://a:1",
            "engine.address=tcp://a:1: must not be given together with a scheduler_file",
        ),
        ("engine=dask workers=0", "workers=0: must be a whole number from 1 to 1024"),
        (
            "engine=dask engine.timeout=0",
            "engine.timeout=0 s: must be a number from 0.1 to 86400 s",
        ),
    ],
)
def test_a_mistake_is_one_line(words: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["generate", *SMALL, *words.split()]) == 1
    err = capsys.readouterr().err
    assert err.startswith(f"error: {said}")
    assert err.count("\n") == 1
    assert not list(Path().glob("runs/data/*"))


def test_without_dask_it_is_said_how_to_get_it(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert main(["generate", *SMALL, "engine=dask"]) == 1
    assert (
        capsys.readouterr().err
        == "error: engine=dask: needs Dask; pip install 'echolearn[cluster]'\n"
    )
