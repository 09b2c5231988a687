"""Estimators of echoes: several implementations of one interface, one module each.

A localizer is a frozen dataclass called with an `Observation` (samples (B, M, N)) and returning
`Echoes` ((B, R)). `beam.py` holds the functions they share: steering, covariances, steered
responses; `matched.py` the matched-filter view of a block of observations.
"""

from typing import Protocol

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Echoes, Observation
from echolearn.localization.matched_filter import MatchedFilter


class Localizer(Protocol):
    """An estimator of echoes."""

    @property
    def window(self) -> SearchWindow:
        """Where it seeks them."""

    @property
    def echoes(self) -> int:
        """R, how many it returns."""

    def __call__(self, observation: Observation, view: MatchedFilter | None = None) -> Echoes:
        """Return the echoes, fields (B, R), of observations with samples (B, M, N); `view` is
        theirs, if there is one.
        """
