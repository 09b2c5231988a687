"""The paper's figures, and what its grid hides: see `docs/paper.md` for what each one means.

Plans and scene are those of `conf`, with the fast engine. Times need microphone 1 alone, which
makes hundreds of observations a matter of seconds. Where a share was counted before, in so many
trials, it is compared within three standard deviations of the difference of two such counts.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from scipy.stats import binomtest

from echolearn.acoustics.rooms import outline, true_echoes
from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Array, MicArray, Observation, Pose, Room
from echolearn.classifiers.classifier import Examples
from echolearn.classifiers.methods.svm import Svm
from echolearn.cli.compose import compose
from echolearn.cli.config import build
from echolearn.evaluation import metrics
from echolearn.evaluation.coverage import attainable
from echolearn.localization.features import peak_columns
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.joint import Joint
from echolearn.localization.methods.snls import Snls
from echolearn.mapping.echo_map import echo_map
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.observe import add_noise
from echolearn.simulation.walk import trajectory

RATE = 22050.0


def configured(name):
    """Return a plan as configured."""
    [(_, config)] = compose("generate", [f"plan={name}", "rir=images"])
    return build(config["plan"], "plan")


class Estimates(NamedTuple):
    """What S-NLS finds with microphone 1: (B, L) for L levels; the positions' groups (B,)."""

    toa: Array
    peak_to_rms: Array
    reflector: Array
    group: Array


def estimate(plan, rows, *, snr_db=()):
    """Estimate the TOA of rows of a plan at its own SNRs, or each row at all of `snr_db`."""
    single = MicArray(plan.scene.array.positions[:1])
    scene = replace(plan.scene, array=single)
    found = []
    for row in rows:
        rng = stream(plan.seed, "observation", int(row))
        spot = plan.spot(int(row), rng)
        received = scene.received(spot.room, spot.pose)
        levels = [NoiseLevels(level) for level in snr_db] or [spot.levels]
        samples = [
            add_noise(received, scene, levels=level, gain_db=spot.gain_db, rng=rng)
            for level in levels
        ]
        view = MatchedFilter(Observation(np.stack(samples), scene.probe, single), plan.window)
        toa = view.toa(view.strongest).ravel()
        peak = peak_columns(view.correlation[:, 0], view.strongest)["peak_to_rms"].ravel()
        late = np.abs(toa[:, None] * RATE - true_lags(plan, spot.room, spot.pose))
        found.append((toa, peak, late.min(axis=1) < 10, spot.group))
    return Estimates(*map(np.array, zip(*found, strict=True)))


def true_lags(plan, room, pose):
    """Return the true times of arrival in samples, shape (W,)."""
    return true_echoes(room, pose, array=plan.scene.array).toa * RATE


@pytest.fixture(scope="module")
def paper():
    """Return the paper's grid."""
    return configured("paper")


@pytest.fixture(scope="module")
def grid_lags(paper):
    """Return the true times of arrival at every position of the grid, (positions, W), samples."""
    return np.array([true_lags(paper, paper.room, Pose(place)) for place in paper.positions])


@pytest.fixture(scope="module")
def on_grid(paper):
    """Return the estimates of every row of `paper`."""
    return estimate(paper, range(len(paper)))


def agrees(share, expected, *, trials):
    """Tell whether two counted shares agree within three standard deviations."""
    spread = np.sqrt(expected * (1 - expected) * 2 / trials)
    return bool(abs(share - expected) <= 3 * spread)


# ---------------------------------------------------------------- the grid


def test_two_readings_give_1989_rows(paper):
    assert len(paper) == len(configured("paper_planar")) == 1989


def test_the_authors_window_is_116_to_244(paper):
    assert paper.window.lags(paper.scene.array, RATE) == (116, 244)


def test_71_percent_of_the_grid_have_a_wall_in_the_window(grid_lags):
    """A wall 1.0 m ahead of microphone 1 comes at (2 - 0.2) fs / c = 115.7: inside once rounded, as
    the window is. So the share of literal times is smaller than that of rounded ones."""
    inside = [(lags >= 116) & (lags <= 244) for lags in (grid_lags, grid_lags.round())]
    literal, rounded = (each.any(axis=1).mean() for each in inside)
    assert literal == pytest.approx(0.683, abs=0.001)
    assert rounded == pytest.approx(0.729, abs=0.001)


def test_only_three_wall_distances_ever_fall_into_the_window(paper, grid_lags):
    """A time of arrival says which wall it is, and a classifier can learn these few by heart."""
    near, size = paper.positions, np.array(paper.room.size)
    walls = np.stack([near, size - near], axis=-1).reshape(len(near), 6)
    inside = (grid_lags.round() >= 116) & (grid_lags.round() <= 244)
    assert np.unique(walls[inside].round(6)).tolist() == [1.0, 1.5, 2.0]


def test_a_random_time_is_labelled_a_reflector_in_13_percent(grid_lags):
    """Over all positions and lags, without drawing any."""
    late = np.abs(grid_lags[:, :, None] - np.arange(116, 245))
    assert (late < 10).any(axis=1).mean() == pytest.approx(0.13, abs=0.01)


# ---------------------------------------------------------------- times of arrival

SHARES = {40.0: 0.71, 0.0: 0.71, -5.0: 0.69, -10.0: 0.48, -20.0: 0.20, -40.0: 0.16}


@pytest.fixture(scope="module")
def by_snr(paper):
    """Return which of a random third of the grid are reflectors, at every SNR."""
    rows = np.random.default_rng(0).permutation(len(paper))[:663]
    return estimate(paper, rows.tolist(), snr_db=[*SHARES]).reflector


