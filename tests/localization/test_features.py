"""Columns and tensors against their definitions, and against changes that must not matter."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow, direction
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Array, Echoes
from echolearn.bench import equations
from echolearn.localization import features
from echolearn.localization.beamforming import azimuth_grid
from echolearn.localization.cfar import cfar
from echolearn.localization.columns import (
    AGREEMENT,
    CFAR,
    COLUMNS,
    COVARIANCE_BANDS,
    EVERY_COLUMN,
    EVERY_TENSOR,
    SEVERAL,
    TENSORS,
    tensor_shape,
)
from echolearn.localization.localize import describe, localize
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.joint import Joint
from echolearn.localization.separation import separate
from echolearn.localization.silence import SilentMicrophone
from reference import FIRST, LAST, RATE, loops, observed, padded, shift, turn, wave, white

PROBE = noise_probe(length=4000)
GRID = azimuth_grid(24)
GATED = Gated(azimuths=24)
OF_GAIN = {"gain": 10.0, "gain_delay": 10.0, "power": 20.0}


def noisy(azimuth, noise):
    return wave(PROBE, azimuth, 180) + white(PROBE, noise)


def estimated(*samples, localizer=GATED):
    batch = observed(PROBE, *samples)
    return MatchedFilter(batch, SearchWindow(), 24), localizer(batch)


def described(*samples, localizer=GATED):
    matched, echoes = estimated(*samples, localizer=localizer)
    return describe([matched], echoes, names=(*EVERY_COLUMN, *EVERY_TENSOR))


class Case(NamedTuple):
    """A recording (M, N), its description, and the lag and the azimuth estimated from it."""

    samples: Array
    columns: dict[str, float]
    tensors: dict[str, Array]
    lag: int
    azimuth: float


@pytest.fixture(scope="module", params=[0.05, 0.5])
def case(request):
    samples = wave(PROBE, 0.9, 180) + white(PROBE, request.param, 1)
    found = {name: column[0] for name, column in described(samples).items()}
    tensors = {name: found.pop(name) for name in EVERY_TENSOR}
    return Case(samples, found, tensors, round(found["toa"] * RATE), found["azimuth"])


def test_every_column_and_tensor_is_there_and_no_other():
    columns = described(noisy(0.4, 0.1), noisy(-1.0, 3.0))
    assert set(columns) == {*EVERY_COLUMN, *EVERY_TENSOR}
    for name in EVERY_COLUMN:
        assert columns[name].shape == (2,)
        assert columns[name].dtype == np.float64
    for name in EVERY_TENSOR:
        assert columns[name].shape == (2, *tensor_shape(name, 6))
    assert columns.pop("correlation_map").dtype == np.float16
    assert columns.pop("candidates").dtype == np.float32
    for name in {*EVERY_TENSOR} & {*columns}:
        microphones = 7 if name == "covariance_steered_ideal" else 6
        assert columns[name].dtype == np.float32
        trace = columns[name][..., :microphones].sum(axis=-1)
        assert np.allclose(trace, microphones, atol=1e-4)


def test_each_of_several_echoes_knows_its_rank_and_its_nearest_neighbour_besides():
    """Three waves by hand, strongest first; nothing else is described otherwise than before."""
    parts = [wave(PROBE, 0.4, 150, 0.1), wave(PROBE, 2.0, 210, 0.08), wave(PROBE, -1.5, 180, 0.06)]
    batch = observed(PROBE, sum(parts) + white(PROBE, 0.002))
    echoes, columns = localize(batch, Joint(echoes=3))
    assert set(columns) == {*COLUMNS, *SEVERAL, *TENSORS}
    assert np.array_equal(columns["rank"], [0.0, 1.0, 2.0])
    assert np.allclose(columns["neighbour_lag"], [30.0, 30.0, 30.0], atol=0.3)
    assert np.allclose(columns["neighbour_gain"], [0.6, 0.75, 10 / 6], rtol=0.05)
    views = separate(MatchedFilter(batch, SearchWindow()), echoes)
    for r, view in enumerate(views):
        one = Echoes(*(values[:, r : r + 1] for values in vars(echoes).values()))
        for name, column in describe([view], one).items():
            if not name.startswith(("power", "azimuth_mpdr", "covariance")):
                assert np.array_equal(column[0], columns[name][r]), name


def test_localize_gives_the_echoes_and_the_columns_that_are_asked_for():
    matched, echoes = estimated(noisy(0.4, 0.1))
    everything = describe([replace(matched, azimuths=180)], echoes)
    found, some = localize(matched.observation, GATED, names=["coherence", "joint"])
    assert np.array_equal(found.toa, echoes.toa)
    assert {"coherence", "joint"} <= set(some) <= set(everything) - {"power", *TENSORS}
    for name, column in some.items():
        assert np.array_equal(column, everything[name]), name


def test_columns_of_the_peak_are_their_definitions(case):
    r = np.correlate(case.samples[0], PROBE.samples, "valid")[FIRST : LAST + 1]
    index = case.lag - FIRST
    second = max(r[k] for k in range(len(r)) if abs(k - index) >= 5)
    under = case.samples[0, case.lag : case.lag + 1500]
    gain = r[index] / PROBE.energy
    expected = {
        "peak_to_rms": r[index] / np.sqrt(np.mean(r**2)),
        "second_to_first": second / r[index],
        "gain": gain,
        "gain_delay": 4 * np.pi * 343.0 * case.lag / RATE * gain,
    }
    assert {name: case.columns[name] for name in expected} == pytest.approx(expected)
    score = np.corrcoef(under, PROBE.samples)[0, 1]
    assert case.columns["score"] == pytest.approx(score, abs=2e-3)


def test_a_second_peak_is_five_lags_away_at_least():
    correlation = np.zeros((3, 40))
    correlation[:, 10] = 2.0
    correlation[[0, 1, 2], [14, 15, 5]] = 1.0, 1.5, 0.5
    columns = features.peak_columns(correlation, np.array([10, 10, 10]))
    assert columns["second_to_first"].tolist() == [0.0, 0.75, 0.25]
    rms = np.sqrt((4 + np.array([1.0, 2.25, 0.25])) / 40)
    assert np.allclose(columns["peak_to_rms"], 2.0 / rms)


def test_columns_of_the_steered_response_are_their_definitions(case):
    """The short transforms of the fast code cost about 1 % of the peak."""
    samples, burst = case.samples, PROBE.samples
    loop = loops(PROBE, samples, GRID)
    rows = [equations.steered(loop, angle) for angle in GRID]
    response = np.stack(rows)[:, FIRST : LAST + 1]
    nearest = np.abs(GRID - case.azimuth).argmin()
    here = response[nearest, case.lag - FIRST]
    rms = np.sqrt(np.mean(response**2))
    under = samples[:, case.lag : case.lag + 1500]
    energy = np.sqrt(np.sum(under**2, axis=-1)).sum() * np.sqrt(PROBE.energy)
    expected = {
        "joint": here / rms,
        "joint_max": response.max() / rms,
        "joint_ratio": here / response.max(),
        "joint_score": here / energy,
    }
    assert {n: case.columns[n] for n in expected} == pytest.approx(expected, rel=0.02)
    late = response.max(axis=0).argmax() - (case.lag - FIRST)
    assert case.columns["joint_lag"] == abs(late)

    ahead = loop.ahead(case.azimuth)
    aligned = np.array([np.correlate(y, burst, "valid")[case.lag] for y in ahead])
    coherence = aligned.sum() ** 2 / (6 * np.sum(aligned**2))
    assert case.columns["coherence"] == pytest.approx(coherence, rel=0.03)
    gated = equations.gated(loop, case.lag)
    ratio = 10 * np.log10(gated[nearest] / gated.mean())
    assert case.columns["gated_ratio"] == pytest.approx(ratio, abs=0.2)


def test_columns_of_agreement_are_their_definitions(case):
    """Microphone by microphone, pair by pair, direction by direction."""
    loop, middle = loops(PROBE, case.samples, GRID), case.lag - FIRST
    heard = [np.correlate(y, PROBE.samples, "valid") for y in case.samples]
    ahead = [np.correlate(y, PROBE.samples, "valid") for y in loop.ahead(case.azimuth)]
    close, wide, near = ([z[case.lag - k : case.lag + k + 1] for z in ahead] for k in (4, 8, 6))
    here = [z[case.lag] for z in ahead]
    larger = [np.mean(np.abs(heard[m][FIRST : LAST + 1]) > here[m]) for m in range(6)]
    pairs = [np.dot(p, q) / np.sqrt(np.dot(p, p) * np.dot(q, q)) for p in close for q in close]
    gated = equations.gated(loop, case.lag)
    turned = np.abs(turn(GRID - case.azimuth))
    response = np.stack([equations.steered(loop, angle) for angle in GRID])[:, FIRST : LAST + 1]
    other = [response[:, k].max() for k in range(LAST - FIRST + 1) if abs(k - middle) >= 5]
    expected = {
        "level": 1.0,
        "exceeded": np.mean(larger),
        "agreement": (sum(pairs) - 6) / 30,
        "coherence_wide": np.sum(sum(wide) ** 2) / (6 * sum(np.sum(z**2) for z in wide)),
        "peak_offset": np.mean([abs(int(np.argmax(z)) - 6) for z in near]),
        "peak_share": sum(here) / sum(max(z) for z in near),
        "direction_second": max(gated[turned > 0.52]) / gated[turned.argmin()],
        "joint_second": max(other) / sum(here),
    }
    found = {name: case.columns[name] for name in expected}
    assert {*found} == {*AGREEMENT}
    assert found == pytest.approx(expected, rel=0.03, abs=0.01)


def test_an_echo_from_above_is_level_with_nothing():
    """It lies on the array's axis, where a planar array hears the same everywhere."""
    above = np.tile(0.1 * shift(padded(PROBE.samples, 4000), 180), (6, 1))
    matched = MatchedFilter(observed(PROBE, above + white(PROBE, 1e-3)), SearchWindow(), 24)
    echoes = GATED(matched.observation)
    columns = describe([matched], echoes, names=AGREEMENT)
    assert columns["level"] == [0.0] and columns["agreement"] == pytest.approx(1.0, abs=1e-2)
    assert columns["peak_offset"] == [0.0] and columns["exceeded"] < 0.02


