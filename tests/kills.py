"""SIGKILL at random moments: nothing is lost, and what is made at last is what would have been.

    python tests/kills.py                            50 kills of every command, one side by side
                                                     for each core
    python tests/kills.py --times 50 --workers 16    the same on 16 cores: a few minutes
    python tests/kills.py --times 5 map study        fewer, of two

Run it from a clone with the package's dependencies installed; nothing else is needed, no network,
no `make`. The code is that of the clone. Everything happens in a temporary folder (`TMPDIR`), and
the status is 1 if anything was lost or different.

A command is begun again and again in one folder and killed, group and all, until it has been hit
`CHAIN` times; then it is let finish. Lost is what was finished at a kill and is not the same file
later; different is a file that is not, byte for byte, that of a command which was left alone, or
that only one of them has: a temporary, too. Files that differ between two commands which were left
alone (logs with times) are not compared, and are named. `s alone` is measured with nothing beside
it, `s again` (median, most) after kills and with as many chains beside it as there are workers.
"""

import argparse
import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

PLAN = "plan=tiny plan.room.t60=0.25 localizer.azimuths=36 plan.step=1.4 plan.shard_rows=4"
SCENE = "scene.probe.length=6000"
LEFT_OUT = " ".join(f"localizer@localizers.{name}=null" for name in ("joint", "snls"))
STUDIED = " ".join(
    f"localizer@localizers.{name}=null"
    for name in ("joint", "em", "mclam", "peaks", "peaks_regularised")
)

COMMANDS = {
    "generate": f"generate {PLAN} {SCENE} workers=2",
    "train -m": f"train -m -j 2 {PLAN} {SCENE} classifier=threshold_peak,threshold_score seed=0,1",
    "survey": f"survey name=walk room=8x6x5 snr_db=20 poses=12 {SCENE}",
    "import": f"import snr_db=0 {SCENE}",
    "compare": "compare name=all tested=[tiny] surveys=[walk] resamples=50 workers=1 "
    f"readme=README.md {LEFT_OUT}",
    "export": f"export run=runs/train/RUN name=small resamples=50 {SCENE}",
    "map": "map survey=runs/survey/walk bundle=runs/bundles/small",
    "check": "check survey=runs/survey/walk bundle=runs/bundles/small",
    "study": "study name=small values=[-10,0,10] positions=2 trials=2 resamples=50 workers=2 "
    f"page=docs/page.md {SCENE} {STUDIED}",
}
"""What is killed; each needs what those before it have made."""

PAGES = {
    "README.md": "<!-- results: written by `echolearn compare` -->\n<!-- end of results -->\n",
    "docs/page.md": "<!-- study small: written by `echolearn study` -->\n"
    "<!-- end of study small -->\n",
}
"""Pages of people's own, into which `compare` and `study` write."""

CHAIN = 5
"""Kills before a command is let finish."""

PATIENCE = 900
"""Seconds after which a command hangs."""

SOURCE = Path(__file__).parents[1] / "src"
MANIFESTS = ("manifest.json", "metrics.json", "bundle.json")
STATE = "state"


@dataclass(frozen=True)
class Torture:
    """A command, and what it makes if it is left alone.

    Attributes:
        command: words after `echolearn`.
        before: folder with what it needs.
        right: SHA-256 of every file that is there afterwards.
        uncompared: names of files that differ without a kill, too.
        alone: seconds that it takes.
        again: seconds of those that were let finish after kills, by all chains.
    """

    command: str
    before: Path
    right: dict[str, str]
    uncompared: set[str]
    alone: float
    again: list[float] = field(default_factory=list)

    def moment(self, chance: random.Random) -> float:
        """Return after how many seconds to kill it: with so many beside it, it may be slower."""
        return chance.uniform(0.2, 1.0) * max([self.alone, median(self.again or [0.0])])


