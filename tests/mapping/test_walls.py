"""Walls from points: known lines come back as certain as they claim, heaps and noise do not."""

import time
import tracemalloc

import numpy as np
import pytest

from echolearn.mapping.walls import GAP, SUPPORT, fit_lines


def wall(start, end, count, sd=0.0):
    """Return points along a wall that was seen from its left side, and the rays to them."""
    a, b = np.array(start), np.array(end)
    tangent = (b - a) / np.linalg.norm(b - a)
    normal = np.array([tangent[1], -tangent[0]])
    off = sd * RNG.standard_normal((count, 1))
    points = a + np.linspace(0, 1, count)[:, None] * (b - a) + off * normal
    return points, np.tile(normal, (count, 1))


def fitted(*walls):
    points, toward = (np.concatenate(part) for part in zip(*walls, strict=True))
    return fit_lines(points, toward)


def scattered(low, high, count):
    """Return points all over the place, seen from everywhere."""
    angle = RNG.uniform(-np.pi, np.pi, count)
    return RNG.uniform(low, high, (count, 2)), np.stack([np.cos(angle), np.sin(angle)], axis=1)


@pytest.fixture(autouse=True)
def fresh():
    """Let every test draw the same noise, whichever ran before."""
    global RNG
    RNG = np.random.default_rng(0)


def test_a_wall_without_noise_is_found_exactly():
    [line] = fitted(wall((1.0, 0.0), (5.0, 0.0), 20))
    assert np.allclose(sorted([line.start.tolist(), line.end.tolist()]), [[1, 0], [5, 0]])
    assert line.normal == pytest.approx(-np.pi / 2) and line.offset == pytest.approx(0, abs=1e-12)
    assert line.points == 20 and line.rms < 1e-12


def test_a_slanted_wall_has_its_hesse_form():
    """x + y = 6, seen from the origin's side: normal 45 degrees, offset 6 / sqrt 2."""
    [line] = fitted(wall((1.0, 5.0), (5.0, 1.0), 15))
    normal = line.normal if line.offset > 0 else line.normal + np.pi
    assert normal % (2 * np.pi) == pytest.approx(np.pi / 4)
    assert abs(line.offset) == pytest.approx(6 / np.sqrt(2))


def test_four_walls_of_a_room_and_stray_points_give_four_lines():
    corners = [(0.0, 0.0), (0.0, 4.0), (6.0, 4.0), (6.0, 0.0)]  # clockwise: seen from inside
    sides = [wall(corners[k - 1], corners[k], 25, 0.01) for k in range(4)]
    lines = fitted(*sides, scattered(1, 3, 12))
    assert sorted(round(abs(line.offset), 1) for line in lines) == [0.0, 0.0, 4.0, 6.0]
    assert {line.points for line in lines} <= {24, 25, 26}


def test_uncertainty_is_the_scatter_of_repeated_fits():
    lines = [fitted(wall((0.0, 0.0), (0.0, 3.0), 30, 0.02))[0] for _ in range(300)]
    offsets = [line.offset for line in lines]
    assert np.mean([line.offset_sd for line in lines]) == pytest.approx(np.std(offsets), rel=0.25)
    slopes = [np.divide(*(line.end - line.start)) for line in lines]
    assert np.mean([line.normal_sd for line in lines]) == pytest.approx(np.std(slopes), rel=0.25)


@pytest.mark.parametrize("gap", [GAP - 0.1, GAP + 0.1, 9.0])
@pytest.mark.parametrize(("beyond", "points"), [(8, [16]), (SUPPORT, [12]), (SUPPORT - 1, [8])])
def test_a_wall_heard_in_two_stretches_is_one(gap, beyond, points):
    """But few points beyond a gap are no stretch of it."""
    left = wall((0.0, 0.0), (0.0, 2.0), 8, 0.01)
    right = wall((0.0, 2.0 + gap), (0.0, 3.0 + gap), beyond, 0.01)
    near = [8 + beyond] if gap < GAP else points
    assert [line.points for line in fitted(left, right)] == near


def test_two_heaps_of_one_wall_are_one_although_each_hardly_tells_its_direction():
    here = np.array([2.0, 0.0]) + 0.005 * RNG.standard_normal((12, 2))
    there = np.array([2.0, 9.0]) + 0.005 * RNG.standard_normal((12, 2))
    rays = np.tile([np.cos(0.015), np.sin(0.015)], (24, 1))
    [line] = fit_lines(np.concatenate([here, there]), rays)
    assert line.normal == pytest.approx(0.0, abs=0.002) and line.points == 24


def test_a_wall_a_little_behind_another_is_another():
    near, behind = wall((0.0, 0.0), (0.0, 2.0), 12, 0.01), wall((0.13, 4.0), (0.13, 6.0), 10, 0.01)
    assert [line.points for line in fitted(near, behind)] == [12, 10]


def test_ten_thousand_points_take_no_quadratic_time_or_memory():
    """Of a table of all pairs, one byte each would be 100 MB."""
    corners = [(0.0, 0.0), (0.0, 30.0), (40.0, 30.0), (40.0, 0.0)]
    sides = [wall(corners[k - 1], corners[k], 2250, 0.01) for k in range(4)]
    points, toward = (
        np.concatenate(part) for part in zip(*sides, scattered(1, 29, 1000), strict=True)
    )
    tracemalloc.start()
    began = time.process_time()
    lines = fit_lines(points, toward)
    seconds = time.process_time() - began
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(lines) == 4 and min(line.points for line in lines) >= 2250
    assert seconds < 5 and peak < 50e6


def test_two_sides_of_one_partition_are_two_walls():
    one, other = fitted(wall((0.0, 0.0), (0.0, 3.0), 10), wall((0.05, 3.0), (0.05, 0.0), 10))
    assert np.cos(one.normal - other.normal) == pytest.approx(-1)


def test_a_robot_that_stands_still_finds_a_heap_whose_wall_its_rays_tell():
    points = np.array([2.0, 1.0]) + 0.01 * RNG.standard_normal((10, 2))
    [line] = fit_lines(points, np.tile([1.0, 0.0], (10, 1)))
    assert line.normal == pytest.approx(0.0) and line.offset == pytest.approx(2.0, abs=0.02)


def test_few_points_and_none_are_no_wall():
    assert fit_lines(np.empty((0, 2)), np.empty((0, 2))) == []
    assert fitted(wall((0.0, 0.0), (3.0, 0.0), SUPPORT - 1)) == []
    assert fitted(scattered(0, 50, 40)) == []
