"""What a bundle may say: bundles of before are read, and whatever is wrong is one line."""

import json
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bundle_mutants import seal
from echolearn.acoustics.geometry import SearchWindow
from echolearn.checks import BadValue
from echolearn.localization.methods.gated import Gated
from echolearn.robot.bundle import localizer_names, localizer_of, read_bundle
from echolearn.robot.schema import SCHEMA
from echolearn.robot.scorer import load
from echolearn.robot.survey_map import map_survey

BEFORE = Path(__file__).parent / "bundle_0_1"
"""A bundle that version 0.1 exported: schema 2, `gated.Gated`."""

SHORT = Path(__file__).parents[2] / "examples" / "survey" / "short"


def test_a_bundle_of_before_is_read_and_maps_a_survey(tmp_path):
    content = json.loads((BEFORE / "bundle.json").read_text())
    assert content["schema"] == 2 and content["localizer"]["name"] == "gated.Gated"
    scorer = load(BEFORE)
    x, confidence = scorer.bundle.golden
    assert np.abs(scorer(x) - confidence).max() <= 1e-5
    assert scorer.bundle.localizer == Gated(SearchWindow(rule="authors"))
    assert scorer.bundle.about["schema"] == SCHEMA
    folder = map_survey(survey=SHORT, bundle=BEFORE, runs=tmp_path)
    about = json.loads((folder / "manifest.json").read_text())
    assert about["kept"] == 22 and about["inputs"]["bundle"] == content["sha256"]


@pytest.mark.parametrize("name", localizer_names())
def test_every_localizer_travels_by_its_short_name(name):
    made = localizer_of(name=name, arguments={}, window=SearchWindow())
    assert type(made).__name__.lower() == name and made.echoes == 1


UNIT = {"name": "toa", "unit": "s"}


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (
            "schema",
            1,
            "=1: must be 2, 3, 4 or 5; this echolearn reads schemas 2 to 5; update it or export",
        ),
        ("schema", 6, "=6: must"),
        ("schema", "3", "=3: must"),
        ("schema", True, "=True: must"),
        ("kind", "set", "=set: must be bundle"),
        ("threshold", ..., "=missing: must be a mapping with kind, schema"),
        ("threshold", 0.5, "=0.5: must be a mapping with value, chosen"),
        ("threshold__value", ..., "=missing"),
        ("threshold__value", 2, "=2: must be a number from 0 to 1"),
        ("threshold__value", True, "=True"),
        ("threshold__chosen", 7, "=7: must be a printable text"),
        ("files", {"../../etc/passwd": {}}, ".key=../../etc/passwd: must be one of model.onnx"),
        ("files", ["model.onnx"], "=['model.onnx']: must be a mapping"),
        ("label__name", "wall", None),
        ("label__true", "anything", None),
        ("sample_rate", "fast", "=fast Hz"),
        ("sample_rate", 10**4000, "=1000"),
        ("speed_of_sound", 3e8, "=300000000.0 m/s"),
        ("array", [], "=shape (0,): must be many x 3 finite numbers in m"),
        ("array", [[0.2, 0.0, 0.0]] * 1000, "=1000 microphones: must be 1 to 256"),
        ("array", [[1e30, 0.0, 0.0]], "=1e+30 m: must be coordinates from -10 to 10 m"),
        ("window__nearest", 5.0, "=5.0 m"),
        ("window__rule", "all", "=all"),
        ("window", {"nearest": 1.0}, ".farthest=missing"),
        ("localizer__name", "os.system", "=os.system: must be one of em, gated"),
        ("localizer__name", "gated.Gated", "=gated.Gated: must be one of"),
        ("localizer__name", "../gated", "=../gated: must be one of"),
        ("localizer__name", 7, "=7: must be a printable text"),
        ("localizer__arguments", {"azimuths": 10**9}, None),
        ("localizer__arguments", {"shell": 1}, "=shell: must be some of azimuths"),
        ("localizer__arguments", {"azimuths": [36]}, ".azimuths=[36]: must be a number, a text"),
        ("columns", [], "=[]: must be one tensor, or columns that are there once"),
        ("columns", [{"name": "snr_db", "unit": "dB"}], "=['snr_db']: must be some of toa"),
        ("columns", [UNIT | {"unit": "ms"}], "=['ms']: must be the units ['s']"),
        ("columns", [UNIT] * 4, "=['toa', 'toa', 'toa', 'toa']: must"),
        ("columns", [UNIT], None),
        ("input_shape", [10**12], "=1000000000000: must be a whole number from 1 to 100000"),
        ("view", "patch", "=patch: must be features or covariance"),
        ("view", "covariance", None),
        ("probe__length", 10**15, "=1000000000000000 samples"),
        ("probe__burst", 7, "=7: must be 1500, as probe.wav has it"),
        ("probe__file", "/etc/passwd", "=/etc/passwd: must be probe.wav"),
        ("name", "\x1b[2Jbest", "='\\x1b[2Jbest': must be a printable text"),
        ("run", "a\nb", "='a\\nb': must"),
        ("name", "a" * 10**5, "='aaa"),
        ("seed", -1, "=-1: must be a whole number from 0"),
        ("command", "curl evil | sh", "='curl evil | sh': must be one command line of echolearn"),
        ("command", "echolearn export; rm -rf x", "='echolearn export; rm -rf x': must"),
        ("data__rows", 0, "=0: must"),
        ("parity__difference", 0.1, "=0.1: must be a number from 0 to 1e-05"),
        ("metrics__held_out__figures", [], "=[]: must be a mapping"),
        ("metrics__held_out__figures", {"auc": {"value": 1}}, ".auc.ci_low=missing"),
        ("metrics__maps", {}, "={}: must be a list"),
        ("versions", {"numpy": 2}, ".numpy=2: must"),
        ("bands", 8, "=8: must be 16"),
        ("golden", 33, "=33: must be 32"),
    ],
)
def test_bad_values_are_refused(path, value, message, packed, tmp_path):
    folder = copytree(packed, tmp_path / "bundle")
    seal(folder, **{path: value})
    with pytest.raises(BadValue) as refused:
        read_bundle(folder)
    said = str(refused.value)
    assert said.startswith(f"{folder}/bundle.json ") and said.isprintable() and len(said) < 1000
    if message is not None:
        assert f"{path.replace('__', '.')}{message}" in said


def test_a_bundle_of_schema_4_names_its_reference(packed, tmp_path):
    folder = copytree(packed, tmp_path / "bundle")
    seal(folder, schema=4)
    with pytest.raises(BadValue, match=r"bundle\.json reference=missing: must be a mapping with"):
        read_bundle(folder)


def paths(inside, before=""):
    """Return the ways to all values of `bundle.json`."""
    if not isinstance(inside, dict):
        return [before]
    return [way for key, each in inside.items() for way in paths(each, f"{before}__{key}")]


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=6,
)


@given(st.data())
@settings(max_examples=150)
def test_any_value_is_taken_or_refused_in_one_line(packed, tmp_path, data):
    folder = copytree(packed, tmp_path / "bundle", dirs_exist_ok=True)
    content = json.loads((folder / "bundle.json").read_text())
    ways = [way[2:] for way in paths(content) if "files" not in way and way != "__sha256"]
    way = data.draw(st.sampled_from(ways))
    value = data.draw(VALUES)
    try:
        seal(folder, **{way: value})
    except BadValue:
        return  # no JSON can hold it
    try:
        read_bundle(folder)
    except BadValue as refused:
        said = str(refused)
        assert said.startswith(f"{folder}/") and said.isprintable() and len(said) < 1000
