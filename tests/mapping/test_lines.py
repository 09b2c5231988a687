"""Walls from points: known lines come back, as certain as they claim, and heaps and noise do not
become walls."""

import numpy as np
import pytest

from echolearn.mapping.walls import GAP, SUPPORT, Line, fit_lines


def wall(
    start: tuple[float, float],
    end: tuple[float, float],
    *,
    count: int,
    sd: float = 0.0,
    seed: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Return points along a wall that was heard from its left side, and the directions they were
    heard toward."""
    rng = np.random.default_rng(seed)
    a, b = np.array(start), np.array(end)
    tangent = (b - a) / np.linalg.norm(b - a)
    normal = np.array([tangent[1], -tangent[0]])
    points = (
        a
        + np.linspace(0, 1, count)[:, None] * (b - a)
        + sd * rng.standard_normal((count, 1)) * normal
    )
    return points, np.tile(normal, (count, 1))


def both(*walls: tuple[np.ndarray, np.ndarray]) -> list[Line]:
    return fit_lines(np.concatenate([w[0] for w in walls]), np.concatenate([w[1] for w in walls]))


def test_a_wall_without_noise_is_found_exactly() -> None:
    [line] = both(wall((1.0, 0.0), (5.0, 0.0), count=20))
    ends = sorted([line.start.tolist(), line.end.tolist()])
    assert np.allclose(ends, [[1, 0], [5, 0]])
    assert line.normal == pytest.approx(-np.pi / 2) and line.offset == pytest.approx(0.0, abs=1e-12)
    assert line.points == 20 and line.rms < 1e-12


def test_a_slanted_wall_has_its_hesse_form() -> None:
    """x + y = 6, heard from the origin's side: normal 45 degrees, offset 6 / sqrt 2."""
    [line] = both(wall((1.0, 5.0), (5.0, 1.0), count=15)[::1])
    normal = line.normal if line.offset > 0 else line.normal + np.pi
    assert normal % (2 * np.pi) == pytest.approx(np.pi / 4)
    assert abs(line.offset) == pytest.approx(6 / np.sqrt(2))


def test_four_walls_of_a_room_and_stray_points_give_four_lines() -> None:
    corners = [(0.0, 0.0), (0.0, 4.0), (6.0, 4.0), (6.0, 0.0)]  # clockwise: heard from inside
    sides = [wall(corners[k - 1], corners[k], count=25, sd=0.01, seed=k) for k in range(4)]
    rng = np.random.default_rng(5)
    angle = rng.uniform(-np.pi, np.pi, 12)
    strays = rng.uniform((1, 1), (5, 3), (12, 2)), np.stack([np.cos(angle), np.sin(angle)], axis=1)
    lines = both(*sides, strays)
    assert len(lines) == 4
    assert sorted(round(abs(line.offset), 1) for line in lines) == [0.0, 0.0, 4.0, 6.0]
    assert all(line.points in (24, 25, 26) for line in lines)


def test_uncertainty_is_the_scatter_of_repeated_fits() -> None:
    lines = [
        both(wall((0.0, 0.0), (0.0, 3.0), count=30, sd=0.02, seed=seed))[0] for seed in range(300)
    ]
    flipped = [1 if abs(line.normal) > np.pi / 2 else -1 for line in lines]
    offsets = np.array([line.offset * sign for line, sign in zip(lines, flipped, strict=True)])
    centres = np.array([(line.start + line.end)[0] / 2 for line in lines])
    assert np.mean([line.offset_sd for line in lines]) == pytest.approx(centres.std(), rel=0.25)
    angles = np.array([np.arctan2(*(line.end - line.start)[::1]) % np.pi for line in lines])
    angles = np.minimum(angles, np.pi - angles)
    assert np.mean([line.normal_sd for line in lines]) == pytest.approx(
        np.sqrt(np.mean(angles**2)), rel=0.25
    )
    assert len(offsets) == 300


def test_a_gap_ends_a_wall() -> None:
    left, right = wall((0.0, 0.0), (0.0, 2.0), count=8), wall((0.0, 2.1 + GAP), (0.0, 6.0), count=8)
    assert [line.points for line in both(left, right)] == [8, 8]
    near = wall((0.0, 1.9 + GAP), (0.0, 6.0), count=8)
    assert [line.points for line in both(left, near)] == [16]


def test_two_sides_of_one_partition_are_two_walls() -> None:
    lines = both(wall((0.0, 0.0), (0.0, 3.0), count=10), wall((0.05, 3.0), (0.05, 0.0), count=10))
    assert len(lines) == 2 and np.cos(lines[0].normal - lines[1].normal) == pytest.approx(-1)


def test_a_robot_that_stands_still_hears_a_heap_whose_wall_its_rays_tell() -> None:
    rng = np.random.default_rng(0)
    points = np.array([2.0, 1.0]) + 0.01 * rng.standard_normal((10, 2))
    [line] = fit_lines(points, np.tile([1.0, 0.0], (10, 1)))
    assert line.normal == pytest.approx(0.0) and line.offset == pytest.approx(2.0, abs=0.02)


def test_few_points_and_none_are_no_wall() -> None:
    assert fit_lines(np.empty((0, 2)), np.empty((0, 2))) == []
    assert both(wall((0.0, 0.0), (3.0, 0.0), count=SUPPORT - 1)) == []
    scattered = np.random.default_rng(1).uniform(0, 50, (40, 2))
    angle = np.random.default_rng(2).uniform(-np.pi, np.pi, 40)
    assert fit_lines(scattered, np.stack([np.cos(angle), np.sin(angle)], axis=1)) == []
