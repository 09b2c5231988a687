"""Every kind of bundle on the oldest onnxruntime that there is for Python 3.11."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import world as small
from echolearn.training.export import export
from world import CLASSIFIERS

ROOT = Path(__file__).parents[2]
OLDEST = "1.15.0"
"""The first for Python 3.11."""

pytestmark = [
    pytest.mark.release,
    pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="newer ones have newer wheels"),
]

NETWORKS = {
    "mlp": {"inputs": ["toa", "power"], "net": {"_target_": "Mlp", "widths": [8]}},
    "covnet": {"inputs": ["covariance"], "net": {"_target_": "CovarianceNet", "channels": 4}},
}


@pytest.fixture(scope="module")
def python(tmp_path_factory):
    """Return the interpreter of an environment with that onnxruntime and numpy, nothing else."""
    place = tmp_path_factory.mktemp("oldest")
    subprocess.run([sys.executable, "-m", "venv", place], check=True)
    found = place / "bin" / "python"
    wanted = [f"onnxruntime=={OLDEST}", "numpy<2"]
    subprocess.run([found, "-m", "pip", "install", "--quiet", *wanted], check=True)
    return found


@pytest.mark.parametrize("name", [*CLASSIFIERS, *NETWORKS])
def test_the_oldest_runtime_gives_the_golden_confidences(
    name, world, tmp_path, python, monkeypatch
):
    runs = world.runs
    if name in NETWORKS:
        keys = {"_target_": "echolearn.classifiers.methods.network.Network", "epochs": 3}
        keys |= NETWORKS[name]
        keys["net"] = keys["net"] | {
            "_target_": f"echolearn.classifiers.architectures.{keys['net']['_target_']}"
        }
        monkeypatch.setitem(CLASSIFIERS, name, keys)
        runs = tmp_path
        (runs / "data").symlink_to(world.runs / "data")
        small.train(world.sets["scattered"], name, seed=0, runs=runs)
    [run] = (runs / "train").glob(f"{name}-scattered-s0-*")
    scene = small.plans()[0].scene
    given = {"array": scene.array, "probe": scene.probe, "resamples": 30}
    folder = export(run=run, best=None, runs=tmp_path, **given)
    words = [python, ROOT / "examples" / "read_bundle.py", folder]
    said = subprocess.run(words, check=True, capture_output=True, text=True).stdout
    difference = said.partition("largest difference from the golden confidences: ")[2].split()[0]
    assert float(difference) <= 1e-5 and np.isfinite(float(difference))
