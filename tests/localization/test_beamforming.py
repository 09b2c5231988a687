"""Beamforming against LAPACK, explicit sums, and plane waves whose direction is known."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from llvmlite.binding import get_host_cpu_features

import reference
from echolearn.acoustics.types import Observation, Probe
from echolearn.bench import equations
from echolearn.localization import beamforming, covariance_loops
from interpreted import LANES, fused, interpret
from reference import RATE, RING, loops

SIZE = st.integers(1, 8)
SEED = st.integers(0, 2**32)


def hermitian(rng, *shape, size=6):
    """Draw positive definite Hermitian matrices of shape (*shape, size, size)."""
    real, imaginary = rng.standard_normal((2, *shape, size, 3 * size))
    factor = real + 1j * imaginary
    return factor @ factor.conj().mT / (6 * size)


def weights(array=RING):
    """Return the packed steering of the paper's STFT."""
    return beamforming.steering_weights(
        array, azimuths=60, elevations=1, sample_rate=RATE, speed_of_sound=343.0
    )


def delay_and_sum_power(covariances):
    """Return d^H R d / M^2 summed over bins, shape (B, A)."""
    return np.sum(beamforming.quadratic(covariances, weights()), axis=0) / 36


def noise_wave(azimuth, *, length=8000):
    """Return a plane wave of white noise at the microphones, shape (M, N)."""
    source = np.random.default_rng(0).standard_normal(length)
    return reference.plane_wave(source, RING.positions, azimuth, rate=RATE)


def test_grids_by_hand():
    assert np.allclose(beamforming.azimuth_grid(4), [-np.pi, -np.pi / 2, 0, np.pi / 2])
    azimuth, elevation = beamforming.direction_grid(4, 3)
    assert np.allclose(azimuth, np.tile(beamforming.azimuth_grid(4), 3))
    assert np.allclose(elevation, np.repeat([np.pi / 2, np.pi / 3, np.pi / 6], 4))


# ---------------------------------------------------------------- covariances


@pytest.mark.parametrize(("microphones", "length"), [(2, 882), (6, 5000), (5, 4411)])
def test_compiled_covariances_are_sums_over_frames(microphones, length):
    samples = np.random.default_rng(length).standard_normal((microphones, length))
    hann = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(882) / 882)
    expected = np.zeros((442, microphones, microphones), complex)
    starts = range(0, length - 881, 441)
    for start in starts:
        spectra = np.fft.rfft(samples[:, start : start + 882] * hann)
        for f in range(442):
            expected[f] += np.outer(spectra[:, f], spectra[:, f].conj()) / len(starts)
    for way in (beamforming.compiled_covariance, beamforming.plain_covariance):
        assert np.allclose(way(samples), expected, atol=1e-5 * np.abs(expected).max(), rtol=0)


@pytest.mark.parametrize("microphones", [2, 3, 6])
def test_compiled_inverses_are_those_of_each_matrix(microphones):
    samples = np.random.default_rng(microphones).standard_normal((3, microphones, 2000))
    samples[1, 0] = 0.0  # one is silent
    covariances = np.stack([beamforming.plain_covariance(each) for each in samples])
    compiled = beamforming.compiled_inverses(covariances, 0.1)
    plain = beamforming.plain_inverses(covariances, 0.1)
    for b, f in np.ndindex(3, 442):
        matrix = covariances[b, f].astype(complex)
        level = np.trace(matrix).real / microphones
        expected = np.linalg.inv(0.9 * matrix + 0.1 * level * np.eye(microphones))
        packed = beamforming.pack_hermitian(expected)
        for way in (compiled, plain):
            assert np.allclose(way[:, f, b], packed, atol=1e-4 * np.abs(packed).max(), rtol=0)
    # Where the processor multiplies and adds at once the bits are those of NumPy.
    if get_host_cpu_features().get("fma"):
        assert compiled.tobytes() == plain.tobytes()


def test_as_python_the_loops_are_sums_over_frames_and_inverses(monkeypatch):
    """Four of the six bins at once, so that the last four are not all new."""
    interpret(covariance_loops, monkeypatch, _fma=fused, BLOCK=4, **LANES)
    rng = np.random.default_rng(3)
    recording, window = rng.standard_normal((2, 25)), rng.uniform(size=10)
    spectra = np.fft.rfft(covariance_loops.frames(recording, window)).astype(np.complex64)
    covariances = covariance_loops.frames_covariance(spectra)
    loading = np.full((1, 6), 0.2, np.float32)
    given = {"keep": 0.9, "loading": loading}
    planes = covariance_loops.packed_inverses(covariances[None], **given)

    starts = (0, 5, 10, 15)
    frames = np.stack([recording[:, start : start + 10] * window for start in starts])
    for f, bins in enumerate(np.moveaxis(np.fft.rfft(frames), -1, 0)):
        expected = sum(np.outer(each, each.conj()) for each in bins) / len(starts)
        assert np.allclose(covariances[f], expected, atol=1e-6)
        inverse = np.linalg.inv(0.9 * expected + 0.2 * np.eye(2))
        packed = beamforming.pack_hermitian(inverse)
        assert np.allclose(planes[:, 0, f], packed, atol=1e-5)


