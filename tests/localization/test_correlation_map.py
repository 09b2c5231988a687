"""The map about an echo: by a literal loop, and against what must not matter."""

from math import cos, degrees, radians, sin

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow, direction
from echolearn.acoustics.signals import noise_probe
from echolearn.localization.columns import MAP_LAGS, MAP_SECTORS
from echolearn.localization.correlation_map import correlation_map
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.methods.gated import Gated
from reference import RATE, RING, observed, wave, white

PROBE = noise_probe(length=4000)


def heard(*samples):
    """Return the view of recordings, and lag index and direction of each one's echo."""
    view = MatchedFilter(observed(PROBE, *samples), SearchWindow())
    echoes = Gated()(view.observation, view)
    toward = direction(echoes.azimuth[:, 0], echoes.elevation[:, 0])
    return view, view.index(echoes.toa[:, 0]), toward


def at_centre(azimuth, lag, gain):
    """Return an echo that reaches the array's centre after `lag`, microphone 1 on a sample."""
    x, y, _ = RING.positions[0]
    early = -(x * cos(azimuth) + y * sin(azimuth)) / 343.0 * RATE
    return wave(PROBE, azimuth, round(lag + early), gain)


def by_loops(view, index, toward):
    """Return one map, a number at a time; times at microphone 1 less those at the centre."""
    steered = view.steered[0]
    competitor = max(
        steered[:, lag].max() for lag in range(steered.shape[1]) if abs(lag - index) >= 5
    )
    azimuths, elevations = view.directions
    nearest = round((np.arctan2(toward[1], toward[0]) + np.pi) / np.radians(2))
    steps = [[(nearest + 5 * s - 2 + i) % 180 for i in range(5)] for s in range(MAP_SECTORS)]
    found = np.zeros((MAP_SECTORS + 1, MAP_LAGS))
    for s, directions in enumerate([*steps, [180]]):
        for column in range(MAP_LAGS):
            values = []
            for d in directions:
                other = direction(azimuths[d], elevations[d])
                late = (RING.positions[0] - RING.positions.mean(axis=0)) @ (other - toward)
                shift = round(-late / 343.0 * RATE)
                lags = [int(index) + shift - MAP_LAGS + 2 * column + k for k in range(2)]
                values += [steered[d, n] if 0 <= n < steered.shape[1] else 0.0 for n in lags]
            found[s, column] = max(values)
    return (found / competitor).astype(np.float16)


@pytest.mark.parametrize("azimuth", [0.7, -3.1])
def test_the_map_is_the_steered_response_about_the_echo(azimuth):
    view, index, toward = heard(wave(PROBE, azimuth, 150) + white(PROBE, 0.4))
    found = correlation_map(view, index, toward=toward)[0]
    assert np.array_equal(found[: MAP_SECTORS + 1], by_loops(view, index[0], toward[0]))


@pytest.mark.parametrize("azimuth", [0.0, 100.0, 200.0, 310.0])
def test_an_echo_seen_ahead_and_one_behind_are_the_same_picture_turned(azimuth):
    """A second wave comes 36 lags later from 90 degrees to the left, wherever the first is from."""
    first = at_centre(radians(azimuth), 170.0, 0.1)
    second = at_centre(radians(azimuth + 90.0), 206.0, 0.08)
    view, index, toward = heard(first + second + white(PROBE, 1e-3))
    assert abs(degrees(np.arctan2(toward[0, 1], toward[0, 0])) % 360 - azimuth) <= 1.0
    level = correlation_map(view, index, toward=toward)[0, :MAP_SECTORS].astype(float)
    middle = MAP_LAGS // 2
    assert level.max() == level[0, middle - 1 : middle + 1].max() == pytest.approx(1.25, abs=0.1)
    level[:, middle - 3 : middle + 3] = 0.0
    sector, column = np.unravel_index(level.argmax(), level.shape)
    assert sector == 9 and abs(column - (middle + 18)) <= 1


def test_microphones_are_alike_at_an_echo_and_not_at_a_chance_hit():
    echo = wave(PROBE, 0.9, 180) + white(PROBE, 0.1)
    view, index, toward = heard(echo, white(PROBE, 1.0, 3))
    found = correlation_map(view, index, toward=toward).astype(float)
    middle = found[:, MAP_SECTORS + 1 :, 32]
    assert middle.std(axis=1)[0] < 0.1 * middle.mean(axis=1)[0]
    assert middle.std(axis=1)[1] > 0.2 * middle.mean(axis=1)[1]
    # What they have in the mean is J at the echo.
    assert middle[0].mean() == pytest.approx(found[0, 0, 31:33].max(), rel=0.02)
