"""What the script behind the ranges of realism measures, on sound whose figures are known."""

import importlib.util
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from echolearn.survey.sources.r3vival import R3vival

PATH = Path(__file__).parents[2] / "docs" / "measured_ranges.py"
RATE = 22050.0


@pytest.fixture(scope="module")
def ranges():
    """Return the script as a module."""
    spec = importlib.util.spec_from_file_location("measured_ranges", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def free_field(gains_db, late):
    """Return what six equal microphones would measure of a pulse, but for gains and delays."""
    measured = R3vival(("000",)).read(None)
    found = []
    for each in measured.responses[:12:2]:
        way = np.linalg.norm(each.loudspeaker - measured.array.positions, axis=1)
        lags = (each.emitted + way / measured.speed_of_sound) * RATE + late
        n = np.arange(each.samples.shape[-1])
        pulse = np.sinc(n - lags[:, None]) / way[:, None] * 10 ** (np.array(gains_db)[:, None] / 20)
        found.append(replace(each, samples=pulse))
    return list_of(measured, found)


def list_of(measured, responses):
    """Return measurements with other responses."""
    return replace(measured, responses=responses)


def said(rows, key, what):
    """Return the figure of a line that begins so."""
    [text] = [found for name, about, found in rows if key in name and about.startswith(what)]
    return float(re.match(r"-?[\d.]+", text)[0])


def test_gains_and_places_of_microphones_are_those_that_were_made(ranges):
    gains = [1.0, -1.0, 0.5, -0.5, 0.0, 0.0]
    places = list(ranges.heard(free_field(gains, np.zeros(6))))
    rows = list(ranges.microphones(places))
    expected = np.std(gains, ddof=1)
    assert said(rows, "microphone_db", "standard") == pytest.approx(expected, abs=0.01)
    assert said(rows, "ripple", "of each one's") < 0.02
    assert said(rows, "offset", "of a coordinate") < 0.05
    late = np.array([0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
    rows = list(ranges.microphones(list(ranges.heard(free_field(gains, late)))))
    # Half a sample, from all sides, is no displacement: 7.8 mm at one of six.
    apart = 0.5 / RATE * 343e3 * np.std([1, 0, 0, 0, 0, 0])
    assert said(rows, "offset", "what no displacement") == pytest.approx(apart, rel=0.05)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.6])
def test_the_share_of_energy_after_an_echos_crest_is_what_was_put_there(ranges, share):
    rng = np.random.default_rng(3)
    echo = 1e-3 * rng.standard_normal(400)
    echo[200] += np.sqrt(1.0 - share)
    tail = rng.standard_normal(17)
    echo[205:222] += np.sqrt(share) * tail / np.linalg.norm(tail)
    found = ranges.shape_of(echo, 203, rate=RATE)
    assert found.later == pytest.approx(share, abs=0.03)
    assert found.over_clutter > 40.0
    # Where nothing stands out there is no echo.
    assert ranges.shape_of(rng.standard_normal(400), 203, rate=RATE) is None
