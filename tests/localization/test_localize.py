"""Every localizer keeps one contract, and each does what its equations say."""

from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

import reference
from echolearn.acoustics.geometry import SearchWindow, circular_array, true_echoes
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import MicArray, Observation, Pose, Room
from echolearn.bench import equations
from echolearn.checks import BadValue
from echolearn.evaluation import stats
from echolearn.localization import beamforming
from echolearn.localization.localizer import Localizer
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.snls import Snls, mpdr_spectrum

CONFIGS = sorted((Path(__file__).parents[2] / "conf" / "localizer").glob("*.yaml"))
RING = circular_array()
PROBE = noise_probe(length=6000)
STEP = np.radians(2.0)
LAG = 180


def build(config: Path, **changed: Any) -> Localizer:
    """Call what a localizer's YAML names with what it says, in the default window."""
    arguments = yaml.safe_load(config.read_text())
    module, _, name = arguments.pop("_target_").rpartition(".")
    return getattr(import_module(module), name)(
        **{**arguments, "window": SearchWindow(), **changed}
    )


@pytest.fixture(params=CONFIGS, ids=lambda path: path.stem)
def localizer(request: pytest.FixtureRequest) -> Localizer:
    """Return each configured localizer."""
    return build(request.param)


def echo_from(
    azimuth: float, *, lag: int = LAG, gain: float = 0.1, noise: float = 0.01, seed: int = 0
) -> np.ndarray:
    """Return recordings (M, N) of one plane-wave echo that reaches microphone 1 exactly at `lag`."""
    early = equations.delays(RING.positions, azimuth)[0] * 22050.0
    source = gain * equations.shift(equations.padded(PROBE.samples, PROBE.length), lag - early)
    waves = reference.plane_wave(source, RING.positions, azimuth, rate=22050.0)
    return waves + noise * np.random.default_rng(seed).standard_normal(waves.shape)


def observation(*samples: np.ndarray) -> Observation:
    """Return recordings (M, N) as a batch."""
    return Observation(np.stack(samples), PROBE, RING)


def turn(angles: np.ndarray) -> np.ndarray:
    """Return angles in [-pi, pi]."""
    return np.angle(np.exp(1j * angles))


def chance(seed: int = 1) -> np.ndarray:
    """Return recordings (M, N) of nothing but noise."""
    return np.random.default_rng(seed).standard_normal((6, 6000))


# ---------------------------------------------------------------- the contract


def test_there_are_localizers_to_test() -> None:
    assert {"gated", "snls"} <= {path.stem for path in CONFIGS}


def test_every_field_has_one_row_per_observation(localizer: Localizer) -> None:
    echoes = localizer(observation(echo_from(0.5), chance(), echo_from(-2.0)))
    for name in ("toa", "score", "gain", "azimuth", "elevation", "power"):
        field = getattr(echoes, name)
        assert field.shape[0] == 3
        assert field.shape == echoes.toa.shape
        assert field.dtype == np.float64
        assert np.isfinite(field).all()


def test_estimates_stay_in_their_ranges(localizer: Localizer) -> None:
    echoes = localizer(observation(*(chance(seed) for seed in range(8))))
    first, last = SearchWindow().lags(RING, 22050.0)
    assert (echoes.toa >= first / 22050.0 - 1e-12).all()
    assert (echoes.toa <= last / 22050.0 + 1e-12).all()
    assert (np.abs(echoes.score) <= 1.0 + 1e-9).all()
    assert (np.abs(echoes.azimuth) <= np.pi + 1e-12).all()
    assert ((echoes.elevation >= 0) & (echoes.elevation <= np.pi)).all()
    assert (echoes.power >= 0).all()


def test_a_batch_is_its_observations_one_by_one(localizer: Localizer) -> None:
    samples = [echo_from(0.5), chance(), echo_from(-2.0, lag=130)]
    together, alone = localizer(observation(*samples)), [localizer(observation(y)) for y in samples]
    for name in ("toa", "score", "gain", "azimuth", "elevation", "power"):
        assert np.allclose(
            getattr(together, name), np.concatenate([getattr(e, name) for e in alone]), rtol=1e-3
        )


def test_listening_again_hears_the_same_and_changes_nothing(localizer: Localizer) -> None:
    heard = observation(echo_from(0.5), chance())
    before = heard.samples.copy()
    first, again = localizer(heard), localizer(heard)
    assert np.array_equal(heard.samples, before)
    assert all(
        np.array_equal(getattr(first, name), getattr(again, name))
        for name in ("toa", "azimuth", "power")
    )