def test_columns_of_the_beam_are_the_papers(case):
    power = equations.mpdr(loops(PROBE, case.samples, GRID))
    expected = {
        "power": 10 * np.log10(power.max()),
        "power_ratio": 10 * np.log10(power.max() / power.mean()),
        "azimuth_mpdr": GRID[power.argmax()],
    }
    assert {n: case.columns[n] for n in expected} == pytest.approx(expected, abs=0.01)


def test_gain_changes_the_columns_that_have_it_and_no_other():
    columns = described(noisy(0.9, 0.3), 10.0 * noisy(0.9, 0.3))
    for name, (quiet, loud) in columns.items():
        change = OF_GAIN.get(name, 0.0)
        expected = quiet + change if name == "power" else quiet * (change or 1.0)
        assert np.allclose(loud, expected, rtol=1e-4, atol=1e-4), name
        assert (name in OF_GAIN) == (not np.allclose(loud, quiet, rtol=1e-4, atol=1e-4)), name


# ---------------------------------------------------------------- tensors


def literal_tensor(spectra):
    """Return the packed band averages of spectra (M, F, T) by loops, shape (bands, 36)."""
    bins, tensor = (spectra.shape[1] - 1) // COVARIANCE_BANDS, []
    upper = [(p, q) for p in range(6) for q in range(p + 1, 6)]
    for band in range(COVARIANCE_BANDS):
        total = np.zeros((6, 6), dtype=complex)
        for bin_ in range(1 + band * bins, 1 + (band + 1) * bins):
            for frame in spectra[:, bin_].T:
                total += np.outer(frame, frame.conj())
        total *= 6 / np.trace(total).real
        above = np.array([total[p] for p in upper])
        tensor.append([*np.diagonal(total).real, *above.real, *above.imag])
    return np.array(tensor)


