"""The two tortures, whose scripts print tables: part of it for each release."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from kills import COMMANDS, tortures

SCRIPT = Path(__file__).parent / "robot" / "hostile.py"


def told(*words):
    """Return what the script says of hostile bundles and surveys, none of which was a fault."""
    paths = os.pathsep.join(filter(None, sys.path))
    command = [sys.executable, str(SCRIPT), *words]
    done = subprocess.run(
        command, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": paths}
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.release
def test_two_hundred_hostile_files_are_refused_within_seconds_and_a_gibibyte():
    _, given, refused, *_ = told().splitlines()[-1].split()
    assert int(given) >= 200 and refused == given


@pytest.mark.release
def test_kills_lose_nothing_and_change_nothing():
    found = list(tortures(list(COMMANDS), times=5, seed=1, workers=2))
    assert [(name, each.kills) for name, _, each in found] == [(name, 5) for name in COMMANDS]
    assert [each for _, _, each in found if not each.is_sound] == []
