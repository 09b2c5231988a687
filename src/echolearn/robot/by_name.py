"""Localizers by name, for a first look: `echolearn.localize`."""

from dataclasses import replace

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, Echoes, Observation
from echolearn.checks import check
from echolearn.localization.localize import localize
from echolearn.localization.localizer import Localizer
from echolearn.robot.bundle import localizer_names, localizer_of

NEAR = SearchWindow()
"""Distances within which echoes are sought unless others are told: the paper's, 1 to 2 m."""


def localize_named(
    observation: Observation, localizer: str | Localizer = "gated", *, window: SearchWindow = NEAR
) -> tuple[Echoes, dict[str, Array]]:
    """Estimate echoes, and describe them by columns.

    Args:
        observation: samples (M, N) of one pose or (B, M, N) of several, without the direct path.
        localizer: a localizer, or the name of one with its usual settings.
        window: distances within which a localizer that is named seeks echoes.

    Returns:
        The echoes, fields (B, R), and their columns by name, (B R,).

    Raises:
        BadValue: no localizer of that name, or recordings that cannot be analysed.
    """
    hint = "of a survey's pose 0: survey.observe([0])"
    allowed = "must be an Observation"
    given = type(observation).__name__
    check(isinstance(observation, Observation), "observation", given, allowed=allowed, hint=hint)
    if isinstance(localizer, str):
        localizer = localizer_of(name=localizer, arguments={}, window=window)
    allowed = f"must be a localizer, or one of {', '.join(localizer_names())}"
    fits = hasattr(localizer, "window")
    check(fits, "localizer", type(localizer).__name__, allowed=allowed)
    return localize(batched(observation), localizer)


def batched(observation: Observation) -> Observation:
    """Return recordings (B, M, N), of a single one (M, N), too."""
    if observation.samples.ndim == 3:
        return observation
    return replace(observation, samples=observation.samples[None])
