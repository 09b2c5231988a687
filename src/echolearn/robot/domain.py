"""Are recordings of the kind that a bundle's classifier has learned from? Asked survey by survey.

A bundle's `reference.npz` holds the columns of S simulated walks of the training kind, n poses
each: one room, one level of noise, one robot a walk. Statistics of a column over the poses are its
median and its share outside the middle 98 % of all training rows. With c the median of a statistic
over the reference walks, and d the root of its mean square deviation on either side,

    e = root of the sum over both statistics of ((value - c) / d)^2,
    p = (1 + number of reference walks whose e is no smaller) / (S + 1),

a rank, so that no shape is assumed of anything; the sum, since shares of a few poses are equal for
many walks and would tie where they are largest. Holm's correction over the columns keeps the level:
of surveys of the training kind 5 % are called others. As many poses are compared as both have, of a
longer survey evenly spread ones, since a median of few varies more.
"""

from dataclasses import dataclass, replace
from warnings import catch_warnings, simplefilter

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.evaluation.stats import holm
from echolearn.localization.localize import localize
from echolearn.localization.silence import SilentMicrophone
from echolearn.robot.bundle import Bundle
from echolearn.robot.reference import UNCHECKED, UNLIKE, Reference
from echolearn.survey.survey import Survey

LEVEL = 0.05
"""Share of surveys of the training kind that are called others."""

MEANINGS = {
    "toa": "when echoes arrive",
    "score": "how much echoes look like the burst",
    "peak_to_rms": "how far echoes stand out of what surrounds them",
    "second_to_first": "how strong the next best time is",
    "gain": "how loud echoes are recorded",
    "gain_delay": "how well walls reflect, if gains are known",
    "power": "how loud the recording is from the echo's direction",
    "power_ratio": "how directional the sound is",
    "coherence": "how well microphones agree on an echo",
    "joint": "how far echoes stand out for all microphones together",
    "joint_max": "how far the best echo stands out for all microphones together",
    "joint_ratio": "how near the echo is to the best one",
    "joint_score": "how much all microphones hear of the burst",
    "joint_lag": "how far the first microphone's echo is from that of all",
    "gated_ratio": "how directional the echo is",
    "azimuth": "from where echoes come",
    "elevation": "from how high echoes come",
    "azimuth_mpdr": "from where the whole recording comes",
    "level": "whether echoes come from the array's plane",
    "exceeded": "how often microphones have more at other times than at the echo",
    "agreement": "how alike pairs of microphones are at the echo",
    "coherence_wide": "how well microphones agree on a smeared echo",
    "peak_offset": "how far the microphones' own peaks are from the echo",
    "peak_share": "how much of their own peaks microphones have at the echo",
    "direction_second": "how strong the next best direction is",
    "joint_second": "how strong the next best echo is",
    "cfar": "how far echoes stand out of a ring around them",
}
"""What a column tells, in words."""


@dataclass(frozen=True)
class Verdict:
    """How a survey compares with the reference of a bundle.

    Attributes:
        columns: their names.
        p: of each column, corrected for their number, shape (K,).
        medians: of each column over the survey's poses, shape (K,).
        usual: 2.5 and 97.5 % of the medians of the reference walks, shape (2, K).
        poses: number of poses that were compared.
    """

    columns: tuple[str, ...]
    p: Array
    medians: Array
    usual: Array
    poses: int

    @property
    def alarm(self) -> bool:
        """Whether the survey is called another kind."""
        return bool((self.p <= LEVEL).any())

    @property
    def worst(self) -> int:
        """Number of the column that differs most."""
        return int(self.p.argmin())


