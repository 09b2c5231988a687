"""The two tortures, whose scripts print tables; a small part always, more of it for a release."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from kills import COMMANDS, tortures

SCRIPT = Path(__file__).parent / "robot" / "hostile.py"


def told(*words: str) -> str:
    """Return what the script says of hostile bundles and surveys, none of which was a fault."""
    paths = os.pathsep.join(filter(None, sys.path))
    command = [sys.executable, str(SCRIPT), *words]
    done = subprocess.run(
        command, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": paths}
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_some_hostile_files_are_refused_within_seconds_and_a_gibibyte() -> None:
    said = told("model that never ends", "laughter", "noise.wav of 10 TiB")
    assert "3 given, 0 not refused as they should be; at most " in said


@pytest.mark.release
def test_two_hundred_hostile_files_are_refused_within_seconds_and_a_gibibyte() -> None:
    given, _, faults = told().splitlines()[-1].partition(" given, ")
    assert int(given) >= 200 and faults.startswith("0 not refused")


@pytest.mark.release
def test_kills_lose_nothing_and_change_nothing() -> None:
    found = dict(tortures(list(COMMANDS), times=5, seed=1))
    assert {name: (each.kills, each.lost, each.different) for name, each in found.items()} == {
        name: (5, set(), set()) for name in COMMANDS
    }
