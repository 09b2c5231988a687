"""Responses steered to mirror images: against sums over a Fourier series, and against geometry."""

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import MicArray
from echolearn.walls.walk import HeardWalk, lags_needed
from heard_walks import RATE, RING, SPEED, heard, wandering
from refusals import refused

NARROW = SearchWindow(1.0, 1.25)
ODD = MicArray(np.array([[0.1, 0.05, 0.02], [-0.05, 0.15, -0.1], [0.2, -0.1, 0.0]]))
"""Microphones whose middle is not the loudspeaker."""


def literal(walk, pose, azimuth, distance):
    """Return the sum over microphones of one pose, each read from its Fourier series."""
    image = 2.0 * distance * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    total = 0.0
    for outputs, place in zip(walk.outputs[pose], walk.array.positions, strict=True):
        late = np.linalg.norm(image - place) / SPEED * RATE - walk.first
        spectrum = np.fft.fft(outputs)
        omega = 2.0 * np.pi * np.fft.fftfreq(len(outputs))
        total += (spectrum * np.exp(1j * omega * late)).real.sum() / len(outputs)
    return total


@pytest.mark.parametrize("array", [RING, ODD])
def test_responses_are_the_sums_over_microphones_at_exact_times(array):
    walk = heard([], wandering(2), window=NARROW, array=array)
    rng = np.random.default_rng(3)
    pose, azimuth = rng.integers(2, size=200), rng.uniform(-4.0, 4.0, 200)
    distance = rng.uniform(1.0, 1.25, 200)
    found = walk.at(pose=pose, azimuth=azimuth, distance=distance)
    exact = [literal(walk, *each) for each in zip(pose, azimuth, distance, strict=True)]
    directions = walk.azimuths[::20]
    table = [[literal(walk, 0, toward, away) for away in walk.distances] for toward in directions]
    here = pose == 0
    # One factor for a pose: its root mean square, of which some of the directions tell.
    factor = float(np.array(exact)[here] @ found[here] / (found[here] @ found[here]))
    assert np.allclose(np.array(exact)[here], factor * found[here], atol=2e-3 * factor)
    assert factor == pytest.approx(np.sqrt(np.mean(np.square(table))), rel=0.2)


def test_each_pose_has_its_own_scale():
    walk = heard([], wandering(3), window=NARROW)
    assert np.square(walk.responses).mean(axis=(1, 2)) == pytest.approx([1.0] * 3, rel=1e-5)
    louder = HeardWalk(walk.outputs * [[[1.0]], [[50.0]], [[0.0]]], *list(vars(walk).values())[1:6])
    assert np.allclose(louder.responses[1], walk.responses[1], atol=1e-4)
    assert not louder.responses[2].any()


def test_an_echo_is_where_its_wall_is_from_every_heading():
    """A wall 1.4 m to the north, the robot turned by 70 degrees: seen 20 degrees to its left."""
    heading = np.deg2rad(70.0)
    walk = heard([(np.pi / 2, 3.0, -9, 9)], [(5.0, 1.6, heading)], amplitude=50.0)
    row, column = np.unravel_index(walk.responses[0].argmax(), walk.responses[0].shape)
    assert walk.azimuths[row] == pytest.approx(np.deg2rad(20.0), abs=np.deg2rad(1.0))
    assert walk.distances[column] == pytest.approx(1.4, abs=walk.step)


def test_lines_are_seen_at_their_distance():
    walk = heard([], [(1.0, 2.0, 0.3), (4.0, 2.0, -0.2)])
    azimuth, distance, inside = walk.seen(np.array([0.0, np.pi]), np.array([5.2, 0.0]))
    assert distance == pytest.approx(np.array([[4.2, 1.2], [1.0, 4.0]]))
    assert inside.tolist() == [[False, True], [True, False]]
    assert azimuth == pytest.approx(np.array([[-0.3, 0.2], [np.pi - 0.3, np.pi + 0.2]]))


def test_no_microphone_reads_beyond_the_lags_that_are_kept():
    first, last = lags_needed(NARROW, ODD, sample_rate=RATE, speed_of_sound=SPEED)
    away = np.linalg.norm(ODD.positions, axis=1)
    assert first <= ((2.0 - away) / SPEED * RATE).min() - 1
    assert last >= ((2.5 + away) / SPEED * RATE).max() + 1


@pytest.mark.parametrize(("name", "value"), [("outputs", np.zeros((1, 6, 9))), ("poses", [[1, 2]])])
def test_a_walk_that_does_not_fit_together_is_refused(name, value):
    walk = heard([], wandering(1), window=NARROW)
    fields = {key: vars(walk)[key] for key in ("outputs", "poses", "window", "array")}
    with refused(f"walk.{name}="):
        HeardWalk(**fields | {name: np.array(value)}, sample_rate=RATE)