@pytest.mark.parametrize("lag", [120, 150, 201, 260])
def test_a_delay_by_k_samples_is_a_toa_of_k(localizer: Localizer, lag: int) -> None:
    echoes = localizer(observation(echo_from(0.5, lag=lag)))
    assert echoes.toa[0, 0] * 22050.0 == pytest.approx(lag, abs=0.5)


@pytest.mark.parametrize("azimuth", [-3.1, -1.3, 0.0, 0.8, 2.2])
def test_the_azimuth_is_that_of_the_wave(localizer: Localizer, azimuth: float) -> None:
    echoes = localizer(observation(echo_from(azimuth)))
    assert abs(turn(echoes.azimuth[0, 0] - azimuth)) < STEP


def test_gain_changes_only_what_has_its_unit(localizer: Localizer) -> None:
    quiet, loud = (localizer(observation(scale * echo_from(1.1))) for scale in (1.0, 8.0))
    assert np.array_equal(quiet.toa, loud.toa)
    assert np.array_equal(quiet.azimuth, loud.azimuth)
    assert np.allclose(quiet.score, loud.score)
    assert np.allclose(loud.gain, 8.0 * quiet.gain)
    # Power is that of the recording, or that of phases alone (SRP-PHAT).
    louder = loud.power / quiet.power
    assert np.allclose(louder, 64.0, rtol=1e-3) or np.allclose(louder, 1.0)


def test_the_gain_is_that_of_the_echo(localizer: Localizer) -> None:
    assert localizer(observation(echo_from(0.5, gain=0.1))).gain[0, 0] == pytest.approx(
        0.1, rel=0.05
    )


def test_the_score_says_how_much_is_probe(localizer: Localizer) -> None:
    """Echo and noise of equal power under the probe correlate at sqrt(1/2); a direction off by 1
    degree costs 3 %."""
    clean, even = (localizer(observation(echo_from(0.5, gain=0.1, noise=n))) for n in (1e-4, 0.1))
    at_microphone_1 = isinstance(localizer, Snls | Gated)
    assert clean.score[0, 0] == pytest.approx(1.0, abs=1e-3 if at_microphone_1 else 0.03)
    assert even.score[0, 0] == pytest.approx(np.sqrt(0.5), abs=0.06)


def test_turning_the_robot_turns_the_azimuth_back(localizer: Localizer) -> None:
    """The ring turned by one microphone hears the same wave, renamed; TOA moves with microphone 1."""
    samples = echo_from(0.4)
    turned = np.roll(samples, -1, axis=0)
    before, after = localizer(observation(samples)), localizer(observation(turned))
    assert turn(before.azimuth - after.azimuth - np.pi / 3)[0, 0] == pytest.approx(
        0.0, abs=STEP / 2
    )
    moved = (
        equations.delays(RING.positions, 0.4)[1] - equations.delays(RING.positions, 0.4)[0]
    ) * 22050.0
    assert (after.toa - before.toa)[0, 0] * 22050.0 == pytest.approx(moved, abs=0.51)


def test_another_speed_of_sound_is_another_geometry(localizer: Localizer) -> None:
    """Air scaled with the ring: the same recordings, the same directions; in the other window, the
    same samples."""
    heard = observation(echo_from(0.7))
    scaled = Observation(heard.samples, PROBE, MicArray(2 * RING.positions), 686.0)
    between = (
        0.0 if isinstance(localizer, Snls | Gated) else np.radians(0.2)
    )  # those that refine the grid's direction
    assert localizer(scaled).azimuth[0, 0] == pytest.approx(
        localizer(heard).azimuth[0, 0], abs=between + 1e-12
    )


def test_silence_is_answered_with_finite_numbers(localizer: Localizer) -> None:
    echoes = localizer(observation(np.zeros((6, 6000)), echo_from(0.5)))
    for name in ("toa", "score", "gain", "azimuth", "elevation", "power"):
        assert np.isfinite(getattr(echoes, name)).all()
    assert echoes.gain[0, 0] == 0.0
    assert echoes.score[0, 0] == 0.0
    assert echoes.toa[1, 0] * 22050.0 == pytest.approx(LAG, abs=0.5)


