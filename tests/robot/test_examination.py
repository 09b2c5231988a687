"""A bundle from elsewhere is examined once, by a process that may be lost."""

import json
import sys
import time
from shutil import copytree

import numpy as np
import pytest

from bundle_mutants import LATER, seal
from echolearn.checks import BadValue
from echolearn.robot import examination, model, trial
from echolearn.robot.scorer import load
from echolearn.storage import known, manifests


def elsewhere(packed, tmp_path):
    """Return a copy of a bundle that says something that no bundle made here has said."""
    folder = copytree(packed, tmp_path / "given")
    seal(folder, name=str(tmp_path))
    return folder


def test_a_bundle_from_elsewhere_is_examined_once_and_that_is_said(packed, tmp_path, capsys):
    folder = elsewhere(packed, tmp_path)
    load(folder)
    said = capsys.readouterr().err
    assert said.startswith("bundle given: from elsewhere; examined in ") and said.count("\n") == 1
    load(copytree(folder, tmp_path / "again"))
    assert capsys.readouterr().err == ""


def test_a_bundle_that_was_made_here_is_not_examined(packed, capsys):
    digest = json.loads((packed / "bundle.json").read_text())["sha256"]
    assert known.is_known(digest, known.MADE)
    load(packed)
    assert capsys.readouterr().err == ""


def test_what_is_refused_stays_unknown(packed, tmp_path):
    folder = elsewhere(packed, tmp_path)
    (folder / "probe.wav").unlink()
    for _ in range(2):
        with pytest.raises(BadValue, match=f"^{folder}/probe.wav: cannot be read"):
            load(folder)


def test_a_list_that_cannot_be_written_costs_an_examination_each_time(
    packed, tmp_path, capsys, monkeypatch
):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    for _ in range(2):
        load(packed)
        assert "examined in" in capsys.readouterr().err


@pytest.fixture
def answered(monkeypatch, capsys):
    """Return what the program of the child prints about a folder, here and without its limits:
    they would stay, and what counts lines could not write them down."""

    def answer(folder):
        monkeypatch.setattr(trial, "limit", lambda: None)
        monkeypatch.setattr(sys, "argv", ["trial", str(folder)])
        trial.answer()
        return json.loads(capsys.readouterr().out)

    return answer


def test_the_child_answers_with_the_digest_or_the_refusal(packed, world, tmp_path, answered):
    digest = json.loads((packed / "bundle.json").read_text())["sha256"]
    assert answered(packed) == {"digest": digest, "refusal": ""}
    run = next((world.runs / "train").glob("svm_pair-*"))
    digest = json.loads((run / manifests.METRICS).read_text())["sha256"]
    assert answered(run) == {"digest": digest, "refusal": ""}

    folder = elsewhere(packed, tmp_path)
    (folder / "model.onnx").unlink()
    found = answered(folder)
    assert found["digest"] == ""
    assert found["refusal"].startswith(f"{folder}/model.onnx: cannot be read")


def test_a_child_without_memory_says_so(packed, answered, monkeypatch):
    def exhausted(folder):
        raise MemoryError

    monkeypatch.setattr(trial, "replay", exhausted)
    assert answered(packed)["refusal"] == f"{packed}: needs more than 768 MiB of memory"


@pytest.mark.parametrize(
    ("code", "said"),
    [
        ("import os; os.abort()", "ended by SIGABRT"),
        ("raise SystemExit('no such library')", "ended by status 1; no such library"),
        ("print('{}')", "ended by status 0"),
    ],
)
def test_a_process_that_is_lost_is_a_refusal(code, said, packed, tmp_path, monkeypatch):
    folder = elsewhere(packed, tmp_path)
    (tmp_path / "lost.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(examination, "TRIAL", "lost")
    with pytest.raises(BadValue, match=f"^{folder}: cannot be computed: .* {said}"):
        load(folder)


def test_another_bundle_than_the_examined_one_is_refused(packed, tmp_path, monkeypatch):
    folder = elsewhere(packed, tmp_path)
    (tmp_path / "other.py").write_text('print(\'{"digest": "0", "refusal": ""}\')')
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(examination, "TRIAL", "other")
    with pytest.raises(BadValue, match="must stay as it is while it is examined"):
        load(folder)


def test_a_model_that_takes_long_for_other_inputs_than_the_golden_is_stopped(
    packed, tmp_path, monkeypatch
):
    folder = copytree(packed, tmp_path / "given")
    LATER["model that is lazy for golden inputs"](folder)
    scorer = load(folder)
    assert scorer(np.zeros((3, 4))).tolist() == [0.0, 0.0, 0.0]
    monkeypatch.setattr(model, "SECONDS", 0.5)
    began = time.thread_time()
    said = f"^{folder}/model.onnx: cannot be computed .3 inputs take more than 0.53 s of computing"
    with pytest.raises(BadValue, match=said):
        scorer(np.ones((3, 4)))
    assert 0.4 < time.thread_time() - began < 2.0
