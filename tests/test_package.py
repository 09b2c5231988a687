"""The wheel works elsewhere, without the repository; what it needs is locked with hashes."""

import os
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import echolearn

ROOT = Path(__file__).parents[1]


def test_everything_that_is_needed_is_locked_with_hashes():
    """An installation of one version and other bytes is refused by pip."""
    entry = r"^[\w.-]+==[\w.]+ \\\n(?:    --hash=sha256:[0-9a-f]{64}(?: \\)?\n)+"
    for name in ("requirements.lock", "requirements-cuda.lock", "requirements-docs.lock"):
        text = (ROOT / name).read_text()
        assert not re.sub(rf"{entry}|^# .*\n", "", text, flags=re.M)
    lock = "".join((ROOT / f"requirements{of}.lock").read_text() for of in ("", "-docs"))
    locked = {name.lower().replace("_", "-") for name in re.findall(r"^([\w.-]+)==", lock, re.M)}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    groups = [project["dependencies"], *project["optional-dependencies"].values()]
    needed = {re.split(r"[\[<>=]", each)[0] for group in groups for each in group}
    assert needed and needed <= locked


@pytest.mark.release
def test_the_wheel_carries_the_configurations_and_works_elsewhere(tmp_path):
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
    assert (installed / "bundles" / "point" / "bundle.json").is_file()
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


def test_where_it_cannot_work_it_says_so_in_one_line():
    code = "import sys; sys.platform = 'win32'; import echolearn"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.stderr.splitlines()[-1].startswith("ImportError: echolearn needs Linux or macOS;")
