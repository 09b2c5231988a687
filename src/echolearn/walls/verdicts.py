"""Which lines of a walk are walls: a classifier's verdicts on its hypotheses, and their tracks.

    HeardWalk --hypotheses, strips--> inputs (K, ...) --confidence--> believed --follow--> tracks

The classifier is any function from inputs to confidences; which inputs it wants, its bundle says:
columns of sound (`nouns.SOUND`), or strips as networks look at them, `strip_rows`. What is done
here for a robot is what was done for the set that the classifier was trained on.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.walls.hypotheses import hypotheses
from echolearn.walls.nouns import SOUND, Hypotheses
from echolearn.walls.strips import Strips, sound_columns, strip_rows, strips
from echolearn.walls.track import Track, follow
from echolearn.walls.walk import HeardWalk

FILLING = 0
"""Seed of the noise that fills strips outside the window: the same walk has the same verdicts."""


@dataclass(frozen=True)
class WallClassifier:
    """How lines are told from walls.

    Attributes:
        inputs: names of columns of sound, or `strips` alone.
        confidence: function from float32 inputs (K, ...) to the belief in each line, (K,).
        threshold: belief from which a line counts as a wall.
        count: most hypotheses of a walk, before those that the path crosses are dropped.
    """

    inputs: Sequence[str]
    confidence: Callable[[Array], Array]
    threshold: float
    count: int


@dataclass(frozen=True)
class WallVerdicts:
    """What a classifier says of the hypotheses of a walk.

    Attributes:
        found: K hypotheses, those with the most evidence first.
        confidence: belief in each, shape (K,).
        believed: which are taken for walls, shape (K,).
        tracks: of each, where the poses heard it.
    """

    found: Hypotheses
    confidence: Array
    believed: Array
    tracks: tuple[Track, ...]

    @property
    def walls(self) -> list[Track]:
        """Tracks of the hypotheses that are taken for walls."""
        return [self.tracks[number] for number in np.flatnonzero(self.believed)]


def verdicts(walk: HeardWalk, classifier: WallClassifier) -> WallVerdicts:
    """Return what a classifier says of the lines that a walk speaks for."""
    found = hypotheses(walk, count=classifier.count)
    cut = strips(walk, found)
    # Of nothing, no model need be asked.
    belief = np.zeros(0)
    if len(found):
        inputs = inputs_of(walk, found, cut=cut, names=classifier.inputs)
        belief = classifier.confidence(inputs)
    tracks = tuple(follow(walk, found, cut=cut, number=number) for number in range(len(found)))
    return WallVerdicts(found, belief, belief >= classifier.threshold, tracks)


def inputs_of(walk: HeardWalk, found: Hypotheses, *, cut: Strips, names: Sequence[str]) -> Array:
    """Return what a classifier looks at, float32, columns (K, names) or strips (K, N, entries).

    Args:
        walk: what was heard, and where.
        found: K hypotheses of it.
        cut: their strips.
        names: names of the classifier's inputs.
    """
    if not {*names} <= {*SOUND}:
        rows = strip_rows(walk, cut, number=0, rng=np.random.default_rng(FILLING))
        # Poses that see nothing stand last, and weigh nothing; two have the mark of the walk.
        most = max(2, int(cut.seen.sum(axis=1).max()))
        return rows[:, :most].astype(np.float32)
    columns = sound_columns(walk, found, cut=cut)
    return np.ascontiguousarray(columns[:, [SOUND.index(name) for name in names]])
