"""Several echoes at once: RELAX and EM against their loops, and corners, which have two."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import reference
from echolearn.acoustics.geometry import SearchWindow, circular_array, true_echoes, wall_points
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Observation, Pose, Room
from echolearn.bench import equations
from echolearn.checks import BadValue
from echolearn.evaluation.matching import match_echoes
from echolearn.localization import beamforming, relax
from echolearn.localization.localizer import Localizer
from echolearn.localization.matched_filter import (
    MatchedFilter,
    joint_search,
    reference_search,
    several,
)
from echolearn.localization.methods.em import Em
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.joint import Joint
from echolearn.localization.methods.peaks import Peaks, highest
from echolearn.localization.methods.snls import Snls
from echolearn.localization.search import Peak

RING = circular_array()
PROBE = noise_probe(burst=400, length=3000)
WINDOW = SearchWindow()
FIRST, LAST = WINDOW.lags(RING, 22050.0)
GRID = beamforming.azimuth_grid(24)
SEVERAL = [Joint, Em, Gated, Snls, Peaks]
Hear = Callable[..., Observation]


def echo(azimuth: float, lag: float, gain: float) -> np.ndarray:
    """Return recordings (M, N) of a plane-wave echo that reaches microphone 1 at `lag`."""
    early = equations.delays(RING.positions, azimuth)[0] * 22050.0
    source = gain * equations.shift(equations.padded(PROBE.samples, PROBE.length), lag - early)
    return reference.plane_wave(source, RING.positions, azimuth, rate=22050.0)


def mixed(*echoes: tuple[float, float, float], noise: float = 0.02, seed: int = 0) -> np.ndarray:
    quiet = noise * np.random.default_rng(seed).standard_normal((6, PROBE.length))
    return sum((echo(*one) for one in echoes), quiet)


def observation(*samples: np.ndarray) -> Observation:
    return Observation(np.stack(samples), PROBE, RING)


ON_GRID = [mixed((GRID[14], 180, 0.1), (GRID[3], 215, 0.07), noise=n, seed=3) for n in (0.02, 0.1)]


# ---------------------------------------------------------------- the loops


@pytest.mark.parametrize("count", [2, 3])
def test_relax_is_its_loop(count: int) -> None:
    matched = MatchedFilter(observation(*ON_GRID), WINDOW)
    peaks = strongest_peaks(matched, reference_search(matched, refine=False), echoes=count)
    for row, y in enumerate(ON_GRID):
        expected = equations.relax(y[0], PROBE.samples, first=FIRST, last=LAST, echoes=count)
        found = sorted(
            ((float(p.lag[row]) + FIRST, float(p.gain[row])) for p in peaks),
            key=lambda one: -one[1],
        )
        assert np.allclose(found, expected, rtol=1e-3)


def test_em_is_its_loop_from_the_same_starts() -> None:
    """Two components, four iterations; the starts have wrong gains, which EM mends step by step."""
    starts = [(180.0, float(GRID[14]), 0.05), (215.0, float(GRID[3]), 0.1)]
    matched = MatchedFilter(observation(*ON_GRID), WINDOW, azimuths=24)
    columns = [np.full((2, 1), value).T[0] for value in np.array(starts)[:, 0] - FIRST]
    begin = [
        Peak(lag, np.full(2, azimuth), np.full(2, np.pi / 2), np.full(2, gain), np.ones(2))
        for lag, (_, azimuth, gain) in zip(columns, starts, strict=True)
    ]
    search = joint_search(matched, refine=False)
    found = relax.expect_maximize(matched.padded, search, begin, burst=PROBE.samples, iterations=4)
    for row, y in enumerate(ON_GRID):
        expected = equations.em(
            y,
            PROBE.samples,
            RING.positions,
            GRID,
            first=FIRST,
            last=LAST,
            rate=22050.0,
            starts=starts,
            iterations=4,
        )
        for peak, (lag, azimuth, gain) in zip(found, expected, strict=True):
            assert peak.lag[row] + FIRST == pytest.approx(lag)
            assert peak.azimuth[row] == pytest.approx(azimuth)
            assert peak.gain[row] == pytest.approx(gain, rel=0.02)


def test_an_echo_subtracted_from_its_correlations_leaves_nothing() -> None:
    """Between samples and directions too: the autocorrelation is tabled to 3e-4."""
    matched = MatchedFilter(observation(echo(0.77, 190.37, 0.1)), WINDOW)
    truth = Peak(*(np.array([v]) for v in (190.37 - FIRST, 0.77, np.pi / 2, 0.1, 0.0)))
    model = relax.heard(truth, joint_search(matched), PROBE.samples, matched.padded.shape[-1])
    assert np.abs(matched.padded - model).max() < 1e-3 * np.abs(matched.padded).max()


# ---------------------------------------------------------------- the contract with several echoes


@pytest.mark.parametrize("kind", SEVERAL)
def test_both_echoes_are_found_the_strongest_first(kind: type) -> None:
    heard = observation(
        mixed((0.5, 180.3, 0.1), (-2.0, 221.6, 0.07)),
        mixed((-1.0, 150.8, 0.05), (2.4, 170.2, 0.08)),
    )
    echoes = kind(echoes=2)(heard)
    for name in ("toa", "score", "gain", "azimuth", "elevation", "power"):
        assert getattr(echoes, name).shape == (2, 2)
    assert np.allclose(echoes.toa * 22050.0, [[180.3, 221.6], [170.2, 150.8]], atol=0.51)
    off = np.abs(np.angle(np.exp(1j * (echoes.azimuth - [[0.5, -2.0], [2.4, -1.0]]))))
    assert (off[0] < np.radians(3)).all()
    assert off[1, 0] < np.radians(3)
    if kind in (
        Joint,
        Em,
        Gated,
    ):  # the second peak of whole-recording MPDR need not be the second echo
        assert off[1, 1] < np.radians(3)
    assert (np.diff(echoes.gain, axis=-1) <= 0).all()


@pytest.mark.parametrize("kind", SEVERAL)
def test_a_batch_of_several_is_its_observations_one_by_one(kind: type) -> None:
    rows = [
        mixed((0.5, 180.3, 0.1), (-2.0, 221.6, 0.07)),
        mixed((1.5, 140, 0.1), (0.2, 230, 0.09), noise=0.2),
    ]
    together = kind(echoes=3)(observation(*rows))
    alone = [kind(echoes=3)(observation(y)) for y in rows]
    for name in ("toa", "gain", "azimuth"):
        assert np.allclose(
            getattr(together, name), np.concatenate([getattr(e, name) for e in alone]), rtol=1e-3
        )


@pytest.mark.parametrize("kind", SEVERAL)
def test_more_echoes_than_the_window_holds_are_refused(kind: type) -> None:
    with pytest.raises(
        BadValue, match=r"^localizer.echoes=32: .*at most 31 in a window of 156 samples"
    ):
        kind(echoes=32)(observation(ON_GRID[0]))


def test_joint_tells_echoes_apart_that_reach_microphone_1_together() -> None:
    """A robot that looks into a corner: both walls at once, from 45 degrees left and right."""
    heard = observation(mixed((0.8, 190.0, 0.1), (-0.8, 190.0, 0.1)))
    for kind in (Joint, Em):
        echoes = kind(echoes=2)(heard)
        assert np.allclose(echoes.toa * 22050.0, 190.0, atol=0.2)
        assert np.allclose(np.sort(echoes.azimuth[0]), [-0.8, 0.8], atol=np.radians(1))


def test_peaks_apart_by_hand() -> None:
    curve = np.array([[0.0, 5.0, 6.0, 4.0, 0.0, 3.0, 1.0, 2.0]])
    assert highest(curve, 2, apart=2).tolist() == [[2, 5]]
    assert highest(curve, 3, apart=2).tolist() == [[2, 5, 7]]


def test_summits_by_hand_on_a_circle() -> None:
    power = np.array([[5.0, 1.0, 3.0, 2.0, 4.0], [1.0, 2.0, 3.0, 2.0, 1.5]])
    assert estimates.summits(power, 2).tolist() == [[0, 2], [2, 2]]


# ---------------------------------------------------------------- a corner of a room


@pytest.mark.parametrize(
    "localizer",
    [Joint(echoes=2), Em(echoes=2), Gated(echoes=2)],
    ids=lambda one: type(one).__name__,
)
def test_a_corner_gives_two_points_on_two_walls(
    localizer: Localizer, hear: Hear, study: tuple[Room, Pose]
) -> None:
    """1.0 m from one wall, 1.5 m from the other, 0 dB: both points within 2 cm in at least 9 of 10
    trials."""
    room, pose = study
    echoes = localizer(hear(study, snr_db=0.0, trials=10))
    points = wall_points(
        echoes.toa,
        echoes.azimuth,
        echoes.elevation,
        position=pose.position,
        heading=pose.heading,
        array=RING,
    )
    on_first, on_second = np.abs(points[..., 0]) < 0.02, np.abs(points[..., 1]) < 0.02
    assert np.mean(on_first.any(axis=1) & on_second.any(axis=1)) >= 0.9
    truth = true_echoes(replace(room, walls=(1, 0, 1, 0, 0, 0)), pose, RING)
    matches = [match_echoes(truth.toa, row, tolerance=5 / 22050.0) for row in echoes.toa]
    assert np.mean([sorted(match) == [0, 1] for match in matches]) >= 0.9
