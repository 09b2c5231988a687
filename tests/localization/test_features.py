"""Columns and tensors against their definitions, and against changes that must not matter."""

from dataclasses import replace

import numpy as np
import pytest

import reference
from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Array, Echoes, Observation
from echolearn.bench import equations
from echolearn.checks import BadValue
from echolearn.localization import beamforming, features
from echolearn.localization.faults import SilentMicrophone
from echolearn.localization.localizer import Localizer
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.joint import Joint

RING = circular_array()
PROBE = noise_probe(length=4000)
AZIMUTHS = 24
GRID = beamforming.azimuth_grid(AZIMUTHS)
LAG = 180
OF_GAIN = {"gain", "gain_delay", "power"}


def recordings(azimuth: float, *, noise: float, seed: int = 0) -> Array:
    """Return one plane-wave echo in noise, shape (M, N), at microphone 1 at `LAG`."""
    early = equations.delays(RING.positions, azimuth)[0] * 22050.0
    source = 0.1 * equations.shift(equations.padded(PROBE.samples, PROBE.length), LAG - early)
    waves = reference.plane_wave(source, RING.positions, azimuth, rate=22050.0)
    return waves + noise * np.random.default_rng(seed).standard_normal(waves.shape)


def described(
    *samples: Array, localizer: Localizer | None = None
) -> tuple[dict[str, Array], MatchedFilter, Echoes]:
    """Localize and describe recordings (M, N)."""
    observation = Observation(np.stack(samples), PROBE, RING)
    matched = MatchedFilter(observation, SearchWindow(), AZIMUTHS)
    echoes = (localizer or Gated(azimuths=AZIMUTHS))(observation)
    return features.describe(matched, echoes), matched, echoes


@pytest.fixture(scope="module", params=[0.05, 0.5])
def case(request: pytest.FixtureRequest) -> tuple[Array, dict[str, Array], int, float]:
    """Return a recording (M, N), its description, the lag and the azimuth estimated from it."""
    samples = recordings(0.9, noise=request.param, seed=1)
    columns, _, echoes = described(samples)
    return samples, columns, round(echoes.toa[0, 0] * 22050), float(echoes.azimuth[0, 0])


def joint(samples: Array) -> Array:
    """Return J(tau, phi) in the window, shape (A, L), the slow way."""
    first, last = SearchWindow().lags(RING, 22050.0)
    rows = [
        equations.steered(samples, PROBE.samples, RING.positions, azimuth, rate=22050.0)
        for azimuth in GRID
    ]
    return np.stack(rows)[:, first : last + 1]


def test_every_column_and_tensor_is_there_and_no_other() -> None:
    columns, _, _ = described(recordings(0.4, noise=0.1), recordings(-1.0, noise=3.0))
    assert set(columns) == {*features.COLUMNS, *features.TENSORS}
    for name in features.COLUMNS:
        assert columns[name].shape == (2,)
        assert columns[name].dtype == np.float64
    for name in features.TENSORS:
        assert columns[name].shape == (2, features.COVARIANCE_BANDS, 36)
        assert columns[name].dtype == np.float32


def test_columns_of_the_peak_are_their_definitions(
    case: tuple[Array, dict[str, Array], int, float],
) -> None:
    samples, columns, lag, _ = case
    first, last = SearchWindow().lags(RING, 22050.0)
    r = np.correlate(samples[0], PROBE.samples, "valid")[first : last + 1]
    peak, others = r[lag - first], [r[k] for k in range(len(r)) if abs(k - (lag - first)) >= 5]
    under = samples[0, lag : lag + 1500]
    assert columns["toa"][0] == pytest.approx(lag / 22050.0)
    assert columns["peak_to_rms"][0] == pytest.approx(peak / np.sqrt(np.mean(r**2)))
    assert columns["second_to_first"][0] == pytest.approx(max(others) / peak)
    assert columns["score"][0] == pytest.approx(np.corrcoef(under, PROBE.samples)[0, 1], abs=2e-3)
    assert columns["gain"][0] == pytest.approx(peak / np.sum(PROBE.samples**2))
    assert columns["gain_delay"][0] == pytest.approx(
        4 * np.pi * 343.0 * lag / 22050.0 * columns["gain"][0]
    )


