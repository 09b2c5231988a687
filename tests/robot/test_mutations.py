"""Bundles and surveys as an enemy or a bad disk would leave them: each refused in one clear line,
at once.

All are tried by one process (`mutate.py`), whose memory is measured; here is judged what it says.
"""

import json
import subprocess
import sys
import time
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest
from onnx import TensorProto, helper

from bundle_mutants import BUNDLES, constant, graph, seal
from echolearn.checks import BadValue
from echolearn.robot import scorer
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.survey import survey
from survey_mutants import SURVEYS
from world import HALL, plans

SAYS = {f"bundle: {name}": said for name, (_, said) in BUNDLES.items()}
SAYS |= {f"survey: {name}": said for name, (_, said) in SURVEYS.items()}

MATCH = {
    "another probe", "microphones elsewhere", "a loudspeaker elsewhere",
}  # fmt: skip
"""Surveys that are sound for themselves, but not for this bundle: `verify`, which sees the survey
alone, takes them."""


@pytest.fixture(scope="module")
def tried(packed: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return what came of every mutation."""
    place = tmp_path_factory.mktemp("mutants")
    walk = survey(
        name="walk", room=HALL, scene=plans()[0].scene, levels=NoiseLevels(0.0), poses=3, runs=place
    )
    script = [
        sys.executable,
        str(Path(__file__).parent / "mutate.py"),
        str(packed),
        str(walk),
        str(place / "copies"),
    ]
    done = subprocess.run(script, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def test_there_are_many() -> None:
    assert len(BUNDLES) > 190 and len(SURVEYS) > 190 and len(SAYS) > 390


def test_none_takes_more_than_a_gigabyte(tried: dict[str, Any]) -> None:
    assert tried["memory"] < 1 << 30
    assert set(tried["outcomes"]) == set(SAYS)


@pytest.mark.parametrize("mutation", SAYS)
def test_it_is_refused_in_one_line(mutation: str, tried: dict[str, Any]) -> None:
    found = tried["outcomes"][mutation]
    said = found["said"]
    assert said and SAYS[mutation] in said and "given" in said
    assert said.isprintable() and len(said) < 1000
    assert found["seconds"] < 5.0 and found["left"] == []


@pytest.mark.parametrize("mutation", SAYS)
def test_verify_says_so_in_one_line(mutation: str, tried: dict[str, Any]) -> None:
    found = tried["outcomes"][mutation]
    if mutation.removeprefix("survey: ") in MATCH:
        assert found["status"] == 0 and found["verify"] == ""
        return
    assert found["status"] == 1
    assert found["verify"].startswith("error: ") and found["verify"].count("\n") == 1
    assert found["verify"].strip().isprintable() and "given" in found["verify"]


def test_a_model_that_never_ends_is_stopped(packed: Path, tmp_path: Path) -> None:
    """Four thousand products of large matrices would take an hour."""
    folder = copytree(packed, tmp_path / "bundle")
    nodes = [helper.make_node("Expand", ["one", "size"], ["a0"])]
    nodes += [helper.make_node("MatMul", [f"a{i}", "a0"], [f"a{i + 1}"]) for i in range(4000)]
    nodes += [helper.make_node("ReduceMax", ["a4000", "axes"], ["most"], keepdims=0)]
    nodes += [helper.make_node("Cast", ["most"], ["confidence"], to=TensorProto.DOUBLE)]
    tensors = (
        constant(np.ones((1, 1), np.float32), "one"),
        constant([1500, 1500], "size"),
        constant([1], "axes"),
    )
    graph(*nodes, initializers=tensors)(folder)
    began = time.monotonic()
    with pytest.raises(BadValue, match="cannot be computed"):
        scorer.load(folder)
    assert time.monotonic() - began < 3 * scorer.PATIENCE


def test_what_only_looks_different_is_the_same(packed: Path, tmp_path: Path) -> None:
    """Sealed again without a change, with a file beside that nobody asked for: the same answers."""
    folder = copytree(packed, tmp_path / "bundle")
    seal(folder)
    (folder / "model.onnx.data").write_bytes(b"not read")
    x = scorer.load(packed).bundle.golden[0]
    assert np.array_equal(scorer.load(folder)(x), scorer.load(packed)(x))
