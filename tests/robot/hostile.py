"""Two hundred bundles and surveys as an enemy would send them, each given to a process of its own.

    python tests/robot/hostile.py             a line for each: what it cost, and how it was refused
    python tests/robot/hostile.py kernel yaml    those alone whose name holds one of the words

`echolearn map` is called as by a user who has received both. Refused means: status 1, one line that
begins with "error: " and can be printed, nothing written below `runs`. The cost is what `wait4`
tells of the process and its children: computing time in s, most memory of one of them in MiB.
"""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copytree, rmtree
from tempfile import TemporaryDirectory

TESTS = Path(__file__).parents[1]
if str(TESTS) not in sys.path:
    sys.path.insert(0, str(TESTS))

from bundle_mutants import BUNDLES  # noqa: E402
from survey_mutants import SURVEYS  # noqa: E402

SECONDS = 5.0
MEMORY = 1 << 30
"""What none may cost: computing time in s, bytes."""


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
    def fault(self) -> str:
        """What is wrong with it, or nothing."""
        line = self.said.rstrip("\n")
        refused = self.status == 1 and line.startswith("error: ") and line.isprintable()
        faults = {
            "not refused in one line": not refused or len(line) > 1000,
            "files were written": bool(self.written),
            f"over {SECONDS:g} s": self.seconds > SECONDS,
            f"over {MEMORY >> 20} MiB": self.memory > MEMORY,
        }
        return ", ".join(name for name, is_one in faults.items() if is_one)


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
    mutate = (BUNDLES if kind == "bundle" else SURVEYS)[name][0]
    mutate(inputs[kind])
    words = [f"{key}={path}" for key, path in inputs.items()]
    command = [sys.executable, "-m", "echolearn", "map", *words, f"runs={place / 'runs'}"]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, cwd=place, text=True
    )
    assert process.stderr is not None
    said = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    written = tuple(str(path) for path in (place / "runs").rglob("*") if path.is_file())
    seconds = usage.ru_utime + usage.ru_stime
    return Refusal(kind, name, seconds, usage.ru_maxrss << 10, process.returncode, said, written)


def refusals(bundle: Path, survey: Path, *, wanted: Callable[[str], bool]) -> Iterator[Refusal]:
    """Yield what comes of every hostile bundle and survey whose name is wanted.

    Args:
        bundle, survey: sound ones that fit each other.
        wanted: tells by the name.
    """
    mutations = [("bundle", name) for name in BUNDLES] + [("survey", name) for name in SURVEYS]
    for kind, name in mutations:
        if wanted(name):
            with TemporaryDirectory() as scratch:
                place = Path(scratch)
                yield given(kind, name, bundle=bundle, survey=survey, place=place)
                rmtree(place / "given", ignore_errors=True)


PREPARE = """
import sys, world
from pathlib import Path
place = Path(sys.argv[1])
made = world.make(place / "world")
world.pack(made, "trees_features", place / "packed")
"""
"""Run by another process, since Linux counts the memory of whoever starts one as that one's own."""


def main() -> None:
    """Print a line for each, and the most that one has cost."""
    words = sys.argv[1:]
    with TemporaryDirectory() as scratch:
        os.environ["XDG_STATE_HOME"] = f"{scratch}/state"
        paths = os.pathsep.join([str(TESTS), *filter(None, sys.path)])
        prepare = [sys.executable, "-c", PREPARE, scratch]
        subprocess.run(
            prepare, check=True, capture_output=True, env=os.environ | {"PYTHONPATH": paths}
        )
        bundle = Path(scratch) / "packed" / "bundles" / "small"
        survey = Path(scratch) / "world" / "survey" / "hall_0dB"
        found = []
        chosen = refusals(bundle, survey, wanted=lambda name: not words or name_has(name, words))
        for each in chosen:
            found.append(each)
            line = each.said.strip().rpartition("given/")[2]
            cost = f"{each.seconds:5.1f} s {each.memory >> 20:5} MiB"
            print(f"{each.kind} {each.name:42} {cost}  {each.fault or line:.90}", flush=True)
    faults = [each for each in found if each.fault]
    slowest = max(each.seconds for each in found)
    largest = max(each.memory for each in found) >> 20
    print(f"{len(found)} given, {len(faults)} not refused as they should be;", end=" ")
    print(f"at most {slowest:.1f} s and {largest} MiB")
    sys.exit(bool(faults))


def name_has(name: str, words: Sequence[str]) -> bool:
    """Tell whether a name holds one of some words."""
    return any(word in name for word in words)


if __name__ == "__main__":
    main()
