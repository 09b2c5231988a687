"""Hundreds of bundles and surveys as an enemy would send them, each given to a process of its own.

    python tests/robot/hostile.py                all, one side by side for each core
    python tests/robot/hostile.py --workers 16   as many side by side as that: a few minutes
    python tests/robot/hostile.py --each kernel yaml
                    those alone whose name holds one of the words, with what each cost and was told

Run it from a clone with the package's dependencies installed; nothing else is needed, no network,
no `make`. The code is that of the clone. Everything happens in a temporary folder (`TMPDIR`), and
the status is 1 if anything was not refused as it should be.

`echolearn map` is called as by a user who has received both. Refused means: status 1, one line that
begins with "error: " and can be printed, nothing written below `runs`. The cost is what `wait4`
tells of the process and its children: computing time in s, most memory of one of them in MiB.
"""

import argparse
import os
import resource
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shutil import copytree, rmtree
from tempfile import TemporaryDirectory

TESTS = Path(__file__).parents[1]
if str(TESTS) not in sys.path:
    sys.path.insert(0, str(TESTS))

from bundle_mutants import BUNDLES, LATER  # noqa: E402
from survey_mutants import SURVEYS  # noqa: E402

SECONDS = 5.0
MEMORY = 1 << 30
"""What none may cost: computing time in s, bytes."""

PATIENCE = 120.0
"""Seconds after which a process is killed, which is no refusal."""

LIMITS = {resource.RLIMIT_CPU: 60, resource.RLIMIT_AS: 16 << 30}
"""What the machine is kept from: computing time in s, bytes of addresses."""

EXAMINED = "from elsewhere; examined in"

SOURCE = TESTS.parent / "src"
PATHS = [str(SOURCE), str(TESTS), *map(os.path.abspath, filter(None, sys.path))]
CODE = {"PYTHONPATH": os.pathsep.join(PATHS), "OMP_NUM_THREADS": "1"}
"""Variables by which a process in any folder finds the code of this clone."""


@dataclass(frozen=True)
class Refusal:
    """What came of a hostile bundle or survey.

    Attributes:
        kind, name: which it was.
        seconds: computing time.
        memory: bytes, at most.
        status: of the command.
        said: on stderr.
        written: files that it left below `runs`.
    """

    kind: str
    name: str
    seconds: float
    memory: int
    status: int
    said: str
    written: tuple[str, ...]

    @property
    def group(self) -> str:
        """Which file an enemy has changed, as the table tells it."""
        first = self.name.partition(" ")[0]
        return f"{self.kind}: {first if first in GROUPS else 'other'}"

    @property
    def fault(self) -> str:
        """What is wrong with it, or nothing."""
        lines = self.said.rstrip("\n").split("\n")
        # One that is refused only later has passed its examination, which is said.
        line = lines[-1] if all(EXAMINED in each for each in lines[:-1]) else self.said
        refused = self.status == 1 and line.startswith("error: ") and line.isprintable()
        faults = {
            "not refused in one line": not refused or len(line) > 1000,
            "files were written": bool(self.written),
            f"over {SECONDS:g} s": self.seconds > SECONDS,
            f"over {MEMORY >> 20} MiB": self.memory > MEMORY,
        }
        return ", ".join(name for name, is_one in faults.items() if is_one)


MUTATIONS = {("bundle", name): mutate for name, (mutate, _) in BUNDLES.items()}
MUTATIONS |= {("bundle", name): mutate for name, mutate in LATER.items()}
MUTATIONS |= {("survey", name): mutate for name, (mutate, _) in SURVEYS.items()}
"""What an enemy does, by the kind of a folder and a name."""

GROUPS = ("model", "golden", "reference", "manifest", "entry", "observations/0001.wav", "poses.csv")
"""First words of names by which the table counts."""


def given(kind: str, name: str, *, bundle: Path, survey: Path, place: Path) -> Refusal:
    """Map what an enemy has made of a bundle or a survey.

    Args:
        kind: "bundle" or "survey".
        name: of the mutation.
        bundle, survey: sound ones, which are copied.
        place: empty folder for the copies.
    """
    sound = {"bundle": bundle, "survey": survey}
    inputs = sound | {kind: Path(copytree(sound[kind], place / "given" / kind))}
    mutate = MUTATIONS[kind, name]
    mutate(inputs[kind])
    return mapped(kind, name, inputs=inputs, place=place)