def test_the_sum_of_inverse_powers_takes_bins_in_their_order():
    rng = np.random.default_rng(4)
    packed = rng.uniform(0.5, 1.5, (3 * beamforming.BINS + 5, 4, 9)).astype(np.float32)
    weights = rng.uniform(0.5, 1.5, (len(packed), 9, 20)).astype(np.float32)
    expected = np.zeros((4, 20), np.float32)
    for row, weight in zip(packed, weights, strict=True):
        expected = expected + np.float32(1.0) / (row @ weight)
    assert np.array_equal(beamforming.sum_of_inverses(packed, weights), expected)


# ---------------------------------------------------------------- matrices


@given(SIZE, SEED)
@settings(max_examples=30)
def test_packing_holds_the_quadratic_form(size, seed):
    rng = np.random.default_rng(seed)
    matrix = hermitian(rng, size=size)
    vector = rng.standard_normal(size) + 1j * rng.standard_normal(size)
    packed = beamforming.pack_hermitian(matrix)
    assert packed.shape == (size * size,)
    expected = (vector.conj() @ matrix @ vector).real
    assert packed @ beamforming.pack_steering(vector) == pytest.approx(expected)


def test_a_packed_matrix_by_hand():
    matrix = np.array([[1, 2 + 3j, 4], [2 - 3j, 5, 6j], [4, -6j, 7]])
    assert np.array_equal(beamforming.pack_hermitian(matrix), [1, 5, 7, 2, 4, 0, 3, 0, 6])


@given(SIZE, SEED)
@settings(max_examples=30)
def test_inverses_are_lapacks_and_the_argument_stays(size, seed):
    matrices = hermitian(np.random.default_rng(seed), 3, size=size)
    before = matrices.copy()
    assert np.allclose(beamforming.invert(matrices), np.linalg.inv(before))
    assert np.array_equal(matrices, before)


# ---------------------------------------------------------------- beam power


@pytest.mark.parametrize("gamma", [0.0, 0.1, 1.0])
def test_a_white_covariance_reduces_mpdr_to_delay_and_sum(gamma):
    white = np.broadcast_to(2.5 * np.eye(6, dtype=complex), (1, 442, 6, 6))
    power = beamforming.mpdr_power(white, weights(), gamma=gamma)
    assert np.allclose(power, 442 * 2.5 / 6, rtol=1e-5)
    assert np.allclose(power, delay_and_sum_power(white), rtol=1e-5)


def test_mpdr_passes_at_most_what_delay_and_sum_does_and_a_constant_with_full_loading():
    """Both pass the look direction undistorted and MPDR passes least of all such beamformers
    (Capon). With g = 1, R_bar = tr(R)/M I whatever R is; 1 / (d^H R_bar^-1 d) = tr(R) / M^2."""
    matrices = hermitian(np.random.default_rng(5), 3, 442)
    power = beamforming.mpdr_power(matrices, weights(), gamma=0.1)
    most = delay_and_sum_power(beamforming.regularize(matrices, 0.1))
    assert (power <= most * (1 + 1e-6)).all()
    constant = np.trace(matrices, axis1=-2, axis2=-1).real.sum(axis=-1, keepdims=True) / 36
    loaded = beamforming.mpdr_power(matrices, weights(), gamma=1.0)
    assert np.allclose(loaded, constant, rtol=1e-5)


def test_mpdr_is_the_papers_loop_with_and_without_some_microphones():
    """Microphones 2 and 5 are left out of the second recording."""
    noise = np.random.default_rng(6).standard_normal((2, 6, 3000))
    batch = Observation(noise_wave(0.7, length=3000) + noise, Probe(np.ones(9), RATE, 3000), RING)
    silent = np.zeros((2, 6), dtype=bool)
    silent[1, [1, 4]] = True
    found = beamforming.Mpdr(12).without(batch, silent)
    assert np.array_equal(found[:1], beamforming.Mpdr(12)(batch)[:1])
    for row, samples in enumerate(batch.samples):
        left = ~silent[row]
        loop = loops(batch.probe, samples[left], beamforming.azimuth_grid(12))
        expected = equations.mpdr(replace(loop, positions=RING.positions[left]))
        assert np.allclose(found[row], expected, rtol=1e-3)
