"""What a bundle needs on a robot: no more memory for a longer walk, times of every localizer."""

import json
import os
import subprocess
import sys

from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.survey import survey
from echolearn.simulation.walk import trajectory
from echolearn.survey import reader
from echolearn.survey.poses import poses_csv
from world import HALL, plans

ONCE = """
import json, sys
from pathlib import Path
from echolearn.bench.onboard import measure
print(json.dumps(measure(*map(Path, sys.argv[1:]), localizers=["gated"], laps=1)))
"""
"""One lap, as memory is measured before the first."""


def test_memory_does_not_grow_with_the_walk(packed, tmp_path):
    """The recordings of the longer one together take some seventeen megabytes."""
    scene = plans()[0].scene
    about = {"name": "walk", "poses": 2, "runs": tmp_path}
    walk = survey(room=HALL, scene=scene, levels=NoiseLevels(0.0), **about)
    together = 60 * reader.read_survey(walk).observe([0]).samples.nbytes
    assert together > 16e6

    def measured(poses):
        """Return what a process says that has taken a walk, at each pose the same recording."""
        names = [f"observations/{pose:04d}.wav" for pose in range(poses)]
        for name in names:
            if not (walk / name).exists():
                (walk / name).hardlink_to(walk / names[0])
        (walk / "poses.csv").write_bytes(poses_csv(trajectory(HALL, poses=poses), names))
        words = ["-c", ONCE, str(packed), str(walk)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        done = subprocess.run(
            [sys.executable, *words], capture_output=True, text=True, check=True, env=environment
        )
        return json.loads(done.stdout)

    short, long = measured(4), measured(64)
    assert {*short["laps"]} == {"gated", "classifier"}
    assert abs(long["memory"] - short["memory"]) < together / 5


def test_it_needs_a_robots_libraries_alone():
    heavy = "torch sklearn hydra lightning matplotlib numba onnx"
    code = f"import sys, echolearn.bench.onboard; print({{*'{heavy}'.split()}} & {{*sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "set()\n"
