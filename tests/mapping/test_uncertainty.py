"""The intervals of walls hold the truth as often as they say; grids leave what grids leave."""

from dataclasses import replace

import numpy as np
import pytest

from echolearn.acoustics.bistatic import echo_direction, echo_path, wall_distance, wall_points
from echolearn.acoustics.geometry import circular_array, direction
from echolearn.acoustics.types import Echoes, MicArray, Probe
from echolearn.mapping.accuracy import Accuracy, accuracy_of
from echolearn.mapping.uncertainty import Sightings, _Wall, measured
from echolearn.mapping.walls import Line, fit
from wall_coverage import shares, trials

LAG = Accuracy().lag
BURST = Probe(np.random.default_rng(0).standard_normal(1500), 22050.0, 20000)
CELL = np.array([LAG, Accuracy().azimuth]) / np.sqrt(12)


@pytest.mark.parametrize(
    ("each", "low", "high"),
    [(3, 0.85, 1.0), pytest.param(125, 0.93, 0.97, marks=pytest.mark.release)],
)
def test_intervals_hold_the_truth(each, low, high):
    """Of all walks together at least 93 %; where grids leave less than half, at most 97 %."""
    drawn = sum(trials(each).values(), [])
    noisy = [case for case in drawn if case.noisy]
    assert min(shares(drawn)) >= low
    assert max(shares(noisy)) <= high


def seen_from(poses, headings, sd=0.0):
    """Return the wall x = 2 as a robot without noise finds it, nothing told of the headings."""
    distance = LAG * np.round((2.0 - poses[:, 0]) / LAG)
    step = Accuracy().azimuth
    bearing = headings + step * np.round(-headings / step)
    rays = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    points = poses + distance[:, None] * rays
    seen = Sightings(points, poses, headings, np.full(len(poses), sd), np.zeros(len(poses)))
    line = fit(points, rays, members=np.arange(len(poses)))
    return measured(line, seen, accuracy=Accuracy())


def test_a_robot_that_stands_still_keeps_the_errors_of_its_grids():
    """However often it listens; what turns the normal moves the offset by its lever."""
    lines = [seen_from(np.tile([[0.3, 7.0]], (count, 1)), np.full(count, 0.7)) for count in (5, 50)]
    for line in lines:
        assert line.normal_sd == pytest.approx(CELL[1], rel=0.1)
        assert line.offset_sd == pytest.approx(np.hypot(CELL[0], 7.0 * CELL[1]), rel=0.1)


def test_a_robot_that_turns_or_walks_averages_them():
    headings = np.random.default_rng(0).uniform(-np.pi, np.pi, 40)
    turned = seen_from(np.tile([[0.3, 0.0]], (40, 1)), headings)
    assert turned.normal_sd < CELL[1] / 4
    places = np.stack([np.linspace(0.0, 0.5, 40), np.linspace(-2.0, 2.0, 40)], axis=1)
    walked = seen_from(places, headings)
    assert walked.normal_sd < turned.normal_sd and walked.offset_sd < CELL[0] / 2
    assert walked.offset == pytest.approx(2.0, abs=3 * walked.offset_sd)
    assert seen_from(places, headings, sd=0.05).offset_sd == pytest.approx(0.05 / 40**0.5, rel=0.2)


ASIDE = MicArray(circular_array(radius=0.1).positions + [0.45, 0.0, 0.0])
"""A ring far ahead of its loudspeaker."""


def test_a_robot_whose_array_is_aside_sees_walls_turn_more_or_less_than_they_do():
    """Rounded to the grid of directions, no echo misses its wall by more than half a cell of it; by
    the wall's own azimuth, those ahead would by a fifth more, as the array is nearer to them."""
    headings = np.random.default_rng(0).uniform(-0.4, 0.4, 200)
    accuracy = accuracy_of(BURST, ASIDE, azimuths=180, speed_of_sound=343.0)
    away = np.full(200, 1.1)
    x, y, _ = echo_direction(away, direction(-headings, np.pi / 2), array=ASIDE).T
    bearing = accuracy.azimuth * np.round(np.arctan2(y, x) / accuracy.azimuth)
    path = echo_path(away, direction(-headings, np.pi / 2), array=ASIDE)
    points = wall_points(
        path / 343.0,
        bearing,
        np.full(200, np.pi / 2),
        position=np.zeros((200, 2)),
        heading=headings,
        array=ASIDE,
    )
    seen = Sightings(points, np.zeros((200, 2)), headings, np.zeros(200), np.zeros(200))
    ends = np.array([[1.1, -1.0], [1.1, 1.0]])
    wall = Line(*ends, 0.0, 1.1, 1.0, 1.0, 1.0, 200, np.arange(200))
    misses = np.abs(_Wall.of(wall, seen, accuracy=accuracy).azimuth_misses(np.zeros(1)))
    assert misses.max() == pytest.approx(accuracy.azimuth / 2, rel=0.03)
    centred = replace(accuracy, array=None)
    plain = np.abs(_Wall.of(wall, seen, accuracy=centred).azimuth_misses(np.zeros(1)))
    assert plain.max() < 0.87 * misses.max()
    found = measured(wall, seen, accuracy=accuracy)
    assert found.offset == pytest.approx(1.1, abs=3 * found.offset_sd)