def test_covariances_are_those_of_the_recording_and_of_its_matched_filters(case):
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(64) / 64)
    near = slice(case.lag - 32, case.lag + 32)
    segments = [np.correlate(y, PROBE.samples, "valid")[near] * window for y in case.samples]
    expected = {
        "covariance": equations.spectra(case.samples),
        "covariance_gated": np.fft.rfft(segments)[..., None],
    }
    for name, spectra in expected.items():
        assert np.allclose(case.tensors[name], literal_tensor(spectra), atol=1e-4), name


def test_steering_at_the_echo_makes_it_all_ones():
    """A wave from the estimated direction is the same at every microphone, wherever from."""
    columns = described(*(noisy(azimuth, 1e-4) for azimuth in GRID[[2, 11, 19]]))
    expected = np.concatenate([np.ones(21), np.zeros(15)])
    assert np.allclose(columns["covariance_steered"][:, :14], expected, atol=0.02)
    assert np.abs(columns["covariance_gated"][:, :14] - expected).max() > 1.0


def test_an_ideal_echo_is_one_more_microphone(case):
    """Microphone 1 is not steered, so what stands for it and the ideal echo follows by hand; what
    stands for the array alone is as without that echo, but for a factor on each band."""
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(64) / 64)
    r = np.correlate(case.samples[0], PROBE.samples, "valid")
    pulse = np.correlate(PROBE.samples, PROBE.samples, "full")[1500 - 33 : 1500 + 31]
    rms = np.sqrt(np.mean(r[FIRST : LAST + 1] ** 2))
    heard = np.fft.rfft(window * r[case.lag - 32 : case.lag + 32])
    ideal = np.fft.rfft(window * pulse * rms / PROBE.energy)
    upper = [(p, q) for p in range(7) for q in range(p + 1, 7)]
    beside = 7 + upper.index((0, 6))
    array = [*range(6), *(7 + k for k, (_, q) in enumerate(upper) if q < 6)]

    for band, tensor in enumerate(case.tensors["covariance_steered_ideal"]):
        bins = slice(1 + 2 * band, 3 + 2 * band)
        cross = np.sum(heard[bins] * ideal[bins].conj())
        expected = [np.sum(np.abs(heard[bins]) ** 2), cross.real, cross.imag]
        energy = np.sum(np.abs(ideal[bins]) ** 2)
        found = tensor[[0, beside, beside + len(upper)]] / tensor[6]
        assert np.allclose(found, expected / energy, rtol=1e-3, atol=1e-3), band
        without = case.tensors["covariance_steered"][band, :21]
        assert np.allclose(tensor[array] / tensor[0], without / without[0], atol=1e-3), band


