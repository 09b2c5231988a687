"""Evidence over poses: against literal loops, and against what poses and their errors must do."""

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow
from echolearn.walls import evidence, evidence_loops
from echolearn.walls.evidence import (
    exact_evidence,
    forgiving,
    forgiving_evidence,
    grid_of,
    soft,
    soft_evidence,
    summed,
)
from heard_walks import RATE, SPEED, heard, wandering
from interpreted import interpret

NARROW = SearchWindow(1.0, 1.2)
WALL = (0.0, 4.8, -9.0, 9.0)


@pytest.fixture(scope="module")
def few():
    """Return 4 poses in a corner, and a coarse grid."""
    walk = heard([WALL], wandering(4, low=(3.5, 0.0), high=(3.8, 0.3)), window=NARROW)
    return walk, grid_of(walk, degrees=15.0, step=0.05)


def literal(walk, grid, look):
    """Return H and N, cell by cell: `look` tells what a pose has of a direction and a distance."""
    values, counts = np.zeros((2, grid.normals, grid.offsets))
    for t, theta in enumerate(grid.theta):
        normal = np.array([np.cos(theta), np.sin(theta)])
        for r, rho in enumerate(grid.rho):
            total = 0.0
            for pose, (x, y, heading) in enumerate(walk.poses):
                distance = rho - normal @ (np.array([x, y]) - grid.origin)
                if walk.window.nearest <= distance <= walk.window.farthest:
                    total += look(pose, theta - heading, distance)
                    counts[t, r] += 1
            values[t, r] = total / np.sqrt(max(counts[t, r], 1))
    return values, counts


def series(walk):
    """Return what reads J exactly: sums of Fourier series over the root mean square of a pose."""
    size = walk.outputs.shape[-1]
    omega = 2.0 * np.pi * np.fft.fftfreq(size)
    spectra = np.fft.fft(walk.outputs)

    def at(pose, azimuth, distance):
        image = 2.0 * distance * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        late = np.linalg.norm(image - walk.array.positions, axis=1) / SPEED * RATE - walk.first
        return (spectra[pose] * np.exp(1j * omega * late[:, None])).real.sum() / size

    scale = [
        np.sqrt(np.mean([at(pose, a, d) ** 2 for a in walk.azimuths for d in walk.distances]))
        for pose in range(len(walk.poses))
    ]
    return lambda pose, azimuth, distance: at(pose, azimuth, distance) / scale[pose]


@pytest.fixture(scope="module")
def exactly(few):
    """Return H and N of the literal loop over Fourier series."""
    walk, grid = few
    return literal(walk, grid, series(walk))


@pytest.mark.parametrize("compiled", [True, False])
def test_exact_evidence_is_within_a_thousandth_of_the_literal_loop(few, exactly, compiled):
    walk, grid = few
    found = exact_evidence(walk, grid, compiled=compiled)
    values, counts = exactly
    assert np.array_equal(found.counts, counts) and counts.max() == 4
    assert np.abs(found.values - values).max() <= 1e-3 * values.max()


def test_as_python_the_loops_sum_the_same(few, exactly, monkeypatch):
    interpret(evidence_loops, monkeypatch)
    walk, grid = few
    assert np.abs(exact_evidence(walk, grid).values - exactly[0]).max() <= 1e-3 * exactly[0].max()
    z = forgiving(walk.responses, width=2)
    tabled = summed(walk, grid, z=z), summed(walk, grid, z=z, compiled=False)
    assert np.array_equal(tabled[0].counts, tabled[1].counts)
    assert (np.abs(tabled[0].values - tabled[1].values) < 1e-4).mean() > 0.99


@pytest.mark.parametrize("compiled", [True, False])
def test_tabled_evidence_is_what_each_pose_has_nearest(few, compiled):
    walk, grid = few
    z = forgiving(walk.responses, width=2)

    def nearest(pose, azimuth, distance):
        turn = np.abs((walk.azimuths - azimuth + np.pi) % (2.0 * np.pi) - np.pi)
        return z[pose, turn.argmin(), np.abs(walk.distances - distance).argmin()]

    values, counts = literal(walk, grid, nearest)
    found = summed(walk, grid, z=z, compiled=compiled)
    assert np.array_equal(found.counts, counts)
    # Where two entries are equally near, rounding may take the other one.
    assert (np.abs(found.values - values) < 1e-4).mean() > 0.99


