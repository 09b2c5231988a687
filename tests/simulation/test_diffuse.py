"""Diffuse noise: microphones agree as in a field from all sides, whatever the noise; the package of
Habets agrees."""

from itertools import combinations

import numpy as np
import pytest
from scipy import signal
from scipy.special import j0

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.types import MicArray
from echolearn.checks import BadValue
from echolearn.simulation.noise.diffuse import Diffuse, _mixing, coherence, mix
from echolearn.simulation.noise.rotor import Rotor

RATE = 22050.0
RING = circular_array()
FREE = MicArray(
    np.array([[0.3, 0.0, 0.1], [-0.1, 0.25, 0.0], [0.0, -0.2, -0.15], [0.05, 0.0, 0.0]])
)


class Plain:
    """White noise at one point."""

    def __call__(self, *, length, sample_rate, rng):
        """Return white noise."""
        return rng.standard_normal(length)


def spectra(samples, frame):
    """Return spectra of frames that do not overlap, shape (M, F, T)."""
    frames = samples[:, : samples.shape[1] // frame * frame].reshape(len(samples), -1, frame)
    return np.moveaxis(np.fft.rfft(frames * np.hanning(frame)), 1, 2)


def estimate(values):
    """Return the coherence matrix of independent observations (M, F, T), shape (F, M, M)."""
    cross = np.einsum("pft,qft->fpq", values, values.conj())
    power = np.sqrt(np.einsum("fpp->fp", cross).real)
    return cross / (power[:, :, None] * power[:, None])


def roots():
    """Return the roots of the ring's coherence."""
    places = tuple(map(tuple, RING.positions.tolist()))
    return _mixing(places, bins=1025, sample_rate=RATE, speed_of_sound=343.0)


@pytest.mark.parametrize("array", [RING, FREE], ids=["ring", "free"])
def test_every_pair_of_microphones_agrees_as_in_a_diffuse_field(array):
    """Of T independent frames, coherence c is estimated within sqrt((1 - c^2)^2 / 2T) (real part),
    1 / sqrt(2T)."""
    samples = Diffuse(Plain())(
        array, length=1_200_000, sample_rate=RATE, rng=np.random.default_rng(0)
    )
    values = spectra(samples, 2048)
    found, trials = estimate(values), values.shape[2]
    frequencies = np.fft.rfftfreq(2048, 1 / RATE)
    used = slice(2, -2)
    for p, q in combinations(range(len(array)), 2):
        apart = np.linalg.norm(array.positions[p] - array.positions[q])
        expected = j0(2 * np.pi * frequencies * apart / 343.0)[used]
        spread = np.sqrt(((1 - expected**2) ** 2 + 1e-4) / (2 * trials))
        real = (found[used, p, q].real - expected) / spread
        imaginary = found[used, p, q].imag / np.sqrt((1 - expected**2 + 1e-4) / (2 * trials))
        for score in (real, imaginary):
            assert abs(np.mean(score**2) - 1.0) < 0.3, (p, q)
            assert np.abs(score).max() < 6.5, (p, q)
            assert abs(score.mean()) < 0.3, (p, q)


def test_a_rotor_is_as_diffuse_as_white_noise():
    """One frame from each draw: lines keep their phase within one, so only draws are independent."""
    rng, field = np.random.default_rng(1), Diffuse(Rotor())
    draws = [field(RING, length=4096, sample_rate=RATE, rng=rng) for _ in range(250)]
    values = np.stack([np.fft.rfft(draw * np.hanning(4096)) for draw in draws], axis=2)
    found, frequencies = estimate(values), np.fft.rfftfreq(4096, 1 / RATE)
    for hertz in (70.0, 140.0, 280.0, 500.0, 1000.0, 3000.0):
        index = np.abs(frequencies - hertz).argmin()
        expected = coherence(RING.positions, frequencies[[index]], speed_of_sound=343.0)[0]
        assert np.abs(found[index] - expected).max() < 5 / np.sqrt(2 * 250) + 0.02, hertz


def test_matrices_are_roots_of_the_coherence_and_those_of_the_package():
    anf = pytest.importorskip("anf_generator")
    about = anf.CoherenceMatrix.Parameters(RING.positions, "cylindrical", RATE, nfft=2048, c=343.0)
    expected = np.moveaxis(anf.CoherenceMatrix.CoherenceMatrix(about).matrix, -1, 0)
    root = roots()
    assert np.allclose(root @ root.mT, expected, atol=1e-9)
    assert np.allclose(root, root.mT)


def test_the_field_is_no_worse_than_that_of_the_package():
    """The same segments mixed by both, the coherence of each against J0; the package overlaps
    frames by a quarter."""
    anf = pytest.importorskip("anf_generator")
    segments = np.random.default_rng(2).standard_normal((6, 800_000))
    about = anf.CoherenceMatrix.Parameters(RING.positions, "cylindrical", RATE, nfft=1024, c=343.0)
    theirs, *_ = anf.generate_signals(segments, about, "evd", "balance+smooth")
    ours = mix(segments, roots())
    expected = coherence(RING.positions, np.fft.rfftfreq(2048, 1 / RATE), speed_of_sound=343.0)
    errors = [
        np.sqrt(np.mean(np.abs(estimate(spectra(x, 2048)) - expected)[4:-4] ** 2))
        for x in (ours, theirs)
    ]
    assert errors[0] < 1.1 * errors[1]
    assert errors[0] < 1.2 * np.sqrt(1 / (800_000 // 2048))


def test_mixing_is_a_linear_filter_of_phase_zero_without_a_trace_of_frames():
    """An impulse anywhere in a frame comes out as the same kernel, symmetric in time, with all of
    its energy."""
    root = roots()
    kernels = []
    for place in (2048, 2500, 3071):
        impulse = np.zeros((6, 6000))
        impulse[0, place] = 1.0
        kernels.append(mix(impulse, root)[:, place - 500 : place + 501])
    assert np.allclose(kernels[0], kernels[1], atol=1e-12)
    assert np.allclose(kernels[0], kernels[2], atol=1e-12)
    assert np.allclose(kernels[0], kernels[0][:, ::-1], atol=1e-12)
    assert np.sum(kernels[0] ** 2) == pytest.approx(1.0, abs=0.01)  # diagonal of J is 1


def test_power_does_not_vary_with_the_place_in_a_frame():
    draws = [
        Diffuse(Plain())(RING, length=8192, sample_rate=RATE, rng=np.random.default_rng(s))
        for s in range(40)
    ]
    power = np.square(np.stack(draws)).mean(axis=(0, 1)).reshape(-1, 256).mean(axis=1)
    assert np.allclose(power, 1.0, atol=6 * np.sqrt(2 / (40 * 256 * 3)))


def test_one_microphone_hears_the_source_as_it_is():
    rng = np.random.default_rng(3)
    source = Plain()(length=5000 + 1024, sample_rate=RATE, rng=np.random.default_rng(3))[512:5512]
    heard = Diffuse(Plain())(MicArray(RING.positions[:1]), length=5000, sample_rate=RATE, rng=rng)[
        0
    ]
    assert np.allclose(heard, source / np.sqrt(np.mean(source**2)))


def test_sound_that_is_slower_is_less_coherent():
    half = coherence(RING.positions, np.array([400.0]), speed_of_sound=171.5)
    assert np.allclose(half, coherence(RING.positions, np.array([800.0]), speed_of_sound=343.0))
    slow, fast = (
        Diffuse(Plain(), speed_of_sound=c)(
            RING, length=100_000, sample_rate=RATE, rng=np.random.default_rng(4)
        )
        for c in (171.5, 343.0)
    )
    near = [
        signal.coherence(x[0], x[1], RATE, nperseg=512)[1][9] for x in (slow, fast)
    ]  # 388 Hz, 0.2 m
    assert near[0] < near[1] - 0.15


@pytest.mark.parametrize(
    ("name", "value"), [("frame", 10), ("frame", 100.5), ("speed_of_sound", 0.343)]
)
def test_bad_fields_are_refused(name, value):
    with pytest.raises(BadValue, match=f"^diffuse.{name}={value} "):
        Diffuse(Plain(), **{name: value})