@dataclass
class Outcome:
    """What came of kills of one command.

    Attributes:
        kills: processes that were alive when they were killed.
        lost, different: names of files.
        failed: what commands said that did not finish after kills.
    """

    kills: int = 0
    lost: set[str] = field(default_factory=set)
    different: set[str] = field(default_factory=set)
    failed: list[str] = field(default_factory=list)

    @property
    def is_sound(self) -> bool:
        """Whether nothing was lost, and nothing came out differently."""
        return not (self.lost or self.different or self.failed)

    def add(self, other: "Outcome") -> None:
        """Add what came of another chain."""
        self.kills += other.kills
        self.lost |= other.lost
        self.different |= other.different
        self.failed += other.failed


def begun(command: str, place: Path) -> subprocess.Popen[bytes]:
    """Start a command in a folder, as the leader of a group of processes."""
    paths = [str(SOURCE), *map(os.path.abspath, filter(None, sys.path))]
    changes = {
        "PYTHONPATH": os.pathsep.join(paths),
        "XDG_STATE_HOME": str(place / STATE),
        "OMP_NUM_THREADS": "1",
    }
    return subprocess.Popen(
        [sys.executable, "-m", "echolearn", *command.split()],
        cwd=place,
        env=os.environ | changes,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def finish(command: str, place: Path) -> float:
    """Let a command finish, and return its seconds.

    Raises:
        RuntimeError: it fails, or hangs.
    """
    start = time.monotonic()
    process = begun(command, place)
    try:
        _, said = process.communicate(timeout=PATIENCE)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        raise RuntimeError(f"{command}: not finished within {PATIENCE} s") from None
    if process.returncode:
        last = said.decode(errors="replace").strip().rpartition("\n")[2]
        raise RuntimeError(f"{command}: status {process.returncode}, {last}")
    return time.monotonic() - start


def killed(command: str, place: Path, seconds: float) -> bool:
    """Start a command, kill it after some seconds, and tell whether it was still running."""
    process = begun(command, place)
    try:
        process.wait(timeout=seconds)
        alive = False
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        alive = True
    process.communicate()
    return alive


def contents(place: Path) -> dict[str, str]:
    """Return the SHA-256 of every file but the user's state, hidden ones among them, by its name.

    But for TensorBoard's, whose names are times.
    """
    found = {}
    for path in sorted(place.rglob("*")):
        name = path.relative_to(place)
        if path.is_file() and name.parts[0] != STATE and ".tfevents." not in path.name:
            found[str(name)] = hashlib.sha256(path.read_bytes()).hexdigest()
    return found


def differing(first: dict[str, str], second: dict[str, str]) -> set[str]:
    """Return the names of files that are not the same in both, or not in both."""
    return {name for name in first | second if first.get(name) != second.get(name)}


def finished(place: Path) -> dict[str, int]:
    """Return when every file was written that must not be made again, by its name."""
    paths = [path for path in (place / "runs").rglob("*") if path.name in MANIFESTS]
    inside = [file for path in paths for file in path.parent.rglob("*") if file.is_file()]
    # Shards count from the moment when their checksum stands beside them.
    shards = [path.with_suffix(".npy") for path in (place / "runs").rglob("shard-*.json")]
    found = {}
    for path in {*inside, *shards}:
        if not path.name.startswith(".") and path.suffix != ".json" or path.name in MANIFESTS:
            found[str(path.relative_to(place))] = path.stat().st_mtime_ns
    return found


def missing(kept: dict[str, int], place: Path) -> set[str]:
    """Return the names of files that are gone, or were written again."""
    return {
        name
        for name, written in kept.items()
        if not (place / name).is_file() or (place / name).stat().st_mtime_ns != written
    }


def prepared(only: Sequence[str], scratch: Path) -> dict[str, Torture]:
    """Run every command twice in worlds that grow, and return what those wanted need and make.

    Args:
        only: names of `COMMANDS`.
        scratch: empty folder for the worlds.
    """
    # The first world fills caches of compiled loops, the second one is timed.
    twin, base = scratch / "twin", scratch / "base"
    for world in (twin, base):
        (world / "runs").mkdir(parents=True)
        for name, text in PAGES.items():
            (world / name).parent.mkdir(exist_ok=True)
            (world / name).write_text(text)
    found = {}
    last = max(map(list(COMMANDS).index, only))
    for name, words in list(COMMANDS.items())[: last + 1]:
        runs = sorted(path.name for path in base.glob("runs/train/threshold_peak-*-s0-*"))
        command = words.replace("RUN", runs[0] if runs else "")
        before = scratch / f"before {name}"
        if name in only:
            shutil.copytree(base, before)
        finish(command, twin)
        alone = finish(command, base)
        if name in only:
            right = contents(base)
            uncompared = differing(right, contents(twin))
            found[name] = Torture(command, before, right, uncompared, alone)
    return found


def tortured(torture: Torture, *, times: int, seed: str, scratch: Path) -> Outcome:
    """Kill a command so many times in copies of its world, and return what came of it.

    Args:
        torture: the command.
        times: number of kills.
        seed: of the moments.
        scratch: folder for the copies.
    """
    chance = random.Random(seed)
    found = Outcome()
    while found.kills < times and not found.failed:
        with TemporaryDirectory(dir=scratch) as folder:
            place = Path(shutil.copytree(torture.before, Path(folder) / "place"))
            kept: dict[str, int] = {}
            for _ in range(min(CHAIN, times - found.kills)):
                found.kills += killed(torture.command, place, torture.moment(chance))
                found.lost |= missing(kept, place)
                kept |= finished(place)
            try:
                torture.again.append(finish(torture.command, place))
            except RuntimeError as error:
                found.failed.append(str(error))
            found.lost |= missing(kept, place)
            found.different |= differing(torture.right, contents(place)) - torture.uncompared
    return found


def tortures(
    only: Sequence[str], *, times: int, seed: int, workers: int
) -> Iterator[tuple[str, Torture, Outcome]]:
    """Yield what comes of each command; those that are not asked for are only run.

    Args:
        only: names of `COMMANDS`.
        times: kills of each.
        seed: of the moments.
        workers: chains of kills that go on side by side.
    """
    with TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        scratch = Path(folder)
        wanted = prepared(only, scratch)
        with ThreadPoolExecutor(workers) as pool:
            chains = {
                name: [
                    pool.submit(
                        tortured,
                        torture,
                        times=min(CHAIN, times - begin),
                        seed=f"{seed} {name} {begin}",
                        scratch=scratch,
                    )
                    for begin in range(0, times, CHAIN)
                ]
                for name, torture in wanted.items()
            }
            for name, torture in wanted.items():
                found = Outcome()
                for chain in chains[name]:
                    found.add(chain.result())
                yield name, torture, found


def main() -> None:
    """Print a line for each command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("commands", nargs="*", default=list(COMMANDS), metavar="command")
    parser.add_argument("--times", type=int, default=50, help="kills of each command")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="chains side by side")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    if unknown := sorted({*given.commands} - {*COMMANDS}):
        parser.error(f"{', '.join(unknown)}: must be some of {', '.join(COMMANDS)}")
    print("command   kills  lost  different  failed  s alone  s again (median, most)", flush=True)
    began = time.monotonic()
    sound = True
    named: set[str] = set()
    options = {"times": given.times, "seed": given.seed, "workers": given.workers}
    for name, torture, found in tortures(given.commands, **options):
        again = torture.again or [float("nan")]
        print(
            f"{name:10}{found.kills:5}{len(found.lost):6}{len(found.different):11}"
            f"{len(found.failed):8}{torture.alone:9.1f}  {median(again):.1f}, {max(again):.1f}",
            flush=True,
        )
        told = {"lost": found.lost, "different": found.different, "failed": found.failed}
        for what, names in (told | {"uncompared": torture.uncompared - named}).items():
            if names:
                print(f"  {what}: {', '.join(sorted(names)[:5])}", flush=True)
        named |= torture.uncompared
        sound = sound and found.is_sound
    print(f"{time.monotonic() - began:.0f} s, {given.workers} side by side", flush=True)
    sys.exit(not sound)


if __name__ == "__main__":
    main()
