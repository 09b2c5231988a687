"""Each echo as the others leave it, against recordings that hold that echo alone."""

import pickle
from dataclasses import replace
from weakref import ref

import numpy as np
import pytest

import reference
from echolearn import features, literal
from echolearn.geometry import SearchWindow, circular_array
from echolearn.localize.apart import apart
from echolearn.localize.gated import Gated
from echolearn.localize.joint import Joint
from echolearn.localize.matched import Matched, view
from echolearn.signals import noise_probe
from echolearn.types import Array, Echoes, Observation

RING = circular_array()
PROBE = noise_probe(length=3000)
WINDOW = SearchWindow()
AZIMUTHS = 24
RATE = 22050.0


def wave(azimuth: float, lag: float, gain: float) -> Array:
    """Return a plane wave from `azimuth` that is at microphone 1 after `lag` samples, shape (M, N)."""
    early = literal.delays(RING.positions, azimuth)[0] * RATE
    source = gain * literal.shift(literal.padded(PROBE.samples, PROBE.length), lag - early)
    return reference.plane_wave(source, RING.positions, azimuth, rate=RATE)


def seen(*samples: Array) -> Matched:
    return Matched(Observation(np.stack(samples), PROBE, RING), WINDOW, AZIMUTHS)


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
    for found, one in zip(apart(together, told(*pair)), pair, strict=True):
        alone = seen(wave(*one))
        left = np.linalg.norm(found.padded - alone.padded) / np.linalg.norm(alone.padded)
        assert left < 0.02
        assert np.allclose(found.steered, alone.steered, atol=0.02 * np.abs(alone.steered).max())


def test_a_single_echo_is_the_recording_itself() -> None:
    matched = seen(wave(0.4, 180.0, 0.1))
    assert apart(matched, told((0.4, 180.0, 0.1))) == [matched]


def test_gains_are_not_taken_on_trust() -> None:
    first, second = PAIRS["far apart"]
    together = seen(wave(*first) + wave(*second))
    right, wrong = (apart(together, told(first, (*second[:2], gain)))[0] for gain in (second[2], 9.0))
    assert np.allclose(right.padded, wrong.padded)


def test_a_wrong_direction_takes_little_from_the_others() -> None:
    """At microphone 1 the echo is where it is said to be, at the others it is not."""
    first, second = PAIRS["far apart"]
    together, alone = seen(wave(*first) + wave(*second)), seen(wave(*first))
    found, _ = apart(together, told(first, (second[0] + 2.0, *second[1:])))
    index = together.index(np.array([first[1] / RATE]))[0]
    near = slice(index - 30 + 64, index + 30 + 64)
    error = np.linalg.norm((found.padded - alone.padded)[..., near], axis=-1) / np.linalg.norm(alone.padded[..., near])
    assert error[0, 0] < 0.01 and error.max() < 0.2


def test_an_echo_that_is_named_twice_is_shared() -> None:
    one = (0.4, 180.3, 0.1)
    matched = seen(wave(*one))
    both = apart(matched, told(one, one))
    for found in both:
        assert np.allclose(found.padded, matched.padded / 2, atol=0.01 * matched.padded.max())


def test_columns_of_each_echo_are_those_of_it_alone() -> None:
    """Under little noise and with what the estimator itself makes of the two; energies, and so scores, are common."""
    pair, noise = PAIRS["a corner"], 0.002 * np.random.default_rng(0).standard_normal((6, PROBE.length))
    both = Observation(np.stack([wave(*pair[0]) + wave(*pair[1]) + noise]), PROBE, RING)
    echoes = Joint(WINDOW, echoes=2)(both)
    together = features.describe(Matched(both, WINDOW), echoes)
    assert all(len(column) == 2 for column in together.values())
    for row, one in enumerate(pair):
        single = Observation(np.stack([wave(*one) + noise]), PROBE, RING)
        alone = features.describe(Matched(single, WINDOW), Joint(WINDOW)(single))
        for name, tolerance in {"coherence": 0.01, "joint": 0.5, "joint_ratio": 0.01, "gated_ratio": 0.2}.items():
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


def test_a_localizer_and_the_features_share_their_view_and_nobody_keeps_it() -> None:
    observation = Observation(np.stack([wave(*PAIRS["far apart"][0])]), PROBE, RING)
    held = view(observation, WINDOW, AZIMUTHS)
    Gated(WINDOW, AZIMUTHS)(observation)
    assert "steered" in vars(held)
    assert view(observation, WINDOW, AZIMUTHS) is held
    assert view(observation, WINDOW, 36) is not held
    assert view(replace(observation), WINDOW, AZIMUTHS) is not held
    gone = ref(held)
    del held
    assert gone() is None


def test_recordings_travel_between_processes_also_while_their_view_is_held() -> None:
    observation = Observation(np.stack([wave(*PAIRS["far apart"][0])]), PROBE, RING)
    held = view(observation, WINDOW, AZIMUTHS)
    arrived = pickle.loads(pickle.dumps(observation))
    assert np.array_equal(arrived.samples, observation.samples)
    assert view(observation, WINDOW, AZIMUTHS) is held is not view(arrived, WINDOW, AZIMUTHS)
