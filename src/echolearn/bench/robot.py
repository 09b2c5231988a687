"""On a robot: how long a bundle takes to be ready, per recording and per echo, and its memory.

Each bundle is measured in a process of its own that loads what a robot loads and nothing else
(`onboard.py`): one recording at a time, observation in, accepted points out, with the bundle's
window and either of two localizers.
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from echolearn.bench.measurement import Measurement, Setting, times
from echolearn.bench.responses import HALL
from echolearn.bench.start import BARE, program
from echolearn.runtime.progress import track
from echolearn.runtime.timing import Lap
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.survey import survey
from echolearn.storage.manifests import BUNDLE

POSES = 12
LOCALIZERS = ("joint", "gated")


def robot(setting: Setting) -> Iterator[Measurement]:
    """Measure every bundle that fits the plan's scene; says so if there are none."""
    bundles = sorted(path.parent for path in (setting.runs / "bundles").glob(f"*/{BUNDLE}"))
    if not bundles:
        print(f"bench robot: no bundles under {setting.runs / 'bundles'}", file=sys.stderr)
        return
    load = f"from echolearn.robot.scorer import load; load({str(bundles[0])!r})"
    # What a robot waits for at power-up: imports, proofs and the golden inputs.
    programs = {"ready": program("-c", load), BARE: program("-c", "pass")}
    yield from setting.compare("robot", programs)
    scene = setting.plan.scene
    levels = NoiseLevels(0.0, sdnr_db=None if scene.diffuse is None else 0.0)
    walk = survey(
        name="walk", room=HALL, scene=scene, levels=levels, poses=POSES, runs=setting.place
    )
    for folder in track(bundles, "bench robot", unit="bundles"):
        yield from onboard(folder, walk)


def onboard(folder: Path, walk: Path) -> Iterator[Measurement]:
    """Measure one bundle on a walk; one for another robot is left out, with a line about it."""
    words = ["-m", "echolearn.bench.onboard", str(folder), str(walk), *LOCALIZERS]
    # A process of its own: memory is a high-water mark, which a second bundle would inherit.
    done = subprocess.run([sys.executable, *words], capture_output=True, text=True)
    name = folder.name
    if done.returncode:
        said = " ".join(done.stderr.strip().splitlines()[-1:])
        print(f"bench robot: {name} is left out; {said}", file=sys.stderr)
        return
    found = json.loads(done.stdout)
    for who, laps in found["laps"].items():
        yield from times("robot", {f"{name}, {who}": [Lap(*lap) for lap in laps]}, group=name)
    yield Measurement("robot", name, "", "", "memory", "B", [found["memory"]], group=name)
