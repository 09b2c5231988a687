"""Sources beside the array: near is loud, far is late, and few of them leave quiet directions."""

import numpy as np
import pytest

from echolearn.acoustics import signals
from echolearn.simulation.noise.fixed import Fixed
from reference import RATE, RING, SPEED
from refusals import refused
from sounds import draw, hiss


def test_a_source_is_louder_and_earlier_where_it_is_near():
    """Level by 1/d; delays by d/c, read from the phase between microphones 1 and 4."""
    place = np.array([0.5, 0.1, 0.2])
    recorded = draw(Fixed(hiss, [place.tolist()]))
    distance = np.linalg.norm(RING.positions - place, axis=1)
    level = recorded.std(axis=1) * distance
    assert np.allclose(level, level.mean(), rtol=0.02)
    cross = np.fft.rfft(recorded[3]) * np.fft.rfft(recorded[0]).conj()
    lag = np.fft.irfft(cross, 8 * 20_000).argmax() / 8
    assert lag == pytest.approx((distance[3] - distance[0]) / SPEED * RATE, abs=0.08)


def test_fewer_sources_than_microphones_leave_directions_without_noise():
    places = [[0.3, 0.3, 0.1], [-0.3, 0.3, 0.1]]
    covariance = signals.noise_covariance(draw(Fixed(hiss, places), 200_000))
    values = np.linalg.eigvalsh(covariance)[20:-20]
    assert (values[:, -3] < 0.05 * values[:, -1]).all()
    assert np.median(values[:, -2] / values[:, -1]) > 0.1


@pytest.mark.parametrize(
    ("places", "message"),
    [
        ([], "shape (0,): must be many x 3"),
        ([[1.0, 2.0]], "shape (1, 2): must be many x 3 finite numbers in m"),
        ([[1.0, 2.0, "high"]], "words"),
        ([[1.0, 2.0, 300.0]], "300 m: must be coordinates from -100 to 100 m; are they in mm?"),
        (RING.positions[2:3].tolist(), "0.000 m from a microphone: must be 0.01 m or more"),
    ],
)
def test_places_that_are_none_are_refused(places, message):
    with refused(f"diffuse.places={message}"):
        draw(Fixed(hiss, places))
