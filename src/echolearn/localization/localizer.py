"""What a localizer is, and how each begins.

A localizer is a frozen dataclass called with an `Observation` (samples (B, M, N)) and returning
`Echoes` ((B, R)). Each is one module of `localization/methods`. It calls `check_arguments` where it
is made and `prepare` where it is called, and takes its further steps from `estimates`.
"""

from typing import Protocol

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Echoes, Observation
from echolearn.checks import check, check_whole
from echolearn.localization.correlations import PAD
from echolearn.localization.faults import check_recordings, warn_of_silent
from echolearn.localization.matched_filter import MatchedFilter, check_echoes
from echolearn.localization.whitening import whitened


class Localizer(Protocol):
    """An estimator of echoes."""

    @property
    def window(self) -> SearchWindow:
        """Window in which it seeks them."""

    @property
    def azimuths(self) -> int:
        """Size of its azimuth grid."""

    @property
    def echoes(self) -> int:
        """Number R of those it returns."""

    @property
    def whiten(self) -> bool | str:
        """Way in which it divides by the noise's density first, if any."""

    @property
    def sign(self) -> str:
        """Sign of the echoes that it seeks, positive or either."""

    def __call__(self, observation: Observation, view: MatchedFilter | None = None) -> Echoes:
        """Return the echoes, fields (B, R), of observations with samples (B, M, N).

        Args:
            observation: what was recorded.
            view: its matched-filter view, if somebody has made one.
        """


def check_arguments(localizer: Localizer, *ways: str) -> None:
    """Raise `BadValue` for arguments that no localizer can use; `whiten` may also be in `ways`."""
    check_whole("localizer.azimuths", localizer.azimuths, low=8, high=3600)
    check_whole("localizer.echoes", localizer.echoes, low=1, high=64)
    known = localizer.sign in ("positive", "either")
    check(known, "localizer.sign", localizer.sign, allowed="must be positive or either")
    check(
        isinstance(localizer.whiten, bool) or localizer.whiten in ways,
        "localizer.whiten",
        localizer.whiten,
        allowed=f"must be {', '.join(['true', 'false', *ways])}",
        hint="" if ways else "spatial is for localizer=joint",
    )


def prepare(
    localizer: Localizer,
    observation: Observation,
    *,
    view: MatchedFilter | None,
    whole: bool,
    reference: bool,
) -> MatchedFilter:
    """Check recordings, whiten them where asked, and return their matched-filter view.

    Args:
        localizer: that asks.
        observation: recordings (B, M, N).
        view: of the same recordings, if somebody has made one; it is returned where it serves.
        whole: whether more of the recordings is needed than the search window touches.
        reference: whether times come from microphone 1 alone, which must not be silent then.

    Raises:
        BadValue: recordings that cannot be analysed (`faults`), or hold too few lags for R echoes.
    """
    window = localizer.window
    azimuths = localizer.azimuths
    if localizer.whiten:
        _, last = check_recordings(observation, window, beyond=PAD)
        touched = last + PAD + len(observation.probe.samples)
        quiet = whitened(observation, samples=None if whole else touched)
        view = MatchedFilter(quiet, window, azimuths, white=True)
    elif view is None or (view.window, view.azimuths) != (window, azimuths):
        view = MatchedFilter(observation, window, azimuths)
    if localizer.sign == "either":
        view = view.upright()
    check_echoes(view, localizer.echoes)
    warn_of_silent(view.silent, reference=reference)
    return view
