"""On a robot: how long a bundle takes to be ready, per recording and per echo, and how much memory
it needs.

Each bundle is measured in a process of its own that loads what a robot loads and nothing else
(`onboard.py`): one recording at a time, observation in, accepted points out, with the bundle's
window and either of two localizers.
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from echolearn.bench.measurement import Measurement, Setting, times
from echolearn.bench.responses import HALL
from echolearn.runtime.progress import track
from echolearn.runtime.timing import Contestant, Lap
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.survey import survey
from echolearn.storage.manifests import BUNDLE

STAGE = "robot"
POSES = 12
READY, BARE = "ready", "python -c pass"
LOCALIZERS = ("joint", "gated")


def robot(setting: Setting) -> Iterator[Measurement]:
    """Measure every bundle that fits the plan's scene; says so if there are none."""
    bundles = sorted(path.parent for path in (setting.runs / "bundles").glob(f"*/{BUNDLE}"))
    if not bundles:
        print(f"bench: no bundles under {setting.runs / 'bundles'}", file=sys.stderr, flush=True)
        return
    yield from starting(setting, bundles[0])
    scene = setting.plan.scene
    levels = NoiseLevels(0.0, sdnr_db=None if scene.diffuse is None else 0.0)
    walk = survey(
        name="walk",
        room=HALL,
        scene=scene,
        poses=POSES,
        runs=setting.place,
        levels=levels,
    )
    for folder in track(bundles, "bench robot", unit="bundles"):
        yield from onboard(folder, walk)


def starting(setting: Setting, folder: Path) -> Iterator[Measurement]:
    """Time a process that loads a bundle, beside Python's own start."""
    code = f"from echolearn.robot.scorer import load; load({str(folder)!r})"
    work = partial(subprocess.run, check=True, stdout=subprocess.DEVNULL)
    lines = {READY: code, BARE: "pass"}
    laps = setting.race(
        {
            name: Contestant(partial(work, [sys.executable, "-c", line]))
            for name, line in lines.items()
        }
    )
    yield from times(STAGE, laps, reference=READY)


def onboard(folder: Path, walk: Path) -> Iterator[Measurement]:
    """Measure one bundle on a walk; one that was made for another robot is left out, with a word
    about it.
    """
    words = [
        sys.executable,
        "-m",
        "echolearn.bench.onboard",
        str(folder),
        str(walk),
        *LOCALIZERS,
    ]
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode:
        said = done.stderr.strip().splitlines()[-1:]
        print(
            f"bench robot: {folder.name} is left out; {' '.join(said)}", file=sys.stderr, flush=True
        )
        return
    found, group = json.loads(done.stdout), folder.name
    for name, taken in found["laps"].items():
        laps = {f"{group}, {name}": [Lap(*lap) for lap in taken]}
        yield from times(STAGE, laps, group=group)
    yield Measurement(STAGE, group, "", "", "memory", "B", [found["memory"]], group=group)