def test_a_recording_shorter_than_the_window_is_refused(localizer: Localizer) -> None:
    short = Observation(np.zeros((1, 6, 300)), noise_probe(burst=100, length=300), RING)
    with pytest.raises(
        BadValue, match=r"^window.farthest=2.0 m: echoes within the recording of 300 samples"
    ):
        localizer(short)


@pytest.mark.parametrize("config", CONFIGS, ids=lambda path: path.stem)
@pytest.mark.parametrize("azimuths", ["many", 3, 180.5])
def test_bad_grids_are_refused(config: Path, azimuths: object) -> None:
    with pytest.raises(BadValue, match=f"^localizer.azimuths={azimuths}"):
        build(config, azimuths=azimuths)


# ---------------------------------------------------------------- S-NLS


@pytest.mark.parametrize(("noise", "seed"), [(0.01, 0), (0.3, 1), (1.0, 2), (3.0, 3)])
def test_s_nls_is_least_squares_over_every_lag(noise: float, seed: int) -> None:
    samples = echo_from(0.5, noise=noise, seed=seed)
    echoes = Snls()(observation(samples))
    first, last = SearchWindow().lags(RING, 22050.0)
    lag, gain = equations.snls(samples[0], PROBE.samples, first=first, last=last)
    assert echoes.toa[0, 0] * 22050.0 == pytest.approx(lag)
    assert echoes.gain[0, 0] == pytest.approx(gain)


Place = tuple[Room, Pose]
Hear = Callable[..., Observation]


def times(heard: Observation) -> np.ndarray:
    """Return the S-NLS time of each observation, shape (B,); microphone 1 alone, for speed."""
    one = replace(heard, samples=heard.samples[:, :1], array=MicArray(RING.positions[:1]))
    alone = MatchedFilter(one, SearchWindow(rule="authors"))
    return alone.toa(alone.strongest)


def test_s_nls_near_two_walls_is_the_papers_80_percent_at_minus_10_db(
    hear: Hear, study: Place
) -> None:
    """20 probes x 5 trials. The paper says around 80 % within 5 samples, planning measured 82.5 %."""
    truth = true_echoes(*study, RING).toa
    found = np.concatenate(
        [times(hear(study, snr_db=-10.0, trials=5, probe=probe)) for probe in range(20)]
    )
    share = np.mean(np.abs(found[:, None] - truth).min(axis=1) * 22050.0 < 5)
    assert 0.75 <= share <= 0.90


def test_s_nls_never_misses_in_quiet_and_guesses_in_noise(hear: Hear, study: Place) -> None:
    """Chance of 5 samples around two walls in a window of 129 is 18 / 129 = 14 %, plus the
    ceiling's reflections."""
    truth = true_echoes(*study, RING).toa
    shares = []
    for snr_db in (20.0, -40.0):
        found = np.concatenate(
            [times(hear(study, snr_db=snr_db, trials=20, probe=probe)) for probe in range(4)]
        )
        shares.append(np.mean(np.abs(found[:, None] - truth).min(axis=1) * 22050.0 < 5))
    assert shares[0] == 1.0
    assert shares[1] < 0.35


# ---------------------------------------------------------------- directions


def near_the_wall(localizer: Localizer, heard: Observation, place: Place) -> float:
    """Return the share of azimuths within 5 degrees of the wall whose TOA was found."""
    echoes, truth = localizer(heard), true_echoes(*place, RING)
    error = np.abs(echoes.toa - truth.toa) * 22050.0
    found = error.min(axis=1) < 10
    off = turn(echoes.azimuth[:, 0] - truth.azimuth[error.argmin(axis=1)])
    return float(np.mean(np.abs(off[found]) < np.radians(5)))


def test_mpdr_finds_the_wall_in_quiet_and_not_in_noise(hear: Hear, beside: Place) -> None:
    assert near_the_wall(Snls(), hear(beside, snr_db=10.0, trials=24), beside) >= 0.9
    assert near_the_wall(Snls(), hear(beside, snr_db=-10.0, trials=24), beside) < 0.25


def test_what_mpdr_finds_at_0_db_hangs_on_how_the_array_stands(hear: Hear, study: Place) -> None:
    """8 probes x 10 trials at one place. Planning measured 82 % (33 of 40); turned by 90 degrees it
    is half of that."""
    shares = []
    for place in (study, (study[0], replace(study[1], heading=0.0))):
        heard = [hear(place, snr_db=0.0, trials=10, probe=probe) for probe in range(8)]
        shares.append(np.mean([near_the_wall(Snls(), each, place) for each in heard]))
    planned = stats.wilson(33, 40)
    assert planned.low <= shares[0] <= planned.high
    assert shares[1] < 0.5


