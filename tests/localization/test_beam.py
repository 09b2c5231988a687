"""Beamforming against LAPACK, explicit sums, and plane waves whose direction is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import reference
from echolearn.acoustics import signals
from echolearn.acoustics.geometry import circular_array
from echolearn.bench import equations
from echolearn.localization import beamforming

RING = circular_array()
GRID = beamforming.azimuth_grid(60)
BINS = np.fft.rfftfreq(882, 1 / 22050.0)


def hermitian(rng: np.random.Generator, *shape: int, size: int = 6) -> np.ndarray:
    """Draw positive definite Hermitian matrices of shape (*shape, size, size)."""
    factor = rng.standard_normal((*shape, size, 3 * size)) + 1j * rng.standard_normal(
        (*shape, size, 3 * size)
    )
    return factor @ np.moveaxis(factor, -1, -2).conj() / (6 * size)


def weights(azimuths: int = 60) -> np.ndarray:
    """Return the packed steering of the paper's ring and STFT."""
    return beamforming.steering_weights(
        RING, azimuths, 1, frame=882, sample_rate=22050.0, speed_of_sound=343.0
    )


def wave(azimuth: float, *, seed: int = 0, length: int = 8000) -> np.ndarray:
    """Return a plane wave of white noise at the microphones, shape (M, N)."""
    source = np.random.default_rng(seed).standard_normal(length)
    return reference.plane_wave(source, RING.positions, azimuth, rate=22050.0)


# ---------------------------------------------------------------- grids, steering


def test_grids_by_hand() -> None:
    assert np.allclose(beamforming.azimuth_grid(4), [-np.pi, -np.pi / 2, 0, np.pi / 2])
    azimuth, elevation = beamforming.direction_grid(4, 3)
    assert np.allclose(azimuth, np.tile(beamforming.azimuth_grid(4), 3))
    assert np.allclose(elevation, np.repeat([np.pi / 2, np.pi / 3, np.pi / 6], 4))


def test_steering_is_the_spectrum_of_a_plane_wave() -> None:
    spectrum = np.fft.rfft(wave(0.9))[:, 100]
    frequency = np.fft.rfftfreq(8000, 1 / 22050.0)[100:101]
    vector = beamforming.steering(
        RING, np.array([0.9]), np.array([np.pi / 2]), frequencies=frequency, speed_of_sound=343.0
    )[0, 0]
    ratio = spectrum / vector
    assert np.allclose(ratio, ratio[0])


def test_steering_weights_are_made_once() -> None:
    assert weights() is weights()
    assert weights().shape == (442, 36, 60)
    assert not np.array_equal(
        weights()[100],
        beamforming.steering_weights(
            circular_array(radius=0.1), 60, 1, frame=882, sample_rate=22050.0, speed_of_sound=343.0
        )[100],
    )


# ---------------------------------------------------------------- matrices


