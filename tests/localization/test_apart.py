"""Each echo as the others leave it, against recordings that hold that echo alone."""

import numpy as np
import pytest

import reference
from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Array, Echoes, Observation
from echolearn.bench import equations
from echolearn.localization import features
from echolearn.localization.localize import localize
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.joint import Joint
from echolearn.localization.separation import separate

RING = circular_array()
PROBE = noise_probe(length=3000)
WINDOW = SearchWindow()
AZIMUTHS = 24
RATE = 22050.0


def wave(azimuth: float, lag: float, gain: float) -> Array:
    """Return a plane wave from `azimuth` that is at microphone 1 after `lag` samples, shape (M, N)."""
    early = equations.delays(RING.positions, azimuth)[0] * RATE
    source = gain * equations.shift(equations.padded(PROBE.samples, PROBE.length), lag - early)
    return reference.plane_wave(source, RING.positions, azimuth, rate=RATE)


def seen(*samples: Array) -> MatchedFilter:
    return MatchedFilter(Observation(np.stack(samples), PROBE, RING), WINDOW, AZIMUTHS)


def told(*waves: tuple[float, float, float]) -> Echoes:
    """Return echoes (1, R) as an estimator would name them."""
    azimuth, lag, gain = (np.array([column]) for column in zip(*waves, strict=True))
    level = np.full(lag.shape, np.pi / 2)
    return Echoes(lag / RATE, gain, gain, azimuth, level, gain)


PAIRS = {
    "far apart": ((0.4, 150.3, 0.1), (2.5, 220.7, 0.06)),
    "a corner": ((0.4, 180.0, 0.1), (0.4 + np.pi / 2, 180.4, 0.08)),
    "three samples apart, one direction": ((1.0, 180.2, 0.1), (1.0, 183.4, 0.1)),
}


@pytest.mark.parametrize("pair", PAIRS.values(), ids=list(PAIRS))
def test_each_echo_is_what_it_would_be_alone(pair: tuple[tuple[float, float, float], ...]) -> None:
    together = seen(sum((wave(*one) for one in pair), start=np.zeros((6, PROBE.length))))
    for found, one in zip(separate(together, told(*pair)), pair, strict=True):
        alone = seen(wave(*one))
        left = np.linalg.norm(found.padded - alone.padded) / np.linalg.norm(alone.padded)
        assert left < 0.02
        assert np.allclose(found.steered, alone.steered, atol=0.02 * np.abs(alone.steered).max())


def test_a_single_echo_is_the_recording_itself() -> None:
    matched = seen(wave(0.4, 180.0, 0.1))
    assert separate(matched, told((0.4, 180.0, 0.1))) == [matched]


def test_gains_are_not_taken_on_trust() -> None:
    first, second = PAIRS["far apart"]
    together = seen(wave(*first) + wave(*second))
    right, wrong = (
        separate(together, told(first, (*second[:2], gain)))[0] for gain in (second[2], 9.0)
    )
    assert np.allclose(right.padded, wrong.padded)


def test_a_wrong_direction_takes_little_from_the_others() -> None:
    """At microphone 1 the echo is where it is said to be, at the others it is not."""
    first, second = PAIRS["far apart"]
    together, alone = seen(wave(*first) + wave(*second)), seen(wave(*first))
    found, _ = separate(together, told(first, (second[0] + 2.0, *second[1:])))
    index = together.index(np.array([first[1] / RATE]))[0]
    near = slice(index - 30 + 64, index + 30 + 64)
    error = np.linalg.norm((found.padded - alone.padded)[..., near], axis=-1) / np.linalg.norm(
        alone.padded[..., near]
    )
    assert error[0, 0] < 0.01 and error.max() < 0.2


def test_an_echo_that_is_named_twice_is_shared() -> None:
    one = (0.4, 180.3, 0.1)
    matched = seen(wave(*one))
    both = separate(matched, told(one, one))
    for found in both:
        assert np.allclose(found.padded, matched.padded / 2, atol=0.01 * matched.padded.max())


def test_columns_of_each_echo_are_those_of_it_alone() -> None:
    """Under little noise and with what the estimator itself makes of the two; energies, and so
    scores, are common."""
    pair, noise = (
        PAIRS["a corner"],
        0.002 * np.random.default_rng(0).standard_normal((6, PROBE.length)),
    )
    both = Observation(np.stack([wave(*pair[0]) + wave(*pair[1]) + noise]), PROBE, RING)
    echoes = Joint(WINDOW, echoes=2)(both)
    together = features.describe(MatchedFilter(both, WINDOW), echoes)
    assert all(len(column) == 2 for column in together.values())
    for row, one in enumerate(pair):
        single = Observation(np.stack([wave(*one) + noise]), PROBE, RING)
        alone = features.describe(MatchedFilter(single, WINDOW), Joint(WINDOW)(single))
        for name, tolerance in {
            "coherence": 0.01,
            "joint": 0.5,
            "joint_ratio": 0.01,
            "gated_ratio": 0.2,
        }.items():
            assert together[name][row] == pytest.approx(alone[name][0], abs=tolerance), (name, row)
        assert abs(together["joint_lag"][row] - alone["joint_lag"][0]) <= 1


def test_what_is_not_asked_for_is_left_out_and_the_rest_is_the_same() -> None:
    matched = seen(wave(*PAIRS["far apart"][0]))
    echoes = Gated(WINDOW, AZIMUTHS)(matched.observation)
    everything = features.describe(matched, echoes)
    some = features.describe(matched, echoes, names=["coherence", "joint"])
    assert {"coherence", "joint"} <= set(some) <= set(everything) - {"power", *features.TENSORS}
    for name, column in some.items():
        assert np.array_equal(column, everything[name]), name


def test_a_localizer_and_the_features_share_the_view_that_they_are_given() -> None:
    observation = Observation(np.stack([wave(*PAIRS["far apart"][0])]), PROBE, RING)
    held = MatchedFilter(observation, WINDOW, AZIMUTHS)
    Gated(WINDOW, AZIMUTHS)(observation, held)
    assert "steered" in vars(held)
    coarse = MatchedFilter(observation, WINDOW, 36)
    given, own = Gated(WINDOW, AZIMUTHS)(observation, coarse), Gated(WINDOW, AZIMUTHS)(observation)
    assert "steered" not in vars(coarse)
    assert np.array_equal(given.azimuth, own.azimuth)


def test_localize_gives_the_echoes_of_the_localizer_and_their_description() -> None:
    observation = Observation(np.stack([wave(*PAIRS["far apart"][0])]), PROBE, RING)
    localizer = Gated(WINDOW, AZIMUTHS)
    echoes, columns = localize(observation, localizer, names=["coherence", "joint"])
    assert np.array_equal(echoes.toa, localizer(observation).toa)
    described = features.describe(MatchedFilter(observation, WINDOW), echoes, names=["coherence"])
    assert np.array_equal(columns["coherence"], described["coherence"])
