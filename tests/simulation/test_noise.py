"""Every noise, found by its YAML file: the level on which every SNR rests, its shape, whom it draws
from."""

import tempfile
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from echolearn.acoustics.geometry import circular_array
from echolearn.cli.compose import compose
from echolearn.cli.config import build, folder
from echolearn.simulation.noise.fixed import Fixed
from echolearn.simulation.noise.white import White
from echolearn.survey import audio

NOISES = sorted(
    f"{path.parent.name}={path.stem}"
    for group in ("noise", "diffuse")
    for path in folder().glob(f"{group}/*")
)
ARRAY = circular_array()


@cache
def noise(option):
    """Return a noise as its file has it; a recording of white noise where one is wanted."""
    group, words = option.partition("=")[0], [option]
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "any.wav"
        samples = np.random.default_rng(8).standard_normal(22050 * 20)
        path.write_bytes(audio.wav_bytes(samples, 22050.0))
        words += [f"diffuse.source.path={path}"] if option == "diffuse=recorded" else []
        [(_, config)] = compose("generate", words)
        return build(config[group], group)


def draw(of, rng, length=20000):
    """Return one draw, shape (M, length)."""
    return of(ARRAY, length=length, sample_rate=22050.0, rng=rng)


def error(values):
    """Return five standard errors of the mean over the first axis, 0.03 at least."""
    return np.maximum(0.03, 5 * values.std(axis=0) / np.sqrt(len(values)))


@pytest.mark.parametrize("option", NOISES)
class TestEveryNoise:
    def test_is_as_long_as_asked_at_every_microphone(self, option):
        for length in (1000, 6001):
            samples = draw(noise(option), np.random.default_rng(0), length)
            assert samples.shape == (len(ARRAY), length)
            assert np.isfinite(samples).all()

    def test_has_unit_variance_at_every_microphone(self, option):
        """White noise within 3 %; a field of a few lines has another power at every place, in every
        draw.

        Sources beside the array are nearer to some microphones than to others.
        """
        rng = np.random.default_rng(1)
        draws = np.stack([draw(noise(option), rng) for _ in range(10)])
        power = np.square(draws).mean(axis=2)
        assert (
            np.abs(power.mean(axis=0) - 1.0)
            < (0.3 if isinstance(noise(option), Fixed) else error(power))
        ).all()
        assert abs(power.mean() - 1.0) < 0.03
        assert np.abs(draws.mean(axis=(0, 2))).max() < 0.03

    def test_draws_from_the_generator_it_is_given_and_from_nothing_else(self, option):
        first, again, other = (
            draw(noise(option), np.random.default_rng(seed)) for seed in (2, 2, 3)
        )
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)

    def test_successive_draws_are_independent(self, option):
        rng = np.random.default_rng(4)
        draws = [draw(noise(option), rng) for _ in range(6)]
        pairs = np.array([np.mean(one * other) for one, other in combinations(draws, 2)])
        assert abs(pairs.mean()) < error(pairs)


def test_white_noise_is_independent_between_microphones_and_samples():
    """Correlations of K samples scatter by 1 / sqrt(K), here 0.0022; the density is flat over
    frequency."""
    samples = draw(White(), np.random.default_rng(5), 200_000)
    assert np.abs(np.corrcoef(samples) - np.eye(len(ARRAY))).max() < 5 / np.sqrt(200_000)
    for lag in (1, 2, 40):
        assert np.abs(np.mean(samples[:, lag:] * samples[:, :-lag], axis=1)).max() < 5 / np.sqrt(
            200_000
        )
    density = (
        np.square(np.abs(np.fft.rfft(samples))).mean(axis=0)[1:].reshape(20, -1).mean(axis=1)
        / 200_000
    )
    assert np.allclose(density, 1.0, atol=0.03)
