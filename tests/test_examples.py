"""Examples do what they say, on a real bundle."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from echolearn import deploy

EXAMPLE = Path(__file__).parents[1] / "examples" / "read_bundle.py"


def read(bundle: Path) -> subprocess.CompletedProcess[str]:
    """Run the example where echolearn cannot be imported."""
    code = "import runpy, sys; sys.modules['echolearn'] = None; runpy.run_path(sys.argv.pop(1), run_name='__main__')"
    return subprocess.run([sys.executable, "-c", code, EXAMPLE, bundle], capture_output=True, text=True)


def test_a_bundle_is_read_by_its_documented_format_alone(packed: Path) -> None:
    done = read(packed)
    assert done.returncode == 0, done.stderr
    [difference] = re.findall(r"golden confidences: (\S+)", done.stdout)
    assert float(difference) <= 1e-5
    scorer = deploy.load(packed)
    kept = int(np.sum(scorer(scorer.bundle.golden[0]) >= scorer.bundle.threshold))
    assert f"of 32 golden inputs {kept} are kept" in done.stdout


def test_damage_is_named(packed: Path, tmp_path: Path) -> None:
    for name in ("bundle.json", "model.onnx"):
        folder = shutil.copytree(packed, tmp_path / name)
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data.replace(b"trees", b"birch", 1) if name.endswith("json") else data[:-1] + b"!")
        done = read(folder)
        assert done.returncode != 0 and f"{name}: damaged" in done.stderr
