"""What all recordings together say of the microphones: dead, clipped, doubled, changing places.

One recording may deceive; what is said here is said of a microphone that does it again and again.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from echolearn.acoustics.types import Array
from echolearn.survey import copies, naming
from echolearn.survey import levels as level_rules
from echolearn.survey.arrivals import SEEN
from echolearn.survey.exchange import exchanged
from echolearn.survey.measuring import Walk
from echolearn.survey.shape import judge_shape
from echolearn.survey.signs import wiring_signs

DEAD_DB = -40.0
SOFT_DB = -12.0
"""Level over that of the median microphone at which one is dead, and at which that is told."""

SOFTEST_DB = -60.0
FURTHER_DB = -20.0
"""Level over that of the median microphone from which one that hears echoes is soft, not dead, and
over its own median at which it is dead in a recording."""

MOSTLY = 0.5
"""Share of recordings in which a microphone that is soft, not dead, hears an echo."""

ONE = 0.98
"""Correlation from which two channels are one, and a channel is the emitted burst itself."""

LEAK = 0.06
"""Correlation at the same instant, beyond that of microphones as far from one another, from which
channels leak: -24 dB if into one another."""

TURNED = 0.8
"""|mean exp(4 j heading)| above which a robot always stands alike before walls at right angles,
whose echoes then reach some microphones together."""


@dataclass
class Verdicts:
    """What there is to say of M microphones.

    Attributes:
        words: of each microphone.
        alive: those that are used and hear a room, shape (M,), bool.
        refused, noticed: lines.
    """

    words: list[str]
    alive: Array
    refused: list[str] = field(default_factory=list)
    noticed: list[str] = field(default_factory=list)

    def refuse(self, which: ArrayLike, word: str, *, line: str) -> None:
        """Say a word of some microphones, and refuse with a line.

        Args:
            which: the microphones, shape (M,), bool.
            word: of each of them.
            line: on all.
        """
        self.name(which, word)
        self.refused.append(line)

    def name(self, which: ArrayLike, word: str) -> None:
        """Say a word of some microphones, shape (M,), bool."""
        for m in np.flatnonzero(which):
            self.words[m] = word if self.words[m] == "fine" else f"{self.words[m]}, {word}"


def judge_channels(walk: Walk) -> Verdicts:
    """Return what recordings say of the microphones."""
    words = ["fine" if used else "left out" for used in walk.used]
    found = Verdicts(words, walk.used)
    dead = _dead(walk, found)
    found.alive = walk.used & ~dead.any(axis=0)
    _clipped(walk, found, dead=dead)
    _overflowed(walk, found)
    _lost(walk, found)
    found.refused += judge_shape(walk.shape, walk.survey.probe.samples, numbers=walk.numbers)
    if found.alive.sum() > 1:
        _same(walk, found)
        _loopback(walk, found)
        # Whatever else is wrong makes echoes no plane waves.
        if not found.refused and (wiring_signs(walk.direct, walk.echo.sign) > 0).all():
            _swapped(walk, found)
        _soft(walk, found)
    # A dead channel and a loopback are alike everywhere.
    found.refused += copies.copy_lines(walk.survey, np.where(found.alive, walk.marks, 0))
    return found


def _where(walk: Walk, which: Array) -> str:
    """Name microphones and recordings of which (P, M) are meant."""
    place = naming.recordings(walk.numbers, which.any(axis=1))
    return f"{naming.microphones(which.any(axis=0))} in {place}"


def _dead(walk: Walk, found: Verdicts) -> Array:
    """Refuse microphones that hear nothing, and return which, shape (P, M), bool."""
    level = walk.level_db
    below = level - np.median(level[:, walk.used], axis=1, keepdims=True)
    heard = (walk.echo.seen > SEEN).mean(axis=0)
    # Whoever hears echoes in most recordings is soft, which gains mend; a loose plug takes more.
    usual = np.median(below, axis=0)
    is_soft = (heard > MOSTLY) & (usual > SOFTEST_DB)
    least = np.where(is_soft, np.minimum(DEAD_DB, usual + FURTHER_DB), DEAD_DB)
    dead = walk.used & (below < least)
    # One that has noise of its own and hears nothing of what all others hear.
    others = [np.median(np.delete(heard, m)) for m in range(len(heard))] if len(heard) > 1 else [0]
    burst = np.median(walk.echo.score, axis=0)
    deaf = walk.used & (heard < 0.1) & (np.array(others) > 0.8) & (burst < 0.3) & (len(level) > 2)
    dead |= deaf & ~dead.any(axis=0)
    if not dead.any():
        return dead
    patterns = {tuple(row) for row in dead.tolist()}
    where = _where(walk, dead)
    if len(patterns) > 1:
        line = (
            f"dead channels={where}, not in the others: must be the same in every recording; "
            "do channels change places, or is a plug loose?"
        )
        found.refuse(dead.any(axis=0), "dead at times", line=line)
        return dead
    which = dead.any(axis=0)
    line = f"dead channels={where}: must hear the probe; {naming.left_out(which)}"
    found.refuse(which, "dead", line=line)
    return dead


def _clipped(walk: Walk, found: Verdicts, *, dead: Array) -> None:
    share = np.where(walk.used & ~dead, walk.levels.clipping, 0.0)
    clipped = share > level_rules.CLIPPED
    soft = clipped & (walk.levels.level_steps < level_rules.STEPS)
    if soft.any():
        count = walk.levels.level_steps[soft].min()
        line = (
            f"too soft={count:.0f} steps of the converter between the "
            f"smallest and the largest sample at {_where(walk, soft)}: must be "
            f"{level_rules.STEPS} or more; record with more gain"
        )
        found.refuse(soft.any(axis=0), "too soft", line=line)
    clipped &= ~soft
    if clipped.any():
        line = (
            f"clipped={100 * share[clipped].max():.0f} % of a burst at {_where(walk, clipped)}: "
            f"must be at most {100 * level_rules.CLIPPED:g} %; record with less gain"
        )
        found.refuse(clipped.any(axis=0), "clipped", line=line)


def _overflowed(walk: Walk, found: Verdicts) -> None:
    """Refuse channels whose samples came out at the other end of the range."""
    wrapped = np.where(walk.used, walk.wrapped, 0)
    if wrapped.sum() >= level_rules.OVERFLOWED:
        line = (
            f"overflowed={wrapped.max()} samples at {_where(walk, wrapped > 0)}: must stay within "
            "the range, beyond which they come out at its other end; record with less gain"
        )
        found.refuse((wrapped > 0).any(axis=0), "overflowed", line=line)


def _lost(walk: Walk, found: Verdicts) -> None:
    """Refuse recordings that carry the marks of lost samples."""
    still = np.where(walk.used, walk.levels.still, 0)
    if still.any():
        line = (
            f"lost samples={still.max()} equal ones in a row at {_where(walk, still > 0)}: must "
            "be sound; did the recorder drop a buffer, or does a noise gate cut what is soft?"
        )
        found.refuse(still.any(axis=0), "samples lost", line=line)
    repeated = np.asarray(walk.levels.repeated)
    if repeated.any():
        where = naming.recordings(walk.numbers, repeated > 0)
        line = (
            f"repeated samples={repeated.max()} in {where}: "
            "must be sound, which never comes back exactly; did the recorder play a buffer twice?"
        )
        found.refused.append(line)


def _same(walk: Walk, found: Verdicts) -> None:
    """Refuse channels that are one, or leak into one another."""
    alike = np.median(walk.echo.alike, axis=0)
    alike[~found.alive] = 0.0
    alike[:, ~found.alive] = 0.0
    one = np.abs(alike) > ONE
    if one.any():
        which = one.any(axis=0)
        line = (
            f"doubled channels={naming.microphones(which)} correlate {np.abs(alike).max():.3f} in "
            f"{naming.recordings(walk.numbers, np.ones(len(walk.numbers), dtype=bool))}: must be "
            "different; is one input recorded twice?"
        )
        found.refuse(which, "doubled", line=line)
        return
    excess = _excess(walk, alike)
    leak = np.abs(excess) > 0
    if leak.any():
        which = leak.any(axis=0)
        line = (
            f"crosstalk={20 * np.log10(np.abs(excess).max()):.0f} dB between "
            f"{naming.microphones(which)} in the median recording: must be below "
            f"{20 * np.log10(LEAK):.0f} dB; do cables or inputs leak into one another?"
        )
        found.refuse(which, "crosstalk", line=line)


def _excess(walk: Walk, alike: Array) -> Array:
    """Return correlations beyond those of microphones as far apart, 0 if not significant, (M, M).

    Args:
        walk: what was measured.
        alike: median correlation between microphones, 0 where one is not used, shape (M, M).
    """
    count = len(walk.numbers)
    doubt = 6 * walk.echo.alike.std(axis=0) / np.sqrt(count)
    headings = np.array([pose.heading for pose in walk.survey.poses])
    steady = abs(np.mean(np.exp(4j * headings))) > TURNED
    places = walk.survey.array.positions
    distances = np.linalg.norm(places[:, None] - places, axis=-1)
    used = alike != 0
    excess = np.zeros_like(alike)
    for i, j in np.argwhere(np.triu(used, 1)):
        peers = used & np.isclose(distances, distances[i, j], rtol=0.02)
        alone = peers.sum() < 6  # each pair counts twice
        usual = float(np.median(alike[used if alone else peers]))
        least = 0.5 if steady else 0.3 if alone else LEAK
        beyond = abs(alike[i, j] - usual)
        if beyond > least + doubt[i, j]:
            excess[i, j] = excess[j, i] = beyond
    return excess


def _loopback(walk: Walk, found: Verdicts) -> None:
    """Refuse channels that hold the emitted burst itself."""
    score = np.median(walk.echo.score, axis=0)
    lag = np.median(walk.echo.lag, axis=0)
    steady = (
        np.ptp(walk.echo.lag, axis=0) < 1.0 if len(walk.numbers) > 1 else np.ones(len(lag), bool)
    )
    # A microphone near the loudspeaker holds hardly more, but echoes besides.
    alone = (walk.echo.seen > SEEN).mean(axis=0) < 0.1
    early = lag < np.median(lag[found.alive]) - 2.0
    loop = found.alive & (score > ONE) & (alone if walk.survey.direct else early & steady)
    if loop.any() and not loop[found.alive].all():
        line = (
            f"loopback={naming.microphones(loop)} holds the burst as it was emitted, correlation "
            f"{score[loop].max():.3f}: must be a microphone; {naming.left_out(loop)}"
        )
        found.refuse(loop, "loopback", line=line)
        found.alive = found.alive & ~loop


def _swapped(walk: Walk, found: Verdicts) -> None:
    """Refuse microphones whose exchange makes the echoes of a walk louder."""
    exchange = exchanged(walk.echo.louder)
    if exchange is None or not all(found.words[m] == "fine" for m in exchange.pair):
        return
    which = np.isin(np.arange(len(walk.used)), exchange.pair)
    where = naming.recordings(walk.numbers, exchange.recordings)
    line = (
        f"changed places={naming.microphones(which)} in {where}: echoes must be plane waves, "
        "and are more so with the two, or their neighbours, exchanged; were plugs exchanged?"
    )
    found.refuse(which, "changes places", line=line)


def _soft(walk: Walk, found: Verdicts) -> None:
    """Tell of microphones that are softer than the others, and how to mend that."""
    level = np.median(walk.level_db, axis=0)
    below = level - np.median(level[found.alive])
    soft = found.alive & (below < SOFT_DB)
    if soft.any():
        gains = np.where(soft, np.round(10 ** (-below / 20), 1), 1.0)
        shown = ",".join(f"{gain:g}" for gain in gains)
        line = (
            f"{naming.microphones(soft)} is {-below.min():.0f} dB below the others; "
            f"gains=[{shown}] mends it"
        )
        found.name(soft, f"{below.min():.0f} dB")
        found.noticed.append(line)
