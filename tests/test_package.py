"""The wheel: it carries the configurations and works elsewhere, without the repository."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import echolearn

ROOT = Path(__file__).parents[1]


@pytest.mark.release
def test_the_wheel_carries_the_configurations_and_works_elsewhere(tmp_path: Path) -> None:
    build = [
        sys.executable,
        "-m",
        "build",
        "--wheel",
        "--no-isolation",
        "--outdir",
        str(tmp_path),
        str(ROOT),
    ]
    subprocess.run(build, check=True, capture_output=True)
    [wheel] = tmp_path.glob(f"echolearn-{echolearn.__version__}-*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")
    installed = tmp_path / "installed" / "echolearn"
    configurations = {path.relative_to(ROOT / "conf") for path in (ROOT / "conf").rglob("*.yaml")}
    assert {
        path.relative_to(installed / "conf") for path in (installed / "conf").rglob("*.yaml")
    } == configurations
    assert (installed / "py.typed").is_file()
    run = subprocess.run(
        [sys.executable, "-m", "echolearn", "train", "--cfg"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(tmp_path / "installed")},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "_target_: echolearn.dataset.plans.GridPlan" in run.stdout
    assert run.stderr == ""