def test_a_second_peak_is_five_lags_away_at_least() -> None:
    correlation = np.zeros((3, 40))
    correlation[:, 10] = 2.0
    correlation[0, 14], correlation[1, 15], correlation[2, 5] = 1.0, 1.5, 0.5
    columns = features.peak_columns(correlation, np.array([10, 10, 10]))
    assert columns["second_to_first"].tolist() == [0.0, 0.75, 0.25]
    assert np.allclose(
        columns["peak_to_rms"], 2.0 / np.sqrt((4 + np.array([1.0, 2.25, 0.25])) / 40)
    )


def test_columns_of_the_steered_response_are_their_definitions(
    case: tuple[Array, dict[str, Array], int, float],
) -> None:
    """The short transforms of the fast code cost about 1 % of the peak."""
    samples, columns, lag, azimuth = case
    first, _ = SearchWindow().lags(RING, 22050.0)
    response = joint(samples)
    here = response[np.abs(GRID - azimuth).argmin(), lag - first]
    rms = np.sqrt(np.mean(response**2))
    energy = sum(np.sqrt(np.sum(row[lag : lag + 1500] ** 2)) for row in samples) * np.sqrt(
        np.sum(PROBE.samples**2)
    )
    assert columns["joint"][0] == pytest.approx(here / rms, rel=0.02)
    assert columns["joint_max"][0] == pytest.approx(response.max() / rms, rel=0.02)
    assert columns["joint_ratio"][0] == pytest.approx(here / response.max(), rel=0.02)
    assert columns["joint_score"][0] == pytest.approx(here / energy, rel=0.02)
    assert columns["joint_lag"][0] == abs(response.max(axis=0).argmax() - (lag - first))
    eta = (
        equations.delays(RING.positions, azimuth) - equations.delays(RING.positions, azimuth)[0]
    ) * 22050.0
    aligned = [
        np.correlate(equations.shift(y, -e), PROBE.samples, "valid")[lag]
        for y, e in zip(samples, eta, strict=True)
    ]
    assert columns["coherence"][0] == pytest.approx(
        sum(aligned) ** 2 / (6 * sum(a**2 for a in aligned)), rel=0.03
    )
    gated = equations.gated(samples, PROBE.samples, RING.positions, GRID, lag=lag, rate=22050.0)
    ratio = 10 * np.log10(gated[np.abs(GRID - azimuth).argmin()] / gated.mean())
    assert columns["gated_ratio"][0] == pytest.approx(ratio, abs=0.2)


def test_columns_of_the_beam_are_the_papers(
    case: tuple[Array, dict[str, Array], int, float],
) -> None:
    samples, columns, _, _ = case
    power = equations.mpdr(samples, RING.positions, GRID, rate=22050.0)
    assert columns["power"][0] == pytest.approx(10 * np.log10(power.max()), abs=0.01)
    assert columns["power_ratio"][0] == pytest.approx(
        10 * np.log10(power.max() / power.mean()), abs=0.01
    )
    assert columns["azimuth_mpdr"][0] == pytest.approx(GRID[power.argmax()])


def test_gain_changes_the_columns_that_have_it_and_no_other() -> None:
    samples = recordings(0.9, noise=0.3)
    columns, _, _ = described(samples, 10.0 * samples)
    for name in (*features.COLUMNS, *features.TENSORS):
        quiet, loud = columns[name]
        expected = {"gain": 10.0 * quiet, "gain_delay": 10.0 * quiet, "power": quiet + 20.0}.get(
            name, quiet
        )
        assert np.allclose(loud, expected, rtol=1e-4, atol=1e-4), name
        assert (name in OF_GAIN) == (not np.allclose(loud, quiet, rtol=1e-4, atol=1e-4)), name


def test_turning_the_robot_by_one_microphone_turns_azimuths_only() -> None:
    """Columns of all microphones must not know which one is called the first."""
    samples = recordings(GRID[14], noise=0.01)
    columns, _, _ = described(samples, np.roll(samples, -1, axis=0))
    for name in ("azimuth", "azimuth_mpdr"):
        assert np.angle(
            np.exp(1j * (columns[name][0] - columns[name][1] - np.pi / 3))
        ) == pytest.approx(0.0, abs=1e-6)
    for name in (
        "coherence",
        "joint_max",
        "joint_ratio",
        "power",
        "power_ratio",
        "joint_score",
        "gated_ratio",
    ):
        assert columns[name][1] == pytest.approx(columns[name][0], rel=0.06, abs=0.06), name


