"""Each echo as the others leave it, against recordings that hold that echo alone."""

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Echoes
from echolearn.localization.localize import describe
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.methods.joint import Joint
from echolearn.localization.separation import separate
from reference import RATE, observed, wave, white

PROBE = noise_probe(length=3000)
WINDOW = SearchWindow()
PAIRS = {
    "far from each other": ((0.4, 150.3, 0.1), (2.5, 220.7, 0.06)),
    "a corner": ((0.4, 180.0, 0.1), (0.4 + np.pi / 2, 180.4, 0.08)),
    "three samples late, one direction": ((1.0, 180.2, 0.1), (1.0, 183.4, 0.1)),
}
FIRST, SECOND = PAIRS["far from each other"]


def view(*waves):
    """Return the view of one recording of some echoes."""
    return MatchedFilter(observed(PROBE, sum(wave(PROBE, *one) for one in waves)), WINDOW, 24)


def told(*waves):
    """Return echoes (1, R) as an estimator would name them."""
    azimuth, lag, gain = (np.array([column]) for column in zip(*waves, strict=True))
    return Echoes(lag / RATE, gain, gain, azimuth, np.full(lag.shape, np.pi / 2), gain)


def relative(error, whole):
    return float(np.linalg.norm(error) / np.linalg.norm(whole))


@pytest.mark.parametrize("pair", PAIRS.values(), ids=PAIRS)
def test_what_the_others_leave_is_what_the_echo_alone_would_give(pair):
    for found, one in zip(separate(view(*pair), told(*pair)), pair, strict=True):
        alone = view(one)
        assert relative(found.padded - alone.padded, alone.padded) < 0.02
        assert np.allclose(found.steered, alone.steered, atol=0.02 * np.abs(alone.steered).max())


def test_a_single_echo_is_the_recording_itself():
    matched = view(FIRST)
    assert separate(matched, told(FIRST)) == [matched]


def test_gains_are_not_taken_on_trust():
    together = view(FIRST, SECOND)
    right, wrong = (separate(together, told(FIRST, (*SECOND[:2], g)))[0] for g in (0.06, 9.0))
    assert np.allclose(right.padded, wrong.padded)


def test_a_wrong_direction_takes_little_from_the_others():
    """At microphone 1 the echo is where it is said to be, at the others it is not."""
    alone = view(FIRST)
    found, _ = separate(view(FIRST, SECOND), told(FIRST, (SECOND[0] + 2.0, *SECOND[1:])))
    index = alone.index(np.array([FIRST[1] / RATE]))[0]
    near = slice(index - 30 + 64, index + 30 + 64)
    errors = [
        relative((f - a)[near], a[near])
        for f, a in zip(found.padded[0], alone.padded[0], strict=True)
    ]
    assert errors[0] < 0.01
    assert max(errors) < 0.2


def test_an_echo_that_is_named_twice_is_shared():
    one = (0.4, 180.3, 0.1)
    matched = view(one)
    for found in separate(matched, told(one, one)):
        assert np.allclose(found.padded, matched.padded / 2, atol=0.01 * matched.padded.max())


def test_columns_of_each_echo_are_those_of_it_alone():
    """Under little noise and with what the estimator itself makes of the two; energies, and so
    scores, are common."""
    pair, noise = PAIRS["a corner"], white(PROBE, 0.002)

    def described(*waves):
        batch = observed(PROBE, sum((wave(PROBE, *one) for one in waves), noise))
        echoes = Joint(WINDOW, echoes=len(waves))(batch)
        return describe(separate(MatchedFilter(batch, WINDOW), echoes), echoes)

    together = described(*pair)
    assert all(len(column) == 2 for column in together.values())
    within = {
        "coherence": 0.01,
        "joint": 0.5,
        "joint_ratio": 0.01,
        "gated_ratio": 0.2,
        "joint_lag": 1,
    }
    for row, one in enumerate(pair):
        alone = described(one)
        for name, tolerance in within.items():
            assert together[name][row] == pytest.approx(alone[name][0], abs=tolerance), (name, row)