def mapped(kind: str, name: str, *, inputs: Mapping[str, Path], place: Path) -> Refusal:
    """Map a survey with a bundle in a process of its own, as a user would.

    Args:
        kind, name: what it is called in the table.
        inputs: the two folders.
        place: folder for the results.
    """
    words = [f"{key}={path}" for key, path in inputs.items()]
    command = [sys.executable, "-m", "echolearn", "map", *words, f"runs={place / 'runs'}"]
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        cwd=place,
        env=os.environ | CODE,
        text=True,
        errors="backslashreplace",
    )
    for what, most in LIMITS.items():
        resource.prlimit(process.pid, what, (most, most))
    late = threading.Timer(PATIENCE, process.kill)
    late.start()
    assert process.stderr is not None
    said = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    late.cancel()
    process.returncode = os.waitstatus_to_exitcode(status)
    written = tuple(str(path) for path in (place / "runs").rglob("*") if path.is_file())
    seconds = usage.ru_utime + usage.ru_stime
    return Refusal(kind, name, seconds, usage.ru_maxrss << 10, process.returncode, said, written)


def refusals(
    bundle: Path, survey: Path, *, words: Sequence[str], workers: int
) -> Iterator[Refusal]:
    """Yield what comes of every hostile bundle and survey that is wanted.

    Args:
        bundle, survey: sound ones that fit each other.
        words: those are wanted whose name holds one of them; all, if there are none.
        workers: processes side by side.
    """
    wanted = [key for key in MUTATIONS if not words or any(word in key[1] for word in words)]
    with ThreadPoolExecutor(workers) as pool:
        yield from pool.map(partial(_refusal, bundle, survey), wanted)


def _refusal(bundle: Path, survey: Path, wanted: tuple[str, str]) -> Refusal:
    """Return what comes of one, whose files are gone afterwards."""
    kind, name = wanted
    with TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        place = Path(scratch)
        found = given(kind, name, bundle=bundle, survey=survey, place=place)
        rmtree(place / "given", ignore_errors=True)
    return found


PREPARE = """
import sys, world
from pathlib import Path
place = Path(sys.argv[1])
made = world.make(place / "world")
world.pack(made, "trees_features", place / "packed")
"""
"""Run by another process, since Linux counts the memory of whoever starts one as that one's own."""


def main() -> None:
    """Print a table by kind, and each that was not refused as it should be."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("words", nargs="*", help="only those whose name holds one of them")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="side by side")
    parser.add_argument("--each", action="store_true", help="print a line for each")
    options = parser.parse_args()
    found = []
    with TemporaryDirectory(ignore_cleanup_errors=True) as scratch:
        os.environ["XDG_STATE_HOME"] = f"{scratch}/state"
        prepare = [sys.executable, "-c", PREPARE, scratch]
        made = subprocess.run(prepare, capture_output=True, text=True, env=os.environ | CODE)
        if made.returncode:
            sys.exit(f"no world to begin with: {made.stderr}")
        bundle = Path(scratch) / "packed" / "bundles" / "small"
        survey = Path(scratch) / "world" / "survey" / "hall_0dB"
        # What refuses everything would refuse all of them.
        inputs = {"bundle": bundle, "survey": survey}
        sound = mapped("both", "sound", inputs=inputs, place=Path(scratch))
        if sound.status:
            sys.exit(f"a sound bundle and survey are refused: {sound.said}")
        chosen = refusals(bundle, survey, words=options.words, workers=options.workers)
        for each in chosen:
            found.append(each)
            if options.each or each.fault:
                print(line(each), flush=True)
    print(table(found))
    sys.exit(any(each.fault for each in found) or not found)


def line(each: Refusal) -> str:
    """Return what there is to say of one: its cost, and its fault or how it was refused."""
    said = each.said.strip().rpartition("given/")[2]
    if each.fault:
        said = f"{each.fault.upper()}: status {each.status}, {each.said.strip()[-300:]!a}"
    cost = f"{each.seconds:5.1f} s {each.memory >> 20:5} MiB"
    return f"{each.kind} {each.name:42} {cost}  {said if each.fault else said[:90]}"


def table(found: Sequence[Refusal]) -> str:
    """Return a line for each kind: how many, how many refused, the most that one has cost."""
    groups = defaultdict(list)
    for each in found:
        groups[each.group].append(each)
    lines = [f"{'kind':30} {'count':>6} {'refused':>8} {'most s':>7} {'most MiB':>9}"]
    for group, members in [*groups.items(), ("all", list(found))]:
        refused = sum(not each.fault for each in members)
        seconds = max((each.seconds for each in members), default=0.0)
        memory = max((each.memory for each in members), default=0) >> 20
        lines.append(f"{group:30} {len(members):6} {refused:8} {seconds:7.1f} {memory:9}")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
