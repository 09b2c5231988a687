"""Commands that messages advise: the same wherever one stands, and wherever the folder has gone."""

import shlex
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from echolearn.storage.advice import anywhere, assignment, command_line, text_of

ADVISED = """
echolearn generate plan=tiny | runs/data/tiny-0 | . | echolearn generate plan=tiny
echolearn generate plan=tiny | runs/data/tiny-0 | deep | echolearn generate plan=tiny runs=HOME/runs
echolearn survey seed=1 runs=a/r | a/r/survey/x | deep | echolearn survey seed=1 runs=HOME/a/r
echolearn survey seed=1 runs=a/r | a/r/survey/x | a | echolearn survey seed=1 runs=HOME/a/r
echolearn survey runs=./r/ name=x | r/survey/x | . | echolearn survey runs=./r/ name=x
echolearn survey runs=../r name=x | r/survey/x | deep | echolearn survey name=x runs=HOME/r
echolearn survey runs=/gone/runs name=x | r/survey/x | . | echolearn survey name=x runs=HOME/r
echolearn map survey=w bundle=/b/c direct=null | runs/maps/w-c | deep | \
    echolearn map survey=HOME/w bundle=/b/c direct=null runs=HOME/runs
echolearn map survey=w bundle=b runs=/gone | r/maps/w-b | deep | \
    echolearn map survey=w bundle=b runs=HOME/r
echolearn export run=runs/train/t best=null | runs/bundles/t | deep | \
    echolearn export run=HOME/runs/train/t best=null runs=HOME/runs
echolearn export run=runs/train/t | robot/best | . | echolearn export run=runs/train/t
echolearn bench rows=3 | runs/bench | deep | echolearn bench rows=3 runs=HOME/runs
"""


@pytest.mark.parametrize("row", ADVISED.replace("\\\n", "").strip().splitlines())
def test_paths_are_told_in_full_where_they_would_lead_elsewhere(row, tmp_path, monkeypatch):
    """Where the folder has been moved, the paths around it are not known."""
    command, folder, here, expected = row.split(" | ")
    for place in ("deep", "a"):
        (tmp_path / place).mkdir()
    monkeypatch.chdir(tmp_path / here)
    told = anywhere(command.strip(), tmp_path / folder)
    assert told == expected.strip().replace("HOME", str(tmp_path))


def test_names_that_a_shell_or_hydra_reads_otherwise_are_quoted():
    line = command_line("survey", assignment("name", "a (1)"), runs=Path("it's"))
    assert shlex.split(line) == ["echolearn", "survey", "name='a (1)'", "runs='it\\'s'"]
    assert command_line("train", runs=Path("runs")) == "echolearn train"


@given(st.text())
def test_a_text_is_what_was_quoted(text):
    key, _, value = assignment("key", text).partition("=")
    assert key == "key" and text_of(value) == text