# ---------------------------------------------------------------- what can go wrong


def test_silence_has_finite_columns_and_leaves_its_neighbours_alone():
    sound = noisy(0.9, 0.1)
    columns, alone = described(np.zeros((6, 4000)), sound), described(sound)
    for name, column in columns.items():
        assert np.isfinite(column).all(), name
        assert np.allclose(column[1], alone[name][0], rtol=1e-3, atol=1e-3), name


@pytest.mark.parametrize(("dead", "localizer"), [(0, Joint(azimuths=24)), (3, GATED)])
def test_a_dead_microphone_has_finite_columns(dead, localizer):
    sound = noisy(0.9, 0.1)
    sound[dead] = 0.0
    with pytest.warns(SilentMicrophone):
        columns = described(sound, localizer=localizer)
    assert all(np.isfinite(column).all() for column in columns.values())


def test_an_echo_outside_the_window_is_taken_at_its_edge():
    matched, echoes = estimated(noisy(0.9, 0.1))
    columns = describe([matched], replace(echoes, toa=np.array([[1.0]])))
    assert all(np.isfinite(column).all() for column in columns.values())


def test_cfar_divides_by_the_ring_around_the_echo():
    """A literal loop over cells; what is within the guard, or far away, does not count."""
    matched, echoes = estimated(noisy(0.4, 0.1), noisy(-2.9, 0.5))
    index = matched.index(echoes.toa[:, 0])
    toward = direction(echoes.azimuth[:, 0], echoes.elevation[:, 0])
    found = cfar(matched, index, toward=toward)
    here = features.steered_columns(matched, index, toward=toward)
    rms = np.sqrt(np.mean(np.square(matched.steered, dtype=float), axis=(1, 2)))
    grid = direction(*matched.directions)
    for row in range(2):
        cells = []
        for cell, power in np.ndenumerate(np.square(matched.steered[row], dtype=float)):
            late = abs(cell[1] - index[row])
            angle = np.degrees(np.arccos(np.clip(grid[cell[0]] @ toward[row], -1, 1)))
            near = late < 5 and angle < 30 - 1e-6
            if late <= 32 and angle <= 90 + 1e-6 and not near:
                cells.append(power)
        joint = here["joint"][row] * rms[row]
        assert found[row] == pytest.approx(joint / np.sqrt(np.mean(cells)), rel=1e-5)


def test_cfar_does_not_know_the_gain_and_falls_with_noise_where_the_echo_is():
    quiet, loud, turned_up = (
        described(each)[CFAR][0]
        for each in (noisy(0.4, 0.1), noisy(0.4, 1.0), 7.0 * noisy(0.4, 0.1))
    )
    assert turned_up == pytest.approx(quiet) and quiet > 1.3 * loud