def test_an_echo_looks_like_one_and_noise_does_not() -> None:
    echo, noise = recordings(0.0, noise=0.01), np.random.default_rng(0).standard_normal((6, 4000))
    columns, _, _ = described(echo, noise)
    assert columns["coherence"][0] > 0.99
    assert columns["score"][0] > 0.98
    assert columns["joint_ratio"][0] > 0.99
    assert columns["joint_lag"][0] == 0
    for name in (
        "score",
        "peak_to_rms",
        "coherence",
        "joint",
        "joint_score",
        "power_ratio",
        "gated_ratio",
    ):
        assert columns[name][0] > 1.3 * columns[name][1], name
    assert columns["second_to_first"][0] < 0.3 < columns["second_to_first"][1] <= 1.0


# ---------------------------------------------------------------- tensors


def literal_tensor(spectra: Array) -> Array:
    """Return the packed band averages of spectra (M, F, T) by loops, shape (BANDS, 36)."""
    bins, tensor = (spectra.shape[1] - 1) // features.COVARIANCE_BANDS, []
    for band in range(features.COVARIANCE_BANDS):
        total = np.zeros((6, 6), dtype=complex)
        for bin_ in range(1 + band * bins, 1 + (band + 1) * bins):
            for frame in spectra[:, bin_].T:
                total += np.outer(frame, frame.conj())
        total *= 6 / np.trace(total).real
        upper = [(p, q) for p in range(6) for q in range(p + 1, 6)]
        tensor.append(
            [total[p, p].real for p in range(6)]
            + [total[p].real for p in upper]
            + [total[p].imag for p in upper]
        )
    return np.array(tensor)


def test_the_covariance_is_the_recordings(case: tuple[Array, dict[str, Array], int, float]) -> None:
    samples, columns, _, _ = case
    assert np.allclose(
        columns["covariance"][0], literal_tensor(equations.spectra(samples)), atol=1e-4
    )


def test_the_gated_covariance_is_that_of_the_matched_filters(
    case: tuple[Array, dict[str, Array], int, float],
) -> None:
    samples, columns, lag, _ = case
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(64) / 64)
    segments = [
        np.correlate(row, PROBE.samples, "valid")[lag - 32 : lag + 32] * window for row in samples
    ]
    assert np.allclose(
        columns["covariance_gated"][0], literal_tensor(np.fft.rfft(segments)[..., None]), atol=1e-4
    )


def test_steering_at_the_echo_makes_it_all_ones() -> None:
    """A wave from the estimated direction is the same at every microphone, whatever the direction."""
    columns, _, _ = described(*(recordings(azimuth, noise=1e-4) for azimuth in GRID[[2, 11, 19]]))
    expected = np.concatenate([np.ones(21), np.zeros(15)])
    assert np.allclose(columns["covariance_steered"][:, :14], expected, atol=0.02)
    assert np.abs(columns["covariance_gated"][:, :14] - expected).max() > 1.0


def test_tensors_have_trace_m() -> None:
    columns, _, _ = described(
        recordings(0.4, noise=0.1), np.random.default_rng(0).standard_normal((6, 4000))
    )
    for name in features.TENSORS:
        assert np.allclose(columns[name][..., :6].sum(axis=-1), 6.0, atol=1e-4)


# ---------------------------------------------------------------- what can go wrong


def test_silence_has_finite_columns_and_leaves_its_neighbours_alone() -> None:
    sound = recordings(0.9, noise=0.1)
    columns, _, _ = described(np.zeros((6, 4000)), sound)
    alone, _, _ = described(sound)
    for name, column in columns.items():
        assert np.isfinite(column).all(), name
        assert np.allclose(column[1], alone[name][0], rtol=1e-3, atol=1e-3), name


def test_a_dead_microphone_has_finite_columns() -> None:
    for dead, localizer in ((0, Joint(azimuths=AZIMUTHS)), (3, None)):
        sound = recordings(0.9, noise=0.1)
        sound[dead] = 0.0
        with pytest.warns(SilentMicrophone):
            columns, _, _ = described(sound, localizer=localizer)
        assert all(np.isfinite(column).all() for column in columns.values())


@pytest.mark.parametrize("microphone", [0, 4])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_recordings_that_are_not_numbers_are_refused(microphone: int, value: float) -> None:
    broken = recordings(0.9, noise=0.1)
    broken[microphone, 1000] = value
    with pytest.raises(BadValue, match=r"^observation.samples=NaN or infinity: finite samples"):
        described(recordings(0.9, noise=0.1), broken)


def test_an_echo_outside_the_window_is_taken_at_its_edge() -> None:
    _, matched, echoes = described(recordings(0.9, noise=0.1))
    columns = features.describe(matched, replace(echoes, toa=np.array([[1.0]])))
    assert all(np.isfinite(column).all() for column in columns.values())
