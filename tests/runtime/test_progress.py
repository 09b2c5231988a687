"""Progress: every item passes, and how far the work has come is told on stderr."""

import os
import pty
import subprocess
import sys

import pytest

from echolearn.runtime import progress


@pytest.mark.parametrize(
    ("items", "more", "pause", "said"),
    [
        ("abc", {"unit": "letters", "done": 2}, 0.0, "work: {} of 5 letters\n"),
        (range(1000), {"total": 1000}, 9.0, "work: 1000 of 1000\n"),
        ([], {"done": 3}, 0.0, ""),
    ],
)
def test_lines_tell_how_far_the_work_has_come(items, more, pause, said, capsys, monkeypatch):
    """Each of three pauses in the first case, the end alone in the second."""
    monkeypatch.setattr(progress, "PAUSE", pause)
    assert list(progress.track(items, "work", **more)) == list(items)
    lines = "".join(said.format(number) for number in (3, 4, 5)) if "{}" in said else said
    assert capsys.readouterr() == ("", lines)


def test_work_that_stops_early_does_not_claim_to_be_done(capsys):
    next(progress.track(range(5), "work"))
    assert capsys.readouterr().err == ""


def test_a_terminal_shows_a_bar():
    code = "from echolearn.runtime.progress import track\n"
    code += "assert [*track('abc', 'work', unit='letters', done=2)] == ['a', 'b', 'c']"
    ours, theirs = pty.openpty()
    subprocess.run([sys.executable, "-c", code], stderr=theirs, check=True)
    os.close(theirs)
    shown = os.read(ours, 100_000).decode()
    os.close(ours)
    assert all(word in shown for word in ("work", "5/5", "letters"))
