"""Timing: statistics by hand, turns, warming up, and what counts as time."""

import subprocess
import sys
import time
from functools import partial
from types import SimpleNamespace

import pytest

from echolearn.runtime import timing
from echolearn.runtime.timing import SHORTEST, Contestant, exponent, lap, race, ratios, spread


@pytest.fixture
def passes(monkeypatch):
    """Let the clock of races stand still but for what this adds to it, in s."""
    now = []
    clock = SimpleNamespace(perf_counter=lambda: sum(now), process_time=time.process_time)
    monkeypatch.setattr(timing, "time", clock)
    return now.append


def test_statistics_are_those_of_hand():
    assert spread([4.0, 1.0, 3.0, 2.0]) == (2.5, 1.75, 3.25)
    assert spread([7.0]) == (7.0, 7.0, 7.0)
    assert exponent([1.0, 2.0, 4.0], [5.0, 40.0, 320.0]) == pytest.approx(3.0)


def test_ratios_are_taken_lap_by_lap():
    """Medians are 10 and 1; in the second lap the machine was slow for both."""
    assert ratios([10.0, 60.0, 2.0], [1.0, 20.0, 1.0]) == (3.0, 2.5, 6.5)
    with pytest.raises(ValueError):
        ratios([1.0, 2.0], [1.0])


def test_waiting_takes_time_but_no_cpu(passes):
    found = lap(Contestant(partial(passes, 0.04), units=4), calls=2)
    assert found.wall == pytest.approx(0.01)
    assert found.cpu < 0.005


def test_computing_takes_cpu_here_and_in_processes_that_were_started():
    def burn():
        until = time.process_time() + 0.05
        while time.process_time() < until:
            pass

    assert 0.05 <= lap(Contestant(burn)).cpu < 0.1
    child = "import time\nwhile time.process_time() < 0.2: pass"
    start = partial(subprocess.run, [sys.executable, "-c", child], check=True)
    assert lap(Contestant(start)).cpu >= 0.2


def noting(name, kept, passes=lambda pause: None, pauses=(0.0,)):
    """Return work that notes its name, and takes each of some times in turn, the last for good."""
    left = list(pauses)

    def work():
        kept.append(name)
        passes(left.pop(0) if len(left) > 1 else left[0])

    return work


def test_contestants_take_turns_and_nobody_is_always_first():
    kept = []
    found = race({x: Contestant(noting(x, kept), warm=False) for x in "abc"}, laps=4)
    assert "".join(kept) == "abcbcacababc"
    assert [len(laps) for laps in found.values()] == [4, 4, 4]


def test_the_first_call_is_not_timed(passes):
    slow = Contestant(noting("x", [], passes, (0.3, 0.01)))
    assert [lap.wall for lap in race({"x": slow}, laps=3)["x"]] == pytest.approx([0.01] * 3)


def test_what_is_quick_is_called_often_enough_for_the_clock(passes):
    kept = []
    found = race({"quick": Contestant(noting("x", kept, passes, (2e-4,)))}, laps=5)
    # Twice to warm up and to count; a lap is that of one call.
    assert len(kept) == pytest.approx(2 + 5 * SHORTEST / 2e-4, abs=5)
    assert [lap.wall for lap in found["quick"]] == pytest.approx([2e-4] * 5)


def test_a_race_ends_when_its_time_is_up_but_not_before_its_least_laps(passes):
    slow = {"slow": Contestant(partial(passes, 0.02), warm=False)}
    assert len(race(slow, laps=100, seconds=0.0)["slow"]) == 3
    assert len(race(slow, laps=2, seconds=0.0)["slow"]) == 2
    assert len(race(slow, laps=100, seconds=0.21)["slow"]) == 11
    assert race({}, laps=3) == {}
