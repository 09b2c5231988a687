"""Bundles and surveys of an enemy: each refused in one line, at once, in a limited process."""

from shutil import copytree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bundle_mutants import BUNDLES, FILES, seal
from echolearn.checks import BadValue
from echolearn.robot.bundle import read_bundle
from echolearn.robot.scorer import load
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.survey import survey
from limited import Limited
from survey_mutants import FITTING, SURVEYS
from world import HALL, plans

EXAMINED = ("model that never ends", "model of a giant product", "model nudged", "not JSON")
"""Bundles that a process of its own has to load, and others that it may."""

MANY = settings(max_examples=40)


@pytest.fixture(scope="module")
def limited():
    """Return one process for all of them, and judge its memory at the end."""
    process = Limited()
    yield process
    assert process.memory < 1 << 30
    process.process.kill()


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Return a survey of three poses."""
    return survey(
        name="walk",
        room=HALL,
        scene=plans()[0].scene,
        levels=NoiseLevels(0.0),
        poses=3,
        runs=tmp_path_factory.mktemp("walk"),
    )


@pytest.mark.parametrize("mutation", [name for name in BUNDLES if name not in EXAMINED])
def test_a_hostile_bundle_is_refused(mutation, packed, limited, tmp_path):
    mutate, said = BUNDLES[mutation]
    folder = copytree(packed, tmp_path / "given")
    mutate(folder)
    found = limited("replay", folder=folder)
    assert said in found and "given" in found


@pytest.mark.parametrize("mutation", EXAMINED)
def test_a_hostile_bundle_is_refused_by_the_process_that_examines_it(
    mutation, packed, limited, tmp_path
):
    mutate, said = BUNDLES[mutation]
    folder = copytree(packed, tmp_path / "given")
    mutate(folder)
    found = limited("verify", folder=folder)
    assert said in found and "given" in found


@pytest.mark.parametrize("mutation", SURVEYS)
def test_a_hostile_survey_is_refused(mutation, packed, walk, limited, tmp_path):
    mutate, said = SURVEYS[mutation]
    folder = copytree(walk, tmp_path / "given")
    mutate(folder)
    found = limited("map_survey", survey=folder, bundle=packed, runs=tmp_path / "runs")
    assert said in found and "given" in found
    assert not [path for path in tmp_path.glob("runs/**/*") if path.is_file()]
    assert ("given" in limited("verify", folder=folder)) != (mutation in FITTING)


@st.composite
def damage(draw):
    """Return where a file is damaged, as a share of it, by which bits, and if it ends there."""
    return draw(st.floats(0, 1)), draw(st.integers(1, 255)), draw(st.booleans())


def damaged(path, share, bits, cut):
    data = bytearray(path.read_bytes())
    place = int(share * (len(data) - 1))
    data[place] ^= bits
    path.write_bytes(data[:place] if cut else data)


@given(st.sampled_from(FILES), damage())
@MANY
def test_any_damage_of_a_bundle_is_told(packed, tmp_path, name, how):
    folder = copytree(packed, tmp_path / "given", dirs_exist_ok=True)
    damaged(folder / name, *how)
    with pytest.raises(BadValue, match=f"^{folder / name}.*(damaged|cannot be read)"):
        read_bundle(folder)


@given(st.sampled_from(FILES[1:]), damage())
@MANY
def test_any_damage_that_is_sealed_is_told_or_changes_no_answer(
    packed, limited, tmp_path, name, how
):
    folder = copytree(packed, tmp_path / "given", dirs_exist_ok=True)
    damaged(folder / name, *how)
    seal(folder)
    said = limited("replay", folder=folder)
    assert said == "" or said.startswith(f"{folder}")


@given(st.sampled_from(["survey.yaml", "probe.wav", "poses.csv", "manifest.json"]), damage())
@MANY
def test_any_damage_of_a_survey_with_a_manifest_is_told(packed, walk, limited, tmp_path, name, how):
    folder = copytree(walk, tmp_path / "given", dirs_exist_ok=True)
    damaged(folder / name, *how)
    assert limited("verify", folder=folder).startswith(f"error: {folder / name}")


def test_what_only_looks_different_is_the_same(packed, tmp_path):
    """Sealed again without a change, with a file beside that nobody asked for: the same answers."""
    folder = copytree(packed, tmp_path / "bundle")
    seal(folder)
    (folder / "model.onnx.data").write_bytes(b"not read")
    x = load(packed).bundle.golden[0]
    assert np.array_equal(load(folder)(x), load(packed)(x))
