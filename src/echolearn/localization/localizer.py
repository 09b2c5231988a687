"""What a localizer is.

A localizer is a frozen dataclass called with an `Observation` (samples (B, M, N)) and returning
`Echoes` ((B, R)). Each is one module of `localization/methods`. It calls `check_arguments` where it
is made and `prepare` where it is called (`preparation`), and takes its further steps from
`estimates`.
"""

from typing import Any, Protocol

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Echoes, Observation

AUTO = "auto"
"""Value of `echoes` by which one echo is returned: the strongest that comes from a wall."""


class Localizer(Protocol):
    """An estimator of echoes."""

    @property
    def window(self) -> SearchWindow:
        """Window in which it seeks them."""

    @property
    def azimuths(self) -> int:
        """Size of its azimuth grid."""

    @property
    def echoes(self) -> int | str:
        """Number R of those it returns, or `AUTO` (`returned`)."""

    @property
    def whiten(self) -> bool | str:
        """Way in which it divides by the noise's density first, if any."""

    @property
    def sign(self) -> str:
        """Sign of the echoes that it seeks, positive or either."""

    def __call__(self, observation: Observation, view: Any = None) -> Echoes:
        """Return the echoes, fields (B, R), of observations with samples (B, M, N).

        Args:
            observation: what was recorded.
            view: its `matched_filter.MatchedFilter`, if somebody has made one.
        """


def returned(localizer: Localizer) -> int:
    """Return how many echoes a localizer returns of each observation."""
    return 1 if isinstance(localizer.echoes, str) else localizer.echoes
