"""Each estimator against its equations loop by loop, and what it can that others cannot."""

from dataclasses import replace

import numpy as np
import pytest

import reference
from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import MicArray, Observation
from echolearn.bench import equations
from echolearn.localization import estimates, relax
from echolearn.localization.beamforming import azimuth_grid
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.methods.em import Em
from echolearn.localization.methods.gated import gated_mpdr
from echolearn.localization.methods.joint import Joint
from echolearn.localization.methods.mclam import Mclam, detected
from echolearn.localization.methods.peaks import Peaks, highest
from echolearn.localization.methods.snls import Snls
from echolearn.localization.search import Peak, joint_search, reference_search
from reference import FIRST, RATE, RING, loops, observed, turn, wave, white

PROBE = noise_probe(burst=400, length=3000)
WINDOW = SearchWindow()
GRID = azimuth_grid(24)
NOISY = [
    wave(PROBE, 0.5, 180) + white(PROBE, 0.3),
    wave(PROBE, -2.0, 240.4) + white(PROBE, 0.5, 1),
    white(PROBE, 1.0, 2),
]
TWO = wave(PROBE, GRID[14], 180) + wave(PROBE, GRID[3], 215, 0.07)
BOTH = [TWO + white(PROBE, level, 3) for level in (0.02, 0.1)]


def view(*samples, azimuths=24):
    return MatchedFilter(observed(PROBE, *samples), WINDOW, azimuths)


# ---------------------------------------------------------------- the equations


ORACLES = {
    "snls": (Snls(), equations.snls, ("lag", "gain")),
    "mclam": (Mclam(azimuths=24), equations.mclam, ("lag", "azimuth")),
    "rir_pp": (Peaks(azimuths=24), lambda loop: [equations.peaks(loop, 0.0)], ("lag",)),
    "loaded": (
        Peaks(azimuths=24, loading=0.1),
        lambda loop: [equations.peaks(loop, 0.1)],
        ("lag",),
    ),
}


@pytest.mark.parametrize(("localizer", "oracle", "names"), ORACLES.values(), ids=ORACLES)
def test_estimators_are_their_loops(localizer, oracle, names):
    rows = [*NOISY, wave(PROBE, 0.5, 180) + white(PROBE, 3.0, 3)]
    echoes = localizer(observed(PROBE, *rows))
    columns = vars(echoes) | {"lag": echoes.toa * RATE}
    for row, y in enumerate(rows):
        found = [columns[name][row, 0] for name in names]
        assert found == pytest.approx(list(oracle(loops(PROBE, y, GRID))))


def test_joint_is_the_loop_over_directions_microphones_and_lags():
    """Noise at the ends of the padded window makes the largest difference, 5 % of the peak."""
    found = view(*NOISY).steered[:, :-1]
    coarse = Joint(azimuths=24, refine=False)(observed(PROBE, *NOISY))
    for row, y in enumerate(NOISY):
        expected = equations.joint(loops(PROBE, y, GRID))
        assert np.abs(found[row] - expected).max() < 0.05 * expected.max()
        angle, lag = np.unravel_index(expected.argmax(), expected.shape)
        if coarse.elevation[row, 0] > 0:
            assert coarse.toa[row, 0] * RATE == pytest.approx(FIRST + lag)
            assert coarse.azimuth[row, 0] == pytest.approx(GRID[angle])
    assert (coarse.elevation[:2] > 0).all()


def test_em_with_one_component_is_one_search_however_often_it_iterates():
    weights = np.array([1.0, 0.5, 2.0, 1.0, 0.1, 1.0])
    psd = np.outer(1 / weights, np.ones(9))
    found = Em(azimuths=24, refine=False)(observed(PROBE, NOISY[1], noise_psd=psd))
    for iterations in (1, 3):
        case = loops(PROBE, NOISY[1], GRID)
        [expected] = reference.em(case, weights=weights, iterations=iterations)
        lag, azimuth, gain = expected
        assert found.toa[0, 0] * RATE == pytest.approx(lag)
        assert found.azimuth[0, 0] == pytest.approx(azimuth)
        assert found.gain[0, 0] == pytest.approx(gain, rel=0.04)


def test_gated_mpdr_is_its_definition():
    matched = view(NOISY[0])
    index = matched.strongest
    lag = FIRST + int(index[0])
    expected = []
    for azimuth in GRID:
        ahead = loops(PROBE, NOISY[0], GRID).ahead(azimuth)
        gate = range(lag - 2, lag + 3)
        z = np.array([[y[k : k + 400] @ PROBE.samples for k in gate] for y in ahead])
        covariance = z @ z.T
        loaded = 0.9 * covariance + 0.1 * np.trace(covariance) / 6 * np.eye(6)
        expected.append(1 / np.linalg.inv(loaded).sum())
    found = gated_mpdr(matched, index)[0, :-1]
    assert np.allclose(found, expected, rtol=0.1)
    assert found.argmax() == np.argmax(expected)


# ---------------------------------------------------------------- several echoes


@pytest.mark.parametrize("count", [2, 3])
def test_relax_is_its_loop(count):
    matched = view(*BOTH)
    peaks = np.array(relax.relax(reference_search(matched, refine=False), count))
    for row, y in enumerate(BOTH):
        expected = reference.relax(loops(PROBE, y, GRID), echoes=count)
        found = [(peak[0] + FIRST, peak[3]) for peak in peaks[..., row]]
        assert np.allclose(sorted(found, key=lambda one: -one[1]), expected, rtol=1e-3)


