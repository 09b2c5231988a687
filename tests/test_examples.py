"""Examples do what they say, on a real bundle."""

import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np

from echolearn.cli.main import main
from echolearn.robot.scorer import load
from echolearn.survey import reader

EXAMPLES = Path(__file__).parents[1] / "examples"
EXAMPLE, SHORT = EXAMPLES / "read_bundle.py", EXAMPLES / "survey" / "short"


def read(*words, **environment):
    """Run the example where echolearn cannot be imported."""
    code = (
        "import runpy, sys; sys.modules['echolearn'] = None; "
        "runpy.run_path(sys.argv.pop(1), run_name='__main__')"
    )
    command, environment = [sys.executable, "-c", code, EXAMPLE, *words], os.environ | environment
    return subprocess.run(command, capture_output=True, text=True, env=environment)


def test_a_bundle_is_read_by_its_documented_format_alone(packed, tmp_path):
    done = read(packed, HOME=str(tmp_path))
    assert done.returncode == 0 and done.stderr == "" and not any(tmp_path.iterdir())
    [difference] = re.findall(r"golden confidences: (\S+)", done.stdout)
    assert float(difference) <= 1e-5
    scorer = load(packed)
    kept = int(np.sum(scorer(scorer.bundle.golden[0]) >= scorer.bundle.threshold))
    assert f"of 32 golden inputs {kept} are kept" in done.stdout


def test_damage_is_named(packed, tmp_path):
    for name in ("bundle.json", "model.onnx"):
        folder = shutil.copytree(packed, tmp_path / name)
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(
            data.replace(b"trees", b"birch", 1) if name.endswith("json") else data[:-1] + b"!"
        )
        done = read(folder)
        assert done.returncode != 0 and f"{name}: damaged" in done.stderr


def test_what_is_no_bundle_is_one_line(packed, tmp_path):
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "bundle.json").write_text("{}")
    (tmp_path / "text").mkdir()
    (tmp_path / "text" / "bundle.json").write_text("bundle")
    (tmp_path / "list").mkdir()
    (tmp_path / "list" / "bundle.json").write_text("[1]")
    less = shutil.copytree(packed, tmp_path / "less")
    (less / "model.onnx").unlink()
    for words, said in (
        ((), "usage: python read_bundle.py <folder of a bundle>"),
        ((packed, packed), "usage: "),
        ((tmp_path / "nowhere",), "nowhere/bundle.json: No such file or directory"),
        ((EXAMPLE,), "read_bundle.py/bundle.json: Not a directory"),
        ((tmp_path / "old",), "old: is no bundle (KeyError: 'sha256')"),
        ((tmp_path / "text",), "text: is no bundle (JSONDecodeError: "),
        ((tmp_path / "list",), "list: is no bundle ("),
        ((less,), "less/model.onnx: No such file"),
    ):
        done = read(*words)
        assert done.returncode == 1 and done.stdout == ""
        assert said in done.stderr and done.stderr.count("\n") == 1


def test_the_short_survey_is_what_its_command_makes(tmp_path):
    """To the byte where it was made; on other processors to rounding."""
    command = json.loads((SHORT / "manifest.json").read_text())["command"]
    assert command in (EXAMPLES / "README.md").read_text()
    assert main([*shlex.split(command)[1:], f"runs={tmp_path}"]) == 0
    kept, made = reader.read_survey(SHORT), reader.read_survey(tmp_path / "survey" / "short")
    poses = range(len(kept.poses))
    assert np.allclose(made.observe(poses).samples, kept.observe(poses).samples, rtol=0, atol=1e-6)
    places = [[[*pose.position, pose.heading] for pose in walk.poses] for walk in (kept, made)]
    assert np.allclose(*places, rtol=0, atol=1e-12)
    assert (made.folder / "survey.yaml").read_bytes() == (SHORT / "survey.yaml").read_bytes()


def test_the_short_survey_becomes_its_four_walls_by_the_bundle_that_comes_along(tmp_path, capsys):
    """At least six poses hear each wall, those in the middle none, and no option is needed."""
    assert sum(file.stat().st_size for file in SHORT.rglob("*.*")) <= 1_000_000
    assert main(["map", f"survey={SHORT}", f"runs={tmp_path}"]) == 0
    assert "4 walls fitted" in capsys.readouterr().out
    rows = (tmp_path / "maps" / "short-point" / "walls.csv").read_text().splitlines()
    walls = [dict(zip(rows[0].split(","), row.split(","), strict=True)) for row in rows[1:]]
    assert min(int(wall["points"]) for wall in walls) >= 6
    # Seen from the corner x = y = 0 of the room, two walls are 5 m away and two at hand.
    offsets = sorted(float(wall["offset_m"]) for wall in walls)
    assert np.allclose(offsets, [0, 0, 5, 5], rtol=0, atol=0.02)

    found = json.loads((tmp_path / "maps" / "short-point" / "manifest.json").read_text())
    assert found["scores"]["precision"] == found["scores"]["spurious_removal"] == 1
