"""How each localizer begins: its arguments are checked, its recordings checked and whitened.

arguments --check_arguments--> nothing, or one line
Observation --prepare--> MatchedFilter
"""

from echolearn.acoustics.arrays import limits, tells_azimuth
from echolearn.acoustics.types import Observation
from echolearn.checks import Range, check, check_choice, check_fields
from echolearn.localization.correlations import PAD
from echolearn.localization.localizer import AUTO, Localizer, returned
from echolearn.localization.matched_filter import COMPILED, MatchedFilter, check_echoes
from echolearn.localization.silence import warn_of_silent
from echolearn.localization.whitening import whitened

MOST_DIRECTIONS = 7200
"""Largest grid: its steering weights take 36 * 442 * 4 bytes a direction for 6 microphones."""

RANGES: dict[str, Range] = {
    "azimuths": (8, 3600, ""),
    "elevations": (1, 90, ""),
    "echoes": (1, 64, ""),
    "iterations": (1, 10_000, ""),
    "gamma": (0.0, 1.0, ""),
    "loading": (0.0, 1e6, ""),
    "false_alarm": (1e-12, 1.0, ""),
}
"""Least and largest value of each argument that a localizer may have."""


def check_arguments(localizer: Localizer, *ways: str, tells_floor: bool = False) -> None:
    """Raise `BadValue` for arguments that no localizer can use.

    Args:
        localizer: just made.
        ways: what `whiten` may be besides true and false.
        tells_floor: whether it tells echoes of floor and ceiling from those of walls.
    """
    ranges = RANGES
    if getattr(localizer, "echoes", 1) == AUTO:
        hint = "gated, joint and em tell floor and ceiling from walls"
        allowed = "must be a whole number"
        check(tells_floor, "localizer.echoes", AUTO, allowed=allowed, hint=hint)
        ranges = {name: bounds for name, bounds in RANGES.items() if name != "echoes"}
    check_fields("localizer", localizer, ranges=ranges)
    check_choice("localizer.sign", localizer.sign, "positive", "either")
    check(
        isinstance(localizer.whiten, bool) or localizer.whiten in ways,
        "localizer.whiten",
        localizer.whiten,
        allowed=f"must be {', '.join(['true', 'false', *ways])}",
        hint="" if ways else "spatial is for localizer=joint",
    )


def check_directions(azimuths: int, elevations: int) -> None:
    """Raise `BadValue` for a grid of more than `MOST_DIRECTIONS`."""
    check(
        azimuths * elevations <= MOST_DIRECTIONS,
        "localizer.azimuths",
        azimuths,
        allowed=f"azimuths * elevations must be at most {MOST_DIRECTIONS}",
        hint="memory would end",
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
        BadValue: recordings that cannot be analysed (`faults`), or hold too few lags for R echoes,
            or an array that hears no azimuth.
    """
    # Of one microphone nobody expects a direction; of several it would be taken for one.
    check(
        len(observation.array) == 1 or tells_azimuth(observation.array),
        "array.positions",
        limits(observation.array),
        allowed="must not stand one above another; a localizer's echoes have azimuths",
    )
    grid = (localizer.window, localizer.azimuths)
    if view is None or (view.window, view.azimuths) != grid:
        filters = COMPILED if view is None else view.filters
        view = MatchedFilter(observation, *grid, filters=filters)
    if localizer.whiten:
        touched = view.last + PAD + len(observation.probe.samples)
        quiet = whitened(observation, samples=None if whole else touched)
        view = MatchedFilter(quiet, *grid, white=True, filters=view.filters)
    if localizer.sign == "either":
        view = view.upright()
    check_echoes(view, returned(localizer))
    warn_of_silent(view.silent, reference=reference)
    return view