def test_listening_at_the_echo_finds_the_wall_where_mpdr_does_not(
    hear: Hear, beside: Place
) -> None:
    heard = hear(beside, snr_db=-5.0, trials=24)
    assert near_the_wall(Gated(), heard, beside) >= 0.9
    assert near_the_wall(Snls(), heard, beside) < 0.4


@pytest.mark.parametrize("noise", [0.02, 0.4])
def test_srp_mpdr_is_the_papers_loop(noise: float) -> None:
    samples = echo_from(0.5, noise=noise)
    found = mpdr_spectrum(observation(samples), azimuths=12)[0]
    expected = equations.mpdr(samples, RING.positions, beamforming.azimuth_grid(12), rate=22050.0)
    assert np.allclose(found, expected, rtol=1e-3)


@pytest.mark.parametrize("noise", [0.02, 1.0])
def test_the_gated_direction_is_its_definition(noise: float) -> None:
    samples = echo_from(-1.4, noise=noise, seed=4)
    matched = MatchedFilter(observation(samples), SearchWindow(), azimuths=24)
    index = matched.strongest
    expected = equations.gated(
        samples,
        PROBE.samples,
        RING.positions,
        beamforming.azimuth_grid(24),
        lag=matched.first + int(index[0]),
        rate=22050.0,
    )
    assert np.allclose(matched.gated_power(index)[0, :-1], expected, atol=0.05 * expected.max())


def test_an_echo_from_above_is_told_from_a_wall(hear: Hear) -> None:
    """Ceiling 1.3 m above the robot, walls far away: the axis wins, and up and down sound alike."""
    for height in (1.3, 4.7):
        place = Room((12.0, 12.0, 6.0), 0.4), Pose(np.array([6.0, 5.5, height]))
        echoes = Gated()(hear(place, snr_db=0.0, trials=4))
        assert (echoes.elevation == 0.0).all()


def test_elevation_is_found_where_it_is_asked() -> None:
    """A wave 40 degrees off the axis; above or below the array's plane sound alike."""
    source = np.random.default_rng(0).standard_normal(6000)
    delays = equations.delays(RING.positions, 1.0, np.radians(40)) * 22050.0
    wave = np.stack([equations.shift(source, delay) for delay in delays])
    echoes = Snls(azimuths=36, elevations=9)(observation(wave))
    assert np.degrees(echoes.elevation[0, 0]) == pytest.approx(40.0)
    assert turn(echoes.azimuth - 1.0)[0, 0] == pytest.approx(0.0, abs=np.radians(5))
    assert Snls()(observation(wave)).elevation[0, 0] == pytest.approx(np.pi / 2)


# ---------------------------------------------------------------- the matched-filter view


def test_steered_responses_stay_inside_the_window() -> None:
    matched = MatchedFilter(observation(echo_from(0.0)), SearchWindow(rule="authors"), azimuths=36)
    assert matched.correlation.shape == (1, 6, 129)
    assert matched.steered.shape == (1, 37, 129)
    assert matched.energy.shape == (1, 6, 129)
    angle, lag = np.unravel_index(matched.steered[0].argmax(), (37, 129))
    assert beamforming.azimuth_grid(36)[angle] == pytest.approx(0.0, abs=1e-12)
    assert matched.first + lag == LAG


def test_a_window_near_the_emission_is_padded_with_silence() -> None:
    """First lag 13: the lags before the emission cannot be heard and count as zero."""
    heard = observation(echo_from(0.3, lag=40))
    matched = MatchedFilter(heard, SearchWindow(nearest=0.2, farthest=1.0))
    assert matched.padded.shape[-1] == matched.last - matched.first + 1 + 2 * correlations.PAD
    assert (matched.padded[..., : correlations.PAD - matched.first] == 0).all()
    assert matched.toa(matched.strongest)[0] * 22050.0 == pytest.approx(40)


def test_times_and_indices_are_inverse() -> None:
    matched = MatchedFilter(observation(echo_from(0.0)), SearchWindow())
    index = np.arange(matched.last - matched.first + 1)
    assert np.array_equal(matched.index(matched.toa(index)), index)
    assert np.array_equal(matched.index(np.array([0.0, 1.0])), [0, index[-1]])
