"""SIGKILL at random moments: nothing is lost, and what is made at last is what would have been.

    python tests/kills.py                 50 kills of every command, about twenty minutes
    python tests/kills.py --times 5 map   fewer, of one

A command is begun again and again in one folder and killed, group and all, until it has been hit
`CHAIN` times; then it is let finish. Lost is what was finished at a kill and is not the same file
later; different is a file that is not, byte for byte, that of a command which was left alone. Files
that differ between two of those (logs with times) are not compared, and are named.
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
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

PLAN = "plan=tiny plan.room.t60=0.25 localizer.azimuths=36 plan.step=1.4 plan.shard_rows=4"
SCENE = "scene.probe.length=6000"
LEFT_OUT = "joint snls"

COMMANDS = {
    "generate": f"generate {PLAN} {SCENE} workers=2",
    "train -m": f"train -m -j 2 {PLAN} {SCENE} classifier=threshold_peak,threshold_score seed=0,1",
    "survey": f"survey name=walk room=8x6x5 snr_db=0 poses=12 {SCENE}",
    "compare": "compare name=all tested=[tiny] surveys=[walk] resamples=50 workers=1 "
    + " ".join(f"localizer@localizers.{name}=null" for name in LEFT_OUT.split()),
    "export": f"export run=runs/train/RUN name=small resamples=50 {SCENE}",
    "map": "map survey=runs/survey/walk bundle=runs/bundles/small",
}
"""What is killed; each needs what those before it have made."""

CHAIN = 5
"""Kills before a command is let finish."""

MANIFESTS = ("manifest.json", "metrics.json", "bundle.json")


@dataclass
class Outcome:
    """What came of the kills of one command.

    Attributes:
        kills: processes that were alive when they were killed.
        rounds: times that the command was let finish, and compared.
        lost, different: names of files.
        uncompared: names of files that differ without a kill, too.
        alone, again: seconds of the command left alone, and after kills.
    """

    kills: int
    rounds: int
    lost: set[str]
    different: set[str]
    uncompared: set[str]
    alone: float
    again: list[float]


def begun(command: str, place: Path) -> subprocess.Popen[bytes]:
    """Start a command in a folder, as the leader of a group of processes."""
    state = {"XDG_STATE_HOME": str(place / "state"), "OMP_NUM_THREADS": "1"}
    words = [sys.executable, "-m", "echolearn", *command.split()]
    return subprocess.Popen(
        words,
        cwd=place,
        env=os.environ | state,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def finish(command: str, place: Path) -> float:
    """Let a command finish, and return its seconds."""
    start = time.monotonic()
    process = begun(command, place)
    _, said = process.communicate(timeout=600)
    assert process.returncode == 0, said.decode()
    return time.monotonic() - start


def contents(place: Path) -> dict[str, str]:
    """Return the SHA-256 of every file of the results, hidden ones among them, by its name.

    But for TensorBoard's, whose names are times.
    """
    paths = sorted(path for path in (place / "runs").rglob("*") if path.is_file())
    files = [path for path in paths if ".tfevents." not in path.name]
    sums = (hashlib.sha256(path.read_bytes()).hexdigest() for path in files)
    return dict(zip((str(path.relative_to(place)) for path in files), sums, strict=True))


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


def torture(command: str, base: Path, *, times: int, chance: random.Random) -> Outcome:
    """Kill a command so many times in copies of a folder, and return what came of it.

    Args:
        command: words after `echolearn`.
        base: folder with what it needs; the command's results are added to it.
        times: number of kills.
        chance: source of the moments.
    """
    with TemporaryDirectory() as scratch:
        twin = Path(shutil.copytree(base, Path(scratch) / "twin"))
        # The first of the two fills caches of compiled loops.
        finish(command, twin)
        before = Path(shutil.copytree(base, Path(scratch) / "before"))
        alone = finish(command, base)
        right, other = contents(base), contents(twin)
        uncompared = {name for name in right | other if right.get(name) != other.get(name)}
        found = Outcome(0, 0, set(), set(), uncompared, alone, [])
        while found.kills < times:
            place = Path(shutil.copytree(before, Path(scratch) / "place"))
            kept: dict[str, int] = {}
            for _ in range(CHAIN):
                found.kills += killed(command, place, chance.uniform(0.2, 1.0) * alone)
                found.lost |= missing(kept, place)
                kept |= finished(place)
                if found.kills == times:
                    break
            found.again.append(finish(command, place))
            found.lost |= missing(kept, place)
            result = contents(place)
            differ = {name for name in right | result if right.get(name) != result.get(name)}
            found.different |= differ - uncompared
            found.rounds += 1
            shutil.rmtree(place)
    return found


def missing(kept: dict[str, int], place: Path) -> set[str]:
    """Return the names of files that are gone, or were written again."""
    return {
        name
        for name, written in kept.items()
        if not (place / name).is_file() or (place / name).stat().st_mtime_ns != written
    }


def tortures(only: Sequence[str], *, times: int, seed: int) -> Iterator[tuple[str, Outcome]]:
    """Yield what comes of each command; those that are not asked for are only run.

    Args:
        only: names of `COMMANDS`.
        times: kills of each.
        seed: of the moments.
    """
    with TemporaryDirectory() as scratch:
        base = Path(scratch)
        (base / "runs").mkdir()
        for name, words in COMMANDS.items():
            runs = sorted(path.name for path in base.glob("runs/train/threshold_peak-*-s0-*"))
            command = words.replace("RUN", runs[0] if runs else "")
            if name in only:
                chance = random.Random(f"{seed} {name}")
                yield name, torture(command, base, times=times, chance=chance)
            else:
                finish(command, base)


def main() -> None:
    """Print a line for each command."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("commands", nargs="*", default=list(COMMANDS), metavar="command")
    parser.add_argument("--times", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print("command   kills  rounds  lost  different  s alone  s after kills")
    failed = False
    for name, found in tortures(given.commands, times=given.times, seed=given.seed):
        again = sorted(found.again)
        print(
            f"{name:10}{found.kills:5}{found.rounds:8}{len(found.lost):6}"
            f"{len(found.different):11}{found.alone:9.1f}  {again[0]:.1f} to {again[-1]:.1f}",
            flush=True,
        )
        for what in ("lost", "different", "uncompared"):
            names = sorted(getattr(found, what))
            if names:
                print(f"  {what}: {', '.join(names[:5])}", flush=True)
        failed = failed or bool(found.lost or found.different)
    sys.exit(failed)


if __name__ == "__main__":
    main()
