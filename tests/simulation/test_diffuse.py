"""Diffuse noise: microphones agree as in a field from all sides, whatever the noise; the package of
Habets agrees."""

from itertools import combinations

import numpy as np
import pytest
from scipy.special import j0

from echolearn.acoustics.types import MicArray
from echolearn.simulation.noise.diffuse import Diffuse, _mixing, mix
from reference import RATE, RING, SPEED
from refusals import refused
from sounds import draw, hiss

FREE = MicArray(
    np.array([[0.3, 0.0, 0.1], [-0.1, 0.25, 0.0], [0.0, -0.2, -0.15], [0.05, 0.0, 0.0]])
)
FREQUENCIES = np.fft.rfftfreq(2048, 1 / RATE)


def spectra(samples, frame=2048):
    """Return spectra of frames that do not overlap, shape (M, F, T)."""
    frames = samples[:, : samples.shape[1] // frame * frame].reshape(len(samples), -1, frame)
    return np.moveaxis(np.fft.rfft(frames * np.hanning(frame)), 1, 2)


def estimate(values):
    """Return the coherence matrix of independent observations (M, F, T), shape (F, M, M)."""
    cross = np.einsum("pft,qft->fpq", values, values.conj())
    power = np.sqrt(np.einsum("fpp->fp", cross).real)
    return cross / (power[:, :, None] * power[:, None])


@pytest.fixture(scope="module")
def root():
    """Return the roots of the ring's coherence."""
    return _mixing(RING, bins=1025, sample_rate=RATE, speed_of_sound=SPEED)


@pytest.mark.parametrize(("array", "speed"), [(RING, SPEED), (FREE, 171.5)], ids=["ring", "free"])
def test_every_pair_of_microphones_agrees_as_in_a_diffuse_field(array, speed):
    """Of T independent frames, coherence c is estimated within sqrt((1 - c^2)^2 / 2T) (real part),
    sqrt((1 - c^2) / 2T) (imaginary part)."""
    values = spectra(draw(Diffuse(hiss, speed), 1_200_000, array=array))
    found = estimate(values)[2:-2]
    for p, q in combinations(range(len(array)), 2):
        distance = np.linalg.norm(array.positions[p] - array.positions[q])
        expected = j0(2 * np.pi * FREQUENCIES[2:-2] * distance / speed)
        rest = 1 - expected**2
        trials = 2 * values.shape[2]
        real = (found[:, p, q].real - expected) / np.sqrt((rest**2 + 1e-4) / trials)
        imaginary = found[:, p, q].imag / np.sqrt((rest + 1e-4) / trials)
        for score in (real, imaginary):
            assert abs(np.mean(score**2) - 1.0) < 0.3, (p, q)
            assert np.abs(score).max() < 6.5, (p, q)
            assert abs(score.mean()) < 0.3, (p, q)


def test_matrices_are_those_of_the_package(root):
    anf = pytest.importorskip("anf_generator").CoherenceMatrix
    about = anf.Parameters(RING.positions, "cylindrical", RATE, nfft=2048, c=SPEED)
    matrices = np.moveaxis(anf.CoherenceMatrix(about).matrix, -1, 0)
    assert np.allclose(root @ root.mT, matrices, atol=1e-9)
    assert np.allclose(root, root.mT)


def test_mixing_is_a_linear_filter_of_phase_zero_without_a_trace_of_frames(root):
    """An impulse anywhere in a frame comes out as the same kernel, symmetric in time, with all of
    its energy."""
    kernels = []
    for place in (2048, 2500, 3071):
        impulse = np.zeros((6, 6000))
        impulse[0, place] = 1.0
        kernels.append(mix(impulse, root)[:, place - 500 : place + 501])
    assert np.allclose(kernels, kernels[0], atol=1e-12)
    assert np.allclose(kernels[0], kernels[0][:, ::-1], atol=1e-12)
    assert np.sum(kernels[0] ** 2) == pytest.approx(1.0, abs=0.01)  # diagonal of J is 1


def test_one_microphone_records_the_source_as_it_is():
    source = np.random.default_rng(3).standard_normal(5000 + 1024)[512:5512]
    [recorded] = draw(Diffuse(hiss), 5000, seed=3, array=MicArray(RING.positions[:1]))
    assert np.allclose(recorded, source / np.sqrt(np.mean(source**2)))


@pytest.mark.parametrize(
    ("name", "value"), [("frame", 10), ("frame", 100.5), ("speed_of_sound", 0.343)]
)
def test_bad_fields_are_refused(name, value):
    with refused(f"diffuse.{name}={value} "):
        Diffuse(hiss, **{name: value})
