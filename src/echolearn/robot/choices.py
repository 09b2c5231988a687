"""A survey as a map shall take it: its rate, its direct path, its gains, microphones left out.

A microphone that is left out is silent to what follows. Localizers that need no particular one
(`joint`, `em`, `mclam`) map with the others; those that take times from microphone 1 need that one
alone (`gated`, `snls`, `peaks`). A bundle of tensors needs all.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from echolearn.checks import BadValue, check, check_choice, check_list, check_number, check_whole
from echolearn.robot.compatibility import mount_angle
from echolearn.survey.direct_path import REMOVALS
from echolearn.survey.played import WAYS
from echolearn.survey.proof import read_proved
from echolearn.survey.survey import CALIBRATION, Survey

if TYPE_CHECKING:
    from echolearn.robot.bundle import Bundle

OF_THE_SURVEY = "it is that of the survey's folder; name=walk gives another"
"""What to do where the name that a folder has is none for what is made of it."""

OF_THE_FIRST = ("gated", "peaks", "snls")
"""Localizers that take times from microphone 1 alone."""


def with_gains(
    walk: Survey,
    bundle: "Bundle | None",
    *,
    without: Sequence[int] | None = None,
    gains: Sequence[float] | None = None,
) -> Survey:
    """Return a survey whose microphones have these gains, and 0 for those that are left out.

    Args:
        walk: the survey.
        bundle: what scores its echoes; one of tensors needs all microphones; or
            None.
        without: numbers of microphones that are left out, from 1.
        gains: a factor for each microphone.

    Raises:
        BadValue: numbers or factors that are not the array's, or fewer than two microphones left.
    """
    if without is None and gains is None:
        return walk
    count = len(walk.array)
    factors = np.ones(count)
    if gains is not None:
        check_list("gains", gains, length=count, allowed=f"must be {count} factors, [1,1,...]")
        for gain in gains:
            check_number("gains", gain, low=1e-6, high=1e6, hint="without=[3] leaves one out")
        factors = np.array(gains, dtype=float)
    if without is not None:
        check_list("without", without, allowed="must be numbers of microphones, [3]")
        for number in without:
            check_whole("without", number, low=1, high=count)
        hint = "its tensors were learned from all microphones"
        fits = bundle is None or not bundle.is_tensor
        check(fits, "without", list(without), allowed="must be null", hint=hint)
        _check_first(without, bundle)
        factors[np.array(without, dtype=int) - 1] = 0.0
        left = int(np.count_nonzero(factors))
        check(left >= 2, "without", list(without), allowed="must leave two microphones")
    return replace(walk, gains=factors)


def _check_first(without: Sequence[int], bundle: "Bundle | None") -> None:
    """Raise `BadValue` if microphone 1 is left out where a bundle's localizer needs it."""
    name = bundle.about["localizer"]["name"] if bundle else ""
    allowed = f"must not hold 1, from which the bundle's localizer, {name}, takes all times"
    hint = "a bundle trained with localizer=joint or em needs no particular microphone"
    check(
        1 not in without or name not in OF_THE_FIRST,
        "without",
        list(without),
        allowed=allowed,
        hint=hint,
    )


def open_survey(
    folder: Path,
    bundle: "Bundle",
    *,
    resample: bool,
    direct: str | None,
    played: str | None = None,
) -> Survey:
    """Return a survey that was recorded as a bundle wants it.

    Args:
        folder: of the survey.
        bundle: what its microphones, sample rate and probe must be.
        resample: bring another sample rate to the bundle's.
        direct: how to remove a direct path; None leaves that to the survey.
        played: where the burst as the loudspeaker plays it is taken from; None takes `probe.wav`.

    Raises:
        BadValue: it cannot be read, or does not fit.
    """
    walk, _ = read_proved(folder)
    return suited(walk, bundle, resample=resample, direct=direct, played=played)


def suited(
    walk: Survey,
    bundle: "Bundle",
    *,
    resample: bool,
    direct: str | None,
    played: str | None = None,
) -> Survey:
    """Return a survey as a bundle wants it; keys and errors are those of `open_survey`.

    Args:
        walk: the survey.
        bundle: what its microphones, sample rate and probe must be.
        resample: bring another sample rate to the bundle's.
        direct: how to remove a direct path; None leaves that to the survey.
        played: where the burst as the loudspeaker plays it is taken from; None takes `probe.wav`.
    """
    folder = walk.folder
    check(isinstance(resample, bool), "resample", resample, allowed="must be true or false")
    if direct is not None:
        _check_removal(walk, direct)
        walk = replace(walk, direct=direct)
    if played is not None:
        _check_played(walk, played)
        walk = replace(walk, played=played)

    rate = bundle.probe.sample_rate
    given = walk.probe.sample_rate
    hint = f"the rate is too low: the bundle listens up to {rate / 2:g} Hz"
    place = f"{folder}/survey.yaml sample_rate"
    check(given >= rate, place, f"{given:g} Hz", allowed=f"must be at least {rate:g} Hz", hint=hint)
    # Above half the lower rate nothing was recorded, which no filter brings back.
    walk = replace(walk, rate=rate if resample else None, window=bundle.localizer.window)
    try:
        mount_angle(bundle, array=walk.array, probe=walk.emitted)
    except BadValue as error:
        raise BadValue(f"{folder}: {error}") from None
    return walk


def _check_played(walk: Survey, played: str) -> None:
    """Raise `BadValue` unless a survey tells how the loudspeaker plays the burst."""
    check_choice("played", played, *WAYS)
    hint = f"{walk.folder} has direct_path: removed"
    check(walk.direct is not None, "played", played, allowed="must be null", hint=hint)
    carried = walk.loudspeakers is None
    hint = f"the loudspeaker of {walk.folder} moves on its own"
    check(carried, "played", played, allowed="must be null", hint=hint)
    recorded = played != "calibration" or (walk.folder / CALIBRATION).exists()
    hint = f"{walk.folder} has no {CALIBRATION}"
    check(recorded, "played", played, allowed="must be walk or null", hint=hint)


def _check_removal(walk: Survey, direct: str) -> None:
    """Raise `BadValue` unless the direct path of a survey can be removed in this way."""
    check(direct in REMOVALS, "direct", direct, allowed=f"must be one of {', '.join(REMOVALS)}")
    hint = f"{walk.folder} has direct_path: removed"
    check(walk.direct is not None, "direct", direct, allowed="must be null", hint=hint)
    recorded = direct != "calibration" or (walk.folder / CALIBRATION).exists()
    hint = f"{walk.folder} has no {CALIBRATION}"
    check(recorded, "direct", direct, allowed="must be fir, fitted or analytic", hint=hint)