@given(st.integers(1, 8), st.integers(0, 2**32))
@settings(max_examples=30)
def test_packing_holds_the_quadratic_form(size: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    matrix, vector = (
        hermitian(rng, size=size),
        rng.standard_normal(size) + 1j * rng.standard_normal(size),
    )
    packed = beamforming.pack_hermitian(matrix)
    assert packed.shape == (size * size,)
    assert packed @ beamforming.pack_steering(vector) == pytest.approx(
        (vector.conj() @ matrix @ vector).real
    )


def test_a_packed_matrix_by_hand() -> None:
    matrix = np.array([[1, 2 + 3j, 4], [2 - 3j, 5, 6j], [4, -6j, 7]])
    assert np.array_equal(beamforming.pack_hermitian(matrix), [1, 5, 7, 2, 4, 0, 3, 0, 6])


def test_quadratic_forms_of_a_block_are_those_of_a_loop() -> None:
    rng = np.random.default_rng(1)
    matrices, vectors = (
        hermitian(rng, 2, 5),
        rng.standard_normal((5, 7, 6)) + 1j * rng.standard_normal((5, 7, 6)),
    )
    found = beamforming.quadratic(matrices, np.moveaxis(beamforming.pack_steering(vectors), -1, -2))
    for bin_, block, angle in np.ndindex(5, 2, 7):
        d = vectors[bin_, angle]
        assert found[bin_, block, angle] == pytest.approx(
            (d.conj() @ matrices[block, bin_] @ d).real
        )


@given(st.integers(1, 8), st.integers(0, 2**32))
@settings(max_examples=30)
def test_inverses_are_lapacks_and_the_argument_stays(size: int, seed: int) -> None:
    matrices = hermitian(np.random.default_rng(seed), 3, size=size)
    before = matrices.copy()
    assert np.allclose(beamforming.invert(matrices), np.linalg.inv(before))
    assert np.array_equal(matrices, before)


def test_inverses_in_single_precision_are_good_enough() -> None:
    """The loading of Eq. 18 bounds the condition number by 1 + M (1 - g) / g = 55, even for one
    plane wave."""
    spectra = signals.stft(wave(0.4).astype(np.float32)[None])
    loaded = beamforming.regularize(beamforming.covariance(spectra), 0.1)
    exact = np.linalg.inv(loaded.astype(complex))
    error = np.linalg.norm(beamforming.invert(loaded) - exact, axis=(-2, -1)) / np.linalg.norm(
        exact, axis=(-2, -1)
    )
    assert loaded.dtype == np.complex64
    assert error.max() < 1e-4


def test_covariances_are_mean_outer_products() -> None:
    rng = np.random.default_rng(2)
    spectra = rng.standard_normal((2, 4, 3, 9)) + 1j * rng.standard_normal((2, 4, 3, 9))
    found = beamforming.covariance(spectra)
    assert found.shape == (2, 3, 4, 4)
    for block, bin_ in np.ndindex(2, 3):
        frames = spectra[block, :, bin_]
        assert np.allclose(found[block, bin_], sum(np.outer(y, y.conj()) for y in frames.T) / 9)


@pytest.mark.parametrize("gamma", [0.0, 0.1, 1.0])
def test_regularization_is_eq_18(gamma: float) -> None:
    matrix = hermitian(np.random.default_rng(3))
    expected = (1 - gamma) * matrix + gamma * np.trace(matrix).real / 6 * np.eye(6)
    assert np.allclose(beamforming.regularize(matrix, gamma), expected)


# ---------------------------------------------------------------- beam power


@pytest.mark.parametrize("gamma", [0.0, 0.1, 1.0])
def test_a_white_covariance_reduces_mpdr_to_delay_and_sum(gamma: float) -> None:
    white = np.broadcast_to(2.5 * np.eye(6, dtype=complex), (1, 442, 6, 6))
    power = beamforming.mpdr_power(white, weights(), gamma=gamma)
    assert np.allclose(power, 442 * 2.5 / 6, rtol=1e-5)
    assert np.allclose(power, beamforming.delay_and_sum_power(white, weights()), rtol=1e-5)


def test_full_loading_turns_mpdr_into_a_constant_and_none_hurts_delay_and_sum() -> None:
    """With g = 1, R_bar = tr(R)/M I whatever R is; 1 / (d^H R_bar^-1 d) = tr(R) / M^2."""
    matrices = hermitian(np.random.default_rng(4), 1, 442)
    expected = np.trace(matrices, axis1=-2, axis2=-1).real.sum() / 36
    assert np.allclose(beamforming.mpdr_power(matrices, weights(), gamma=1.0), expected, rtol=1e-5)


def test_mpdr_never_passes_more_than_delay_and_sum() -> None:
    """Both pass the look direction undistorted and MPDR passes least of all such beamformers
    (Capon)."""
    matrices = hermitian(np.random.default_rng(5), 3, 442)
    loaded = beamforming.regularize(matrices, 0.1)
    assert (
        beamforming.mpdr_power(matrices, weights(), gamma=0.1)
        <= beamforming.delay_and_sum_power(loaded, weights()) * (1 + 1e-6)
    ).all()


@pytest.mark.parametrize("azimuth", [-2.5, -0.3, 0.0, 1.2, 3.0])
def test_both_beams_point_at_a_plane_wave(azimuth: float) -> None:
    covariances = beamforming.covariance(signals.stft(wave(azimuth)[None]))
    for power in (
        beamforming.mpdr_power(covariances, weights(), gamma=0.1),
        beamforming.delay_and_sum_power(covariances, weights()),
    ):
        error = np.angle(np.exp(1j * (GRID[power[0].argmax()] - azimuth)))
        assert abs(error) <= np.pi / 60 + 1e-9


def test_mpdr_power_is_the_papers_loop() -> None:
    rng = np.random.default_rng(6)
    recording = (
        wave(0.7, length=3000)
        + 0.5 * wave(-2.0, seed=1, length=3000)
        + 0.3 * rng.standard_normal((6, 3000))
    )
    found = beamforming.mpdr_power(
        beamforming.covariance(signals.stft(recording[None])), weights(12), gamma=0.1
    )[0]
    assert np.allclose(
        found,
        equations.mpdr(recording, RING.positions, beamforming.azimuth_grid(12), rate=22050.0),
        rtol=1e-4,
    )


# ---------------------------------------------------------------- steered matched filters


def test_advancing_by_whole_samples_reads_ahead() -> None:
    correlation = np.random.default_rng(7).standard_normal((2, 3, 50))
    found = correlations.advance(correlation, np.array([[0.0, 4.0, -3.0]]))
    assert found.shape == (2, 1, 3, 50)
    assert np.allclose(found[:, 0, 0], correlation[:, 0])
    assert np.allclose(found[:, 0, 1], np.roll(correlation[:, 1], -4, axis=-1))
    assert np.allclose(found[:, 0, 2], np.roll(correlation[:, 2], 3, axis=-1))


def test_advancing_by_fractions_is_band_limited() -> None:
    lags = np.arange(200)
    pulse = np.exp(-0.5 * ((lags - 100) / 3) ** 2)
    found = correlations.advance(pulse[None], np.array([[2.37]]))[0, 0]
    assert np.allclose(found, np.exp(-0.5 * ((lags + 2.37 - 100) / 3) ** 2), atol=1e-6)


def test_the_steered_response_is_the_sum_of_literal_fractional_delays() -> None:
    """Padded by `PAD` lags, the short transform agrees with one over the whole recording to 1 % of
    the peak."""
    probe = signals.noise_probe(length=6000)
    source = equations.shift(equations.padded(probe.samples, 6000), 180)
    recording = reference.plane_wave(source, RING.positions, 0.9, rate=22050.0)
    first, last = 116 - correlations.PAD, 244 + correlations.PAD
    correlation = signals.matched_filter(recording[None], probe, first=first, last=last)
    angles = np.array([-2.0, 0.0, 0.9, 2.4])
    found = correlations.steered_response(
        correlation, RING, angles, np.full(4, np.pi / 2), scale=22050.0 / 343.0
    )
    assert found.shape == (1, 4, last - first + 1)
    for row, angle in zip(found[0], angles, strict=True):
        expected = equations.steered(recording, probe.samples, RING.positions, angle, rate=22050.0)[
            first : last + 1
        ]
        inside = slice(correlations.PAD, -correlations.PAD)
        assert np.abs(row - expected)[inside].max() < 0.01 * 6 * probe.samples @ probe.samples


def test_steering_at_a_plane_wave_adds_all_microphones_up() -> None:
    """J peaks where the wave reaches microphone 1, at M ||s||^2."""
    probe = signals.noise_probe(length=6000)
    source = equations.shift(equations.padded(probe.samples, 6000), 180)
    recording = reference.plane_wave(source, RING.positions, 0.0, rate=22050.0)
    correlation = signals.matched_filter(recording[None], probe, first=52, last=308)
    response = correlations.steered_response(
        correlation, RING, GRID, np.full(60, np.pi / 2), scale=22050.0 / 343.0
    )[0]
    angle, lag = np.unravel_index(response.argmax(), response.shape)
    assert GRID[angle] == pytest.approx(0.0, abs=1e-12)
    assert 52 + lag == 167  # 180 - 0.2 m / c = 167.14
    assert response.max() == pytest.approx(6 * probe.samples @ probe.samples, rel=0.05)
