"""What a bundle needs on a robot: no more memory for a longer walk, and times of every localizer."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.survey import survey
from echolearn.simulation.walk import trajectory
from echolearn.survey import reader
from echolearn.survey.poses import poses_csv
from world import HALL, plans


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a short survey; not to be changed but for its table of poses."""
    scene = plans()[0].scene
    return survey(
        name="walk",
        room=HALL,
        scene=scene,
        levels=NoiseLevels(0.0),
        poses=2,
        runs=tmp_path_factory.mktemp("onboard"),
    )


def measured(bundle: Path, walk: Path, *, poses: int) -> dict[str, object]:
    """Return what a process says that has taken a walk of so many poses, all with the same
    recording."""
    names = ["observations/0000.wav"] * poses
    (walk / "poses.csv").write_bytes(poses_csv(trajectory(HALL, poses=poses), names))
    code = (
        "import sys, json; from pathlib import Path; from echolearn.bench.onboard import measure; "
    )
    code += "print(json.dumps(measure(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:], laps=1)))"
    words = [sys.executable, "-c", code, str(bundle), str(walk), "gated", "snls"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(words, capture_output=True, text=True, check=True, env=environment)
    found: dict[str, object] = json.loads(done.stdout)
    return found


def test_memory_does_not_grow_with_the_walk(packed: Path, walk: Path) -> None:
    """The recordings of the longer one together take some sixty megabytes."""
    together = 200 * reader.read_survey(walk).observe([0]).samples.nbytes
    short, long = (measured(packed, walk, poses=poses) for poses in (4, 204))
    assert set(short) == {"laps", "memory"}
    assert set(short["laps"]) == {"gated", "snls", "classifier"}  # type: ignore[call-overload]
    assert together > 40e6
    assert abs(long["memory"] - short["memory"]) < together / 5  # type: ignore[operator]
