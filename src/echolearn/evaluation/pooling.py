"""One figure over several rooms: its mean over rooms, with an interval.

The bootstrap draws what is independent (Davison and Hinkley, 1997, section 3.8). From
`LEAST_ROOMS` rooms on these are drawn with replacement, each as a whole: a room's figure scatters
with its positions already, so that drawing these, too, would count them twice. Of fewer rooms the
draws would say next to nothing: they are held fixed, their positions (or stretches of their walks)
are drawn, and the interval speaks of these rooms alone. Those draws have been made before, room by
room and for all models alike (`stats`), which also pairs them.

Percentiles of n drawn units are too narrow where n is small, by sqrt((n - 1) / n) and by taking a
normal for Student's distribution. The expanded percentile interval (Hesterberg, The American
Statistician 69, 2015) mends both: instead of the share 0.025 it cuts off

    Phi(-sqrt(n / (n - 1)) t),    t the 97.5 % quantile of Student's distribution, n - 1 degrees.
"""

from typing import NamedTuple

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.evaluation.stats import LEVEL, Interval

LEAST_ROOMS = 8
"""Rooms from which on these are drawn: percentiles of fewer are those of a handful of values."""


class PooledFigures(NamedTuple):
    """A figure over rooms.

    Attributes:
        figure: mean over rooms, with its interval.
        p: test that the figure is 0, from the share of draws on the other side of 0.
        clusters: what was drawn, "rooms" or "positions".
    """

    figure: Interval
    p: float
    clusters: str


def pool(values: Array, draws: Array, *, units: int, seed: int = 0) -> PooledFigures:
    """Return the mean of a figure over rooms, with its interval.

    Args:
        values: figure of each room, shape (R,).
        draws: the figure of resampled positions of each room, shape (R, K).
        units: positions, or stretches of walks, that were drawn for each draw, in all rooms.
        seed: seed of the drawn rooms, and of which draws of two rooms meet.

    Raises:
        BadValue: no rooms, or draws that are not theirs.
    """
    rooms, resamples = draws.shape
    allowed = f"must be ({len(values)}, K), of one room or more"
    check(0 < rooms == len(values), "draws.shape", draws.shape, allowed=allowed)
    rng = np.random.default_rng([seed, 2])
    if rooms >= LEAST_ROOMS:
        clusters = "rooms"
        units = rooms
        means = values[rng.integers(rooms, size=(resamples, rooms))].mean(axis=1)
    else:
        clusters = "positions"
        # Draw k of one room must not always meet draw k of another: all began with one seed.
        means = np.mean([each[rng.permutation(resamples)] for each in draws], axis=0)
    return PooledFigures(*bounded(float(np.mean(values)), means, units=units), clusters)


def bounded(value: float, draws: Array, *, units: int) -> tuple[Interval, float]:
    """Return a figure with its expanded percentile interval, and the p value that it is 0.

    Args:
        value: the figure.
        draws: resampled figures, shape (K,); those that are NaN do not count.
        units: what was drawn for each, in number.
    """
    defined = draws[np.isfinite(draws)]
    if not len(defined) or not np.isfinite(value) or units < 2:
        return Interval(value, np.nan, np.nan), np.nan
    wider = np.sqrt(units / (units - 1))
    tail = norm.sf(wider * student.ppf((1 + LEVEL) / 2, units - 1))
    # K draws cut the figures into K + 1 parts that are equally likely. The usual rule, of K - 1,
    # puts the ends inwards by a draw, which is a fifth of the tail where there are few.
    low, high = np.quantile(defined, [tail, 1 - tail], method="weibull").tolist()

    # The same for the share beyond 0; one draw more on either side, so that no p value is 0.
    beyond = 1 + min((defined <= 0).sum(), (defined >= 0).sum())
    share = min(0.5, float(beyond) / (1 + len(defined)))
    p = 2 * float(student.sf(norm.isf(share) / wider, units - 1))
    return Interval(value, low, high), p
