"""Sources beside the array: near is loud, far is late, and a single one is heard alike everywhere."""

from dataclasses import dataclass

import numpy as np
import pytest

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import circular_array
from echolearn.checks import BadValue
from echolearn.simulation.noise.fixed import Fixed
from echolearn.simulation.noise.rotor import Rotor

RING = circular_array()


@dataclass(frozen=True)
class Hiss:
    """White noise at a point."""

    def __call__(self, *, length, sample_rate, rng):
        return rng.standard_normal(length)


def draw(noise, length=20_000):
    return noise(RING, length=length, sample_rate=22050.0, rng=np.random.default_rng(0))


def test_a_source_is_louder_and_earlier_where_it_is_near():
    """Level by 1/d; delays by d/c, read from the phase between microphones 1 and 4 and from the
    peak of 1 and 2."""
    place = np.array([0.5, 0.1, 0.2])
    heard = draw(Fixed(Hiss(), [place.tolist()]))
    distance = np.linalg.norm(RING.positions - place, axis=1)
    assert np.allclose(
        heard.std(axis=1) * distance, (heard.std(axis=1) * distance).mean(), rtol=0.02
    )
    cross = np.fft.rfft(heard[3]) * np.fft.rfft(heard[0]).conj()
    lag = np.fft.irfft(cross, 8 * 20_000).argmax() / 8
    assert lag == pytest.approx((distance[3] - distance[0]) / 343.0 * 22050.0, abs=0.08)


def test_fewer_sources_than_microphones_leave_directions_without_noise():
    places = [[0.3, 0.3, 0.1], [-0.3, 0.3, 0.1]]
    values = np.linalg.eigvalsh(signals.noise_covariance(draw(Fixed(Hiss(), places), 200_000)))
    assert (values[20:-20, -3] < 0.05 * values[20:-20, -1]).all()
    assert np.median(values[20:-20, -2] / values[20:-20, -1]) > 0.1


@pytest.mark.parametrize(
    ("places", "message"),
    [
        ([], "diffuse.places=[]"),
        ([[1.0, 2.0]], "diffuse.places=[1.0, 2.0]: must be"),
        ([[1.0, 2.0, "high"]], "diffuse.places=high m"),
        (0.3, "diffuse.places=0.3"),
    ],
)
def test_places_that_are_none_are_refused(places, message):
    with pytest.raises(BadValue) as refused:
        Fixed(Rotor(), places)
    assert str(refused.value).startswith(message)


def test_a_source_inside_a_microphone_is_refused():
    with pytest.raises(
        BadValue, match=r"^diffuse.places=0.000 m from a microphone: must be 0.01 m or more"
    ):
        draw(Fixed(Rotor(), [RING.positions[2].tolist()]))
