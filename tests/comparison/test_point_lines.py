"""Lines through points: a wall that half of the poses hear, and chance."""

import numpy as np
import pytest

from echolearn.comparison.point_lines import hough_lines, ransac_lines

RNG = np.random.default_rng(2)
ANGLE = np.deg2rad(30.0)
NORMAL = np.array([np.cos(ANGLE), np.sin(ANGLE)])
ALONG = np.array([-NORMAL[1], NORMAL[0]])
POINTS = 5.0 * NORMAL + np.linspace(-2.0, 2.0, 40)[:, None] * ALONG
TOWARD = np.tile(NORMAL, (40, 1))


@pytest.mark.parametrize("draw", [hough_lines, ransac_lines])
def test_a_wall_is_the_line_of_most_votes_and_faces_the_robot(draw):
    chance = RNG.uniform(-6, 6, (40, 2))
    rays = RNG.normal(size=(40, 2))
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    found = draw(np.concatenate([POINTS, chance]), np.concatenate([TOWARD, rays]))
    best = int(found.score.argmax())
    assert found.lines[best] == pytest.approx([ANGLE, 5.0], abs=0.03)
    # Half of the poses hear it, and some strays may lie on it.
    assert 0.45 <= found.score[best] <= 0.6
    ends = np.sort(found.stretches[best, 0] @ ALONG)
    assert ends[0] <= -1.9 and ends[1] >= 1.9
    # Nothing else has many votes, and no wall is there twice.
    assert np.delete(found.score, best).max(initial=0.0) < 0.25


@pytest.mark.parametrize("draw", [hough_lines, ransac_lines])
def test_a_few_points_that_disagree_are_no_wall(draw):
    points = np.array([[0.0, 2.0], [3.0, 0.0], [0.0, -4.0]])
    found = draw(points, points / np.linalg.norm(points, axis=1, keepdims=True))
    assert len(found.score) == 0 and found.stretches.shape == (0, 1, 2, 2)


def test_the_other_side_of_a_line_is_another_wall():
    both = np.concatenate([TOWARD, -TOWARD])
    found = hough_lines(np.concatenate([POINTS, POINTS]), both)
    first = found.lines[found.score >= 0.4]
    assert len(first) == 2
    assert np.abs(np.sum(np.stack([np.cos(first[:, 0]), np.sin(first[:, 0])], 1), 0)).max() < 1e-9