@pytest.mark.parametrize("column", range(len(SHARES)), ids=str)
def test_s_nls_is_right_as_often_as_counted_before(by_snr, column):
    assert agrees(by_snr[:, column].mean(), [*SHARES.values()][column], trials=663)


def test_s_nls_is_never_better_in_more_noise(by_snr):
    """Nor does quiet help beyond 0 dB: the rest has no wall in the window. In pure noise it is
    chance."""
    shares = by_snr.mean(axis=0)
    assert (np.diff(shares) <= 0.01).all()
    assert shares[0] == pytest.approx(shares[1], abs=0.01)
    counted = binomtest(int(by_snr[:, -1].sum()), 663)
    assert counted.proportion_ci(0.997, method="wilson").low <= 0.138


def test_half_of_the_paper_set_are_reflectors(on_grid):
    assert on_grid.reflector.shape == (1989, 1)
    assert agrees(on_grid.reflector.mean(), 0.53, trials=1989)


def test_a_third_of_the_planar_set_are_reflectors():
    """Counted by position, by three of the nine rows of each of the 221."""
    plan = configured("paper_planar")
    found = estimate(plan, range(0, len(plan), 3))
    groups, member = np.unique(found.group, return_inverse=True)
    shares = np.bincount(member, weights=found.reflector[:, 0]) / np.bincount(member)
    assert len(groups) == 221
    assert shares.mean() == pytest.approx(0.36, abs=3 * shares.std() / np.sqrt(221))


# ---------------------------------------------------------------- what the grid hides

ROOMS = ("offgrid_10x8x6", "offgrid_8x6x5")


@pytest.fixture(scope="module", params=ROOMS)
def off_grid(request):
    """Return estimates at random positions: in the training room, and in one never trained on."""
    return estimate(configured(request.param), range(400))


@pytest.fixture(scope="module")
def memory(on_grid, tmp_path_factory):
    """Return an SVM on the TOA alone, trained on 80 % of the grid, and the rows it never saw."""
    rows = np.random.default_rng(0).permutation(len(on_grid.toa))
    train, held = rows[398:], rows[:398]
    svm = Svm(inputs=("toa",), c_grid=(10.0,), gamma_grid=(100.0, 1000.0), folds=3)
    x, y = on_grid.toa.astype(np.float32), on_grid.reflector[:, 0]
    folder = tmp_path_factory.mktemp("svm")
    unseen = (x[held], y[held])
    svm.fit(Examples(x[train], y[train], train, unseen, folder=folder, seed=0))
    return svm, held


def auc(found, belief, rows=slice(None)):
    return float(metrics.auc(found.reflector[rows, 0], belief[rows]))


def test_on_the_grid_the_time_alone_tells_reflectors(on_grid, memory):
    svm, held = memory
    assert 0.85 < auc(on_grid, svm.decision(on_grid.toa.astype(np.float32)), held) < 0.97


def test_off_the_grid_it_tells_nothing(off_grid, memory):
    """Not even in the very room that it was trained in."""
    assert auc(off_grid, memory[0].decision(off_grid.toa.astype(np.float32))) < 0.6


def test_how_far_the_peak_stands_out_tells_it_everywhere(on_grid, off_grid):
    here, there = (auc(found, found.peak_to_rms[:, 0]) for found in (on_grid, off_grid))
    assert here == pytest.approx(0.92, abs=0.04)
    assert there == pytest.approx(0.905, abs=0.05)
    assert abs(here - there) < 0.06


# ---------------------------------------------------------------- the map

ROOM = Room((8.0, 6.0, 5.0), 0.6)
WALK = trajectory(ROOM)


@pytest.fixture(scope="module")
def walked():
    """Return the robot, and what it receives along the default walk before any noise."""
    scene = configured("paper").scene
    return scene, [scene.received(ROOM, pose) for pose in WALK]


@pytest.mark.parametrize(
    ("localizer", "snr_db", "low", "high"),
    [
        (Snls, 40.0, 0.85, 1.1),
        (Snls, 0.0, 0.25, 0.65),
        (Snls, -5.0, 0.08, 0.30),
        (Snls, -10.0, 0.02, 0.22),
        (Gated, 40.0, 0.95, 1.15),
        (Gated, 0.0, 0.93, 1.15),
        (Gated, -5.0, 0.85, 1.08),
        (Gated, -10.0, 0.38, 0.65),
        (Joint, -10.0, 0.85, 1.05),
    ],
)
def test_the_papers_direction_loses_the_map_that_the_gated_one_keeps(
    walked, localizer, snr_db, low, high
):
    """Shares of map points within 0.10 m of a wall, of those that the walk could give.

    At 0 dB it depends on the walk: whole-recording MPDR loses a wall fast with its distance (right
    in 45 % of trials at 1.05 m, 25 % at 1.2 m, 10 % at 1.5 m). Points may be true by luck, so a
    share may exceed what is attainable.
    """
    scene, received = walked
    samples = [
        add_noise(
            each,
            scene,
            levels=NoiseLevels(snr_db),
            rng=np.random.default_rng([round(snr_db + 100), index]),
        )
        for index, each in enumerate(received)
    ]
    found = localizer()(Observation(np.stack(samples), scene.probe, scene.array))
    points = echo_map(found, WALK, array=scene.array).points
    true = distance_to_outline(points, outline(ROOM)) <= 0.10
    places = np.array([pose.position[:2] for pose in WALK])
    assert low <= true.mean() / attainable(outline(ROOM), places) <= high
