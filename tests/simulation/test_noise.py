"""Every noise, found by its YAML file: the level on which every SNR rests, its shape, whom it draws
from."""

from itertools import combinations

import numpy as np
import pytest
from scipy.signal import lfilter

from echolearn.cli.compose import compose
from echolearn.cli.config import build
from echolearn.cli.own import folder
from echolearn.simulation import normal_loops
from echolearn.simulation.noise.fixed import Fixed
from echolearn.simulation.noise.white import White
from echolearn.simulation.normal_loops import coloured, noisy_recording, standard_normal
from echolearn.survey import audio
from interpreted import interpret, upper
from reference import RATE
from sounds import draw

TAILED = (545, 1312)
"""Seeds of which one of the first 80 numbers comes from the tail, a negative and a positive one."""

NOISES = sorted(
    f"{path.parent.name}={path.stem}"
    for group in ("noise", "diffuse")
    for path in folder().glob(f"{group}/*")
)


@pytest.fixture(scope="module", params=NOISES)
def noise(request, tmp_path_factory):
    """Return a noise as its file has it; a recording of white noise where one is wanted."""
    group, _, name = request.param.partition("=")
    options = [request.param]
    if name == "recorded":
        path = tmp_path_factory.mktemp("noise") / "any.wav"
        samples = np.random.default_rng(8).standard_normal(22050 * 20)
        path.write_bytes(audio.wav_bytes(samples, RATE))
        options.append(f"diffuse.source.path={path}")
    [(_, config)] = compose("generate", options)
    return build(config[group], group)


def error(values):
    """Return five standard errors of the mean over the first axis, 0.03 at least."""
    return np.maximum(0.03, 5 * values.std(axis=0) / np.sqrt(len(values)))


class TestEveryNoise:
    def test_is_as_long_as_asked_at_every_microphone(self, noise):
        for length in (1000, 6001):
            samples = draw(noise, length)
            assert samples.shape == (6, length)
            assert np.isfinite(samples).all()

    def test_has_unit_variance_at_every_microphone_and_independent_draws(self, noise):
        """White noise within 3 %; a field of a few lines has another power at every place, in every
        draw.

        Sources beside the array are nearer to some microphones than to others.
        """
        rng = np.random.default_rng(1)
        draws = np.stack([draw(noise, seed=rng) for _ in range(10)])
        power = np.square(draws).mean(axis=2)
        allowed = 0.3 if isinstance(noise, Fixed) else error(power)
        assert (np.abs(power.mean(axis=0) - 1.0) < allowed).all()
        assert abs(power.mean() - 1.0) < 0.03
        assert np.abs(draws.mean(axis=(0, 2))).max() < 0.03
        pairs = np.array([np.mean(one * other) for one, other in combinations(draws, 2)])
        assert abs(pairs.mean()) < error(pairs)

    def test_draws_from_the_generator_it_is_given_and_from_nothing_else(self, noise):
        first, again, other = (draw(noise, seed=seed) for seed in (2, 2, 3))
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)


def test_white_noise_is_independent_between_microphones_and_samples():
    """Correlations of K samples scatter by 1 / sqrt(K), here 0.0022; the density is flat over
    frequency."""
    samples = draw(White(), 200_000, seed=5)
    scatter = 5 / np.sqrt(200_000)
    assert np.abs(np.corrcoef(samples) - np.eye(6)).max() < scatter
    for lag in (1, 2, 40):
        assert np.abs(np.mean(samples[:, lag:] * samples[:, :-lag], axis=1)).max() < scatter
    power = np.square(np.abs(np.fft.rfft(samples))).mean(axis=0) / 200_000
    assert np.allclose(power[1:].reshape(20, -1).mean(axis=1), 1.0, atol=0.03)


def test_compiled_noise_is_that_of_numpy_and_leaves_its_generator_behind():
    theirs, ours = (np.random.default_rng(4) for _ in range(2))
    # A million numbers come from every layer of the ziggurat, and some hundreds from its tail.
    for shape in ((3, 333_333), (1,), (0, 5)):
        assert np.array_equal(standard_normal(ours, shape), theirs.standard_normal(shape))
    assert ours.bit_generator.state == theirs.bit_generator.state
    # The tail begins at 3.654.
    assert np.abs(standard_normal(ours, (10**5,))).max() > 3.9
    theirs, ours = (np.random.Generator(np.random.MT19937(4)) for _ in range(2))
    assert np.array_equal(standard_normal(ours, (7,)), theirs.standard_normal(7))


@pytest.mark.parametrize("seed", TAILED)
def test_as_python_the_loop_draws_what_numpy_draws(seed, monkeypatch):
    interpret(normal_loops, monkeypatch, _upper=upper)
    theirs, ours = (np.random.default_rng(seed) for _ in range(2))
    expected = theirs.standard_normal(80)
    assert np.abs(expected).max() > normal_loops.TAIL
    # Numbers of 64 bits go round, as they shall.
    with np.errstate(over="ignore"):
        assert np.array_equal(standard_normal(ours, (80,)), expected)
    assert ours.bit_generator.state == theirs.bit_generator.state


def test_as_python_the_loops_sum_the_parts_of_a_recording_and_colour_noise(monkeypatch):
    interpret(normal_loops, monkeypatch)
    test_a_recording_is_the_sum_of_its_parts()
    test_noise_is_coloured_as_by_scipy()


def test_a_recording_is_the_sum_of_its_parts():
    """The direct path may end before it, and the recording stand where it is wanted."""
    rng = np.random.default_rng(5)
    received, direct, noise = rng.standard_normal((3, 2, 50))
    direct[:, 20:] = 0.0
    expected = (received - direct + noise) * 0.3
    for known in (direct, direct[:, :20]):
        out = np.empty_like(noise)
        noisy_recording(received, known, noise=noise, gain=0.3, out=out)
        assert np.array_equal(out, expected)
    assert np.array_equal(noisy_recording(received, direct, noise=noise, gain=0.3), expected)


def test_noise_is_coloured_as_by_scipy():
    """To the last bit: one microphone waits for no other."""
    rng = np.random.default_rng(6)
    white, before = rng.standard_normal((3, 50)), rng.standard_normal((3, 1))
    expected, _ = lfilter([0.7, -0.2], [1.0, -0.9], white, zi=before)
    found = coloured(white.copy(), before.copy(), falls=0.9, taps=(0.7, -0.2))
    assert np.array_equal(found, expected)