def domain_line(bundle: Bundle, walk: Survey) -> str:
    """Return what there is to say of a survey: whether it is of the kind that a bundle knows.

    Raises:
        BadValue: recordings that cannot be analysed.
    """
    reference = bundle.reference
    if reference is None:
        return UNCHECKED
    found = placed_among(reference, columns_of(bundle, walk, most=reference.rows.shape[1]))
    many = len(found.columns)
    if not found.alarm:
        return (
            f"like simulated walks of the training kind in {many} columns over {found.poses} "
            f"poses, of {len(reference.rows)} walks"
        )
    worst = found.worst
    name = found.columns[worst]
    usual = found.usual[:, worst]
    meaning = MEANINGS.get(name, "what the classifier looks at")
    return (
        f"{UNLIKE}: {name} ({meaning}) is "
        f"{found.medians[worst]:.3g} in the median, there {usual[0]:.3g} to {usual[1]:.3g} "
        f"(p={found.p[worst]:.2g} of {many} columns); trust its confidences less"
    )


def columns_of(bundle: Bundle, walk: Survey, *, most: int) -> Array:
    """Return the reference's columns of the strongest echo of some poses, shape (poses, K).

    Args:
        bundle: with a reference; its localizer estimates the echoes.
        walk: recorded as the bundle wants it, mended.
        most: number of poses, at most, evenly spread over the walk.
    """
    assert bundle.reference is not None
    names = bundle.reference.columns
    count = min(most, len(walk))
    found = []
    # One by one: a few recordings of a robot may be longer than memory allows together.
    for pose in np.linspace(0, len(walk) - 1, count).round().astype(int).tolist():
        # In the bundle's frame, as the scorer hears it.
        heard = replace(walk.observe([pose]), array=bundle.array)
        # A microphone that is silent has been refused, or left out by whoever maps.
        with catch_warnings():
            simplefilter("ignore", SilentMicrophone)
            _, columns = localize(heard, bundle.localizer, names=names)
        found.append([columns[name][0] for name in names])
    return np.array(found, dtype=float)


def placed_among(reference: Reference, rows: Array) -> Verdict:
    """Return how the columns of a survey rank among those of simulated walks.

    Args:
        reference: columns of S walks.
        rows: of the survey's poses, at most as many as a walk has, shape (m, K).
    """
    count = len(rows)
    walks = statistics(reference.rows[:, :count].astype(float), reference.limits)
    # Rounded as the reference is: at a limit, where many columns end, the last bit would count.
    own = statistics(rows[None].astype("f4").astype(float), reference.limits)
    extreme = _extremeness(walks, walks)
    p = (1 + (extreme >= _extremeness(own, walks)).sum(axis=0)) / (1 + len(walks))
    return Verdict(
        reference.columns,
        p=np.array(holm(p)),
        medians=own[0, 0],
        usual=np.quantile(walks[:, 0], [0.025, 0.975], axis=0),
        poses=count,
    )


def statistics(rows: Array, limits: Array) -> Array:
    """Return median and share outside of each column of some surveys, shape (S, 2, K).

    Args:
        rows: columns of S surveys of m poses, shape (S, m, K).
        limits: lowest and highest usual value of each column, shape (2, K).
    """
    low, high = limits
    outside = (rows < low) | (rows > high)
    return np.stack([np.median(rows, axis=1), outside.mean(axis=1)], axis=1)


def _extremeness(values: Array, walks: Array) -> Array:
    """Return how far surveys are from the middle of the reference, in each column, shape (B, K).

    Args:
        values: statistics of B surveys, shape (B, 2, K).
        walks: those of the reference, shape (S, 2, K).
    """
    off = values - np.median(walks, axis=0)
    spread = walks - np.median(walks, axis=0)
    tiny = np.finfo(float).tiny
    # Many statistics are skewed: each side has a spread of its own.
    above = np.sqrt((np.maximum(spread, 0.0) ** 2).mean(axis=0))
    below = np.sqrt((np.minimum(spread, 0.0) ** 2).mean(axis=0))
    scaled = np.abs(off) / np.maximum(np.where(off > 0, above, below), tiny)
    both: Array = np.hypot(*np.moveaxis(np.minimum(scaled, 1e150), 1, 0))
    return both