def test_em_is_its_loop_from_the_same_starts():
    """Two components, four iterations; the starts have wrong gains, which EM mends step by step."""
    starts = [(180.0, float(GRID[14]), 0.05), (215.0, float(GRID[3]), 0.1)]
    begin = [
        Peak(*(np.full(2, value) for value in (lag - FIRST, azimuth, np.pi / 2, gain, 1.0)))
        for lag, azimuth, gain in starts
    ]
    found = relax.expect_maximize(joint_search(view(*BOTH), refine=False), begin, iterations=4)
    for row, y in enumerate(BOTH):
        expected = reference.em(loops(PROBE, y, GRID), starts=starts, iterations=4)
        for peak, (lag, azimuth, gain) in zip(found, expected, strict=True):
            assert peak.lag[row] + FIRST == pytest.approx(lag)
            assert peak.azimuth[row] == pytest.approx(azimuth)
            assert peak.gain[row] == pytest.approx(gain, rel=0.02)


@pytest.mark.parametrize("kind", [Joint, Em])
def test_echoes_that_reach_microphone_1_together_are_resolved(kind):
    """A robot that looks into a corner: both walls at once, from 45 degrees left and right."""
    samples = wave(PROBE, 0.8, 190) + wave(PROBE, -0.8, 190) + white(PROBE, 0.02)
    echoes = kind(echoes=2)(observed(PROBE, samples))
    assert np.allclose(echoes.toa * RATE, 190.0, atol=0.2)
    assert np.allclose(np.sort(echoes.azimuth[0]), [-0.8, 0.8], atol=np.radians(1))


def test_highest_and_summits_by_hand():
    """Values at least 5 lags from a higher one; local maxima of a circle, the highest repeated."""
    curve = np.zeros((1, 13))
    curve[0, [1, 2, 3, 7, 12]] = 5.0, 6.0, 4.0, 3.0, 2.0
    assert highest(curve, 3).tolist() == [[2, 7, 12]]
    power = np.array([[5.0, 1.0, 3.0, 2.0, 4.0], [1.0, 2.0, 3.0, 2.0, 1.5]])
    assert estimates.summits(power, 2).tolist() == [[0, 2], [2, 2]]


# ---------------------------------------------------------------- what sets each apart


def test_the_detector_is_the_papers_inequality_at_the_wanted_rate():
    """In noise of known power 2 ln gamma is the chi-square quantile: 10 % of 400 recordings are
    alarms, 7 to 14 %."""
    short = noise_probe(burst=64, length=600)
    samples = np.random.default_rng(0).standard_normal((400, 6, 600))
    batch = Observation(samples, short, RING, noise_psd=np.ones(5))
    alarms = detected(MatchedFilter(batch, WINDOW), 0.1)
    assert 0.07 <= alarms.mean() <= 0.14


def test_mclam_gives_noise_no_gain_and_an_echo_its_own():
    noise = white(PROBE, 0.1)
    found = Mclam(false_alarm=1e-6)(observed(PROBE, noise, noise + wave(PROBE, 0.5, 180)))
    assert (found.gain[0, 0], found.score[0, 0]) == (0.0, 0.0)
    assert found.gain[1, 0] == pytest.approx(0.1, rel=0.1)


def test_noise_weights_survive_a_microphone_that_crackles():
    """Microphone 4 has 30 times the noise of the others; unweighted, J follows its noise."""
    rows = [wave(PROBE, 0.5, 180) + white(PROBE, 0.2, seed) for seed in range(16)]
    for seed, row in enumerate(rows):
        row[3] += white(PROBE, 6.0, 100 + seed)[3]
    right = {}
    for kind in (Em, Joint):
        echoes = kind()(observed(PROBE, *rows))
        near = np.abs(turn(echoes.azimuth - 0.5)) < np.radians(5)
        right[kind] = np.mean((np.abs(echoes.toa * RATE - 180) < 1) & near)
    assert right[Em] == 1.0
    assert right[Joint] < 0.5


def test_refinement_finds_what_lies_between_samples_and_directions():
    """1/20 of either cell is left."""
    truth = np.array([[0.513, 180.4], [-2.02, 199.55], [1.47, 231.7]])
    waves = [wave(PROBE, azimuth, lag) + white(PROBE, 0.01) for azimuth, lag in truth]
    fine = Joint()(observed(PROBE, *waves))
    assert np.allclose(fine.azimuth[:, 0], truth[:, 0], atol=np.radians(0.2))
    assert np.allclose(fine.toa[:, 0] * RATE, truth[:, 1], atol=0.05)
    assert np.allclose(fine.gain[:, 0], 0.1, rtol=0.02)


def test_elevation_is_found_where_it_is_asked():
    """A wave 40 degrees off the axis; above or below the array's plane are the same."""
    source = np.random.default_rng(0).standard_normal(3000)
    delays = equations.delays(RING.positions, 1.0, elevation=np.radians(40)) * RATE
    batch = observed(PROBE, np.stack([equations.shift(source, delay) for delay in delays]))
    echoes = Snls(azimuths=36, elevations=9)(batch)
    assert np.degrees(echoes.elevation[0, 0]) == pytest.approx(40.0)
    assert turn(echoes.azimuth - 1.0)[0, 0] == pytest.approx(0.0, abs=np.radians(5))
    assert Snls()(batch).elevation[0, 0] == pytest.approx(np.pi / 2)


def test_a_single_microphone_has_times_but_no_direction():
    batch = observed(PROBE, NOISY[0])
    one = replace(batch, samples=batch.samples[:, :1], array=MicArray(RING.positions[:1]))
    assert Joint()(one).toa[0, 0] * RATE == pytest.approx(180, abs=0.1)
