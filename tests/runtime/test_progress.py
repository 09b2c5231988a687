"""Progress: every item passes, and how far the work has come is told on stderr."""

import os
import pty
import subprocess
import sys

import pytest

from echolearn.runtime import progress

BAR = """
from echolearn.runtime.progress import track
assert list(track("abc", "work", unit="letters", done=2)) == ["a", "b", "c"]
"""


def test_lines_tell_how_far_the_work_has_come(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(progress, "PAUSE", 0.0)
    assert list(progress.track("abc", "work", unit="letters", done=2)) == ["a", "b", "c"]
    out, err = capsys.readouterr()
    assert err == "work: 3 of 5 letters\nwork: 4 of 5 letters\nwork: 5 of 5 letters\n"
    assert out == ""


def test_quick_work_takes_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(progress.track(iter(range(1000)), "work", total=1000)) == list(range(1000))
    assert capsys.readouterr().err == "work: 1000 of 1000\n"


def test_no_work_says_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert list(progress.track([], "work", done=3)) == []
    assert capsys.readouterr().err == ""


def test_work_that_stops_early_does_not_claim_to_be_done(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for _ in progress.track(range(5), "work"):
        break
    assert capsys.readouterr().err == ""


def test_a_terminal_shows_a_bar() -> None:
    ours, theirs = pty.openpty()
    subprocess.run([sys.executable, "-c", BAR], stderr=theirs, check=True)
    os.close(theirs)
    shown = os.read(ours, 100_000).decode()
    os.close(ours)
    assert "work" in shown
    assert "5/5" in shown
    assert "letters" in shown