def test_without_numba_numpy_says_the_same(few, monkeypatch):
    walk, grid = few
    compiled = exact_evidence(walk, grid)
    monkeypatch.setattr(evidence, "find_spec", lambda name: None)
    evidence._loops.cache_clear()
    assert evidence._loops() is None
    assert np.allclose(exact_evidence(walk, grid).values, compiled.values, atol=1e-3)
    evidence._loops.cache_clear()


def test_forgiving_is_the_largest_nearby_in_standard_deviations():
    responses = np.random.default_rng(0).standard_normal((1, 8, 12)).astype(np.float32)
    z = forgiving(responses, width=1)[0]
    largest = np.empty((8, 12))
    for a in range(8):
        for d in range(12):
            columns = responses[0][:, max(d - 1, 0) : d + 2]
            largest[a, d] = columns[[a - 1, a, (a + 1) % 8]].max()
    assert np.allclose(z, (largest - largest.mean()) / largest.std(), atol=1e-5)


def test_soft_evidence_of_exact_places_grows_with_the_response():
    responses = np.random.default_rng(0).standard_normal((1, 8, 12)).astype(np.float32)
    order = responses.ravel().argsort()
    assert (np.diff(soft(responses, blur=0.1).ravel()[order]) >= 0).all()


def test_poses_whose_places_are_known_add_up():
    """The peak of a wall is sqrt(N) times what one pose has there, and lies where the wall is."""
    poses = wandering(40, low=(3.0, 0.0), high=(3.6, 3.0))
    walk = heard([WALL], poses, amplitude=0.8)
    found = exact_evidence(walk, grid_of(walk))
    row, column = np.unravel_index(found.values.argmax(), found.values.shape)
    offset = found.grid.rho[column] + found.grid.origin[0]
    assert (found.grid.theta[row], offset) == pytest.approx((0.0, 4.8), abs=0.011)

    each = walk.at(pose=np.arange(40), azimuth=-poses[:, 2], distance=4.8 - poses[:, 0])
    assert found.counts[row, column] == 40
    assert found.values[row, column] == pytest.approx(np.sqrt(40) * each.mean(), rel=0.05)


LOOKS = [(forgiving_evidence, {"width": 6}), (soft_evidence, {"blur": 0.03})]


@pytest.mark.parametrize("look", LOOKS)
def test_what_forgives_finds_walls_where_poses_are_wrong(look):
    """3 cm of error: the wall is the highest peak, where exact poses would see none."""
    poses = wandering(60, low=(3.0, 0.0), high=(3.6, 3.0))
    rng = np.random.default_rng(2)
    told = poses + rng.standard_normal(poses.shape) * (0.03, 0.03, 0.015)
    walk = heard([WALL], poses, amplitude=1.5, told=told)
    grid = grid_of(walk)
    function, how = look
    found, exact = function(walk, grid, **how), exact_evidence(walk, grid)
    near = np.abs(grid.theta)[:, None] < 0.035
    near = near & (np.abs(grid.rho + grid.origin[0] - 4.8) < 0.05)
    assert found.values[near].max() == found.values.max()
    contrast = [each.values[near].max() / each.values[~near].max() for each in (found, exact)]
    assert contrast[0] > 1.1 * contrast[1]


def test_turning_the_world_turns_the_evidence():
    poses = wandering(5, low=(3.5, 0.0), high=(3.8, 0.3))
    theta = np.deg2rad(30.0)
    cos, sin = np.cos(theta), np.sin(theta)
    turned = np.column_stack([poses[:, :2] @ [[cos, sin], [-sin, cos]], poses[:, 2] + theta])
    walk = heard([WALL], poses, window=NARROW)
    other = heard([WALL], poses, window=NARROW, told=turned)
    grid = grid_of(walk, degrees=15.0, step=0.05)
    middle = np.array(grid.origin) @ [[cos, sin], [-sin, cos]]
    rotated = type(grid)(grid.normals, grid.low, grid.step, grid.offsets, tuple(middle))
    first, second = exact_evidence(walk, grid), exact_evidence(other, rotated)
    assert np.allclose(np.roll(first.values, 2, axis=0), second.values, atol=1e-3)