def test_beside_its_loudspeaker_an_array_has_a_lever_on_distances():
    """Of a wall to the left of an array 0.45 m ahead an error of direction is one of distance."""
    echoes = Echoes(
        *np.array([[0.008] * 2, [1.0] * 2, [1.0] * 2, [0.0, 1.5], [1.571] * 2, [0.0] * 2])
    )
    accuracy = accuracy_of(BURST, ASIDE, azimuths=180, speed_of_sound=343.0)
    distance, azimuth = accuracy.of_echoes(echoes)
    step = 1e-4
    far, near = (
        wall_distance(echoes.toa, direction(echoes.azimuth + turn, 1.571), array=ASIDE)
        for turn in (step, -step)
    )
    slope = (far - near) / (2 * step)
    expected = np.hypot(accuracy.lag / np.sqrt(12), slope * azimuth)
    assert distance == pytest.approx(expected, rel=0.1)
    assert distance[1] > 1.3 * distance[0]


def test_an_error_of_all_headings_is_not_averaged():
    headings = np.random.default_rng(0).uniform(-np.pi, np.pi, 40)
    poses = np.tile([[0.3, 0.0]], (40, 1))
    rays = np.tile([[1.0, 0.0]], (40, 1))
    seen = Sightings(poses + 1.7 * rays, poses, headings, np.zeros(40), np.zeros(40))
    line = fit(seen.points, rays, members=np.arange(40))
    found = measured(line, seen, accuracy=Accuracy(heading_bias_sd=0.1))
    assert found.normal_sd == pytest.approx(0.1, 0.05)


def test_echoes_are_never_more_accurate_than_their_grids():
    burst = np.sin(np.arange(256) * 0.9) * np.hanning(256)
    probe = Probe(burst, 22050.0, 1000)
    accuracy = accuracy_of(probe, circular_array(), azimuths=90, speed_of_sound=340.0)
    assert (accuracy.lag, accuracy.azimuth) == (340 / 22050 / 2, 2 * np.pi / 90)
    scores = np.array([[1.0, -0.9, 0.3, 0.0]])
    sds = np.stack(accuracy.of_echoes(Echoes(scores, scores, *[scores] * 4)))[:, 0]
    floor = np.array([accuracy.lag, accuracy.azimuth]) / np.sqrt(12)
    assert sds[:, 0] == pytest.approx(floor)
    assert (np.diff(sds, axis=1) > 0).all() and np.isfinite(sds).all()


def test_noise_moves_the_time_of_an_echo_as_much_as_its_score_says():
    """The strongest correlation between samples, of a tone burst in white noise."""
    rng = np.random.default_rng(0)
    time = np.arange(200.0)

    def delayed(delay):
        return np.sin(0.9 * (time - delay)) * np.sin(np.pi * (time - delay) / 199) ** 2

    burst = delayed(0.0)
    accuracy = accuracy_of(
        Probe(burst, 1000.0, 400), circular_array(), azimuths=360, speed_of_sound=2000.0
    )
    fine = np.linspace(-2, 2, 401)
    shifted = np.array([delayed(shift) for shift in fine])
    level = 0.2
    noisy = burst + level * rng.standard_normal((500, 200))
    found = fine[(noisy @ shifted.T).argmax(axis=1)]
    score = np.mean(noisy @ burst / np.linalg.norm(noisy, axis=1) / np.linalg.norm(burst))
    noise = np.sqrt(1 - score**2) / score
    assert np.std(found) == pytest.approx(accuracy.distance_noise * noise, rel=0.2)
