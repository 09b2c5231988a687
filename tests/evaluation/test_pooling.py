"""Figures over rooms: literal draws, the interval that Student would give, nulls by simulation."""

import numpy as np
import pytest
from scipy.stats import t as student

import null_rates
from echolearn.checks import BadValue
from echolearn.evaluation import pooling, stats


def test_many_rooms_are_drawn_as_wholes():
    """Of normal figures the draws are nearly normal, and the interval is Student's own."""
    values = np.random.default_rng(0).normal(size=20)
    draws = np.full((20, 20_000), np.nan)  # positions do not count
    found = pooling.pool(values, draws, units=999)
    assert found.clusters == "rooms"
    error = values.std(ddof=1) / np.sqrt(20)
    half = student.ppf(0.975, 19) * error
    expected = (values.mean(), values.mean() - half, values.mean() + half)
    assert found.figure == pytest.approx(expected, abs=0.1 * half)
    assert found.p == pytest.approx(2 * student.sf(abs(values.mean()) / error, 19), abs=0.03)


def test_few_rooms_are_held_fixed_and_each_draws_for_itself():
    """The spread is that of a mean of independent draws, though both rooms drew by one seed."""
    rng = np.random.default_rng(1)
    same = 5.0 + rng.normal(size=20_000)
    found = pooling.pool(np.array([5.0, 7.0]), np.stack([same, same + 2]), units=10**9)
    assert found.clusters == "positions"
    half = 1.96 / np.sqrt(2)
    assert found.figure == pytest.approx((6.0, 6 - half, 6 + half), abs=0.05)


def test_fewer_units_make_it_wider_and_p_agrees_with_the_interval():
    draws = np.random.default_rng(2).normal(size=40_000)
    widths = []
    for units in (5, 20, 10**9):
        found, _ = pooling.bounded(0.0, draws, units=units)
        widths.append(found.high - found.low)
        # Where an end touches 0, p is 0.05.
        _, p = pooling.bounded(-found.low, draws - found.low, units=units)
        assert p == pytest.approx(0.05, abs=0.005)
    assert widths[0] > 1.4 * widths[1] > 1.4 * widths[2]
    assert widths[2] == pytest.approx(2 * 1.96, rel=0.02)
    assert widths[1] == pytest.approx(2 * student.ppf(0.975, 19) * np.sqrt(20 / 19), rel=0.03)


def test_what_is_undefined_has_no_interval():
    draws = np.ones((2, 9))
    assert np.isnan(pooling.pool(np.array([1.0, np.nan]), draws, units=9).p)
    assert np.isnan(pooling.bounded(1.0, np.full(9, np.nan), units=9)[0].low)
    assert np.isnan(pooling.bounded(1.0, draws[0], units=1)[0].low)
    with pytest.raises(BadValue, match=r"^draws.shape=\(2, 9\)"):
        pooling.pool(np.ones(3), draws, units=9)


def test_stretches_of_a_walk_are_drawn_whole():
    """Eight poses, two rows each, in stretches of three: cut from a circle, the last one short."""
    poses = np.repeat([10, 20, 30, 40, 50, 60, 70, 80], 2)
    weights = stats.walk_weights(poses, resamples=3000, length=3, seed=4)
    assert (weights[:, ::2] == weights[:, 1::2]).all() and (weights[:, ::2].sum(axis=1) == 8).all()
    np.testing.assert_allclose(weights.mean(axis=0), 1.0, atol=0.05)
    # Neighbours, also across the seam, come together; poses half a walk apart do not.
    counts = np.corrcoef(weights[:, ::2].T)
    assert min(counts[0, 1], counts[3, 4], counts[7, 0]) > 0.4 > 0 > counts[0, 4]
    single = stats.walk_weights(np.arange(8), resamples=3000, length=1)
    np.testing.assert_allclose(single.var(axis=0), 7 / 8, atol=0.08)
    assert stats.stretch(160) == 16 and stats.stretch(1) == 1
    with pytest.raises(BadValue, match="^length=9"):
        stats.walk_weights(poses, resamples=3, length=9)


@pytest.mark.release
def test_every_test_finds_a_difference_in_about_5_of_100_null_cases():
    """And what takes dependent rows for independent, or many tests for one, finds more."""
    for name, rate in null_rates.rates(1500):
        if name.endswith("independent") or name == "any of 12":
            assert rate > 0.065, name
        else:
            assert 0.01 <= rate <= 0.075, name


@pytest.mark.release
def test_intervals_hold_a_known_difference_in_about_95_of_100_cases():
    for name, share in null_rates.coverage(1500):
        assert 0.925 <= share <= 0.99, name
