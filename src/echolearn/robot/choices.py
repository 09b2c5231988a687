"""What the user of a map knows better: gains, microphones to leave out, the sign of echoes.

A microphone that is left out is silent to what follows. Localizers that need no particular one
(`joint`, `em`, `mclam`) map with the others; those that take times from microphone 1 need that one
alone (`gated`, `snls`, `peaks`). A bundle of tensors needs all.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from echolearn.checks import check, check_list, check_number, check_whole
from echolearn.survey.reader import Survey

if TYPE_CHECKING:
    from echolearn.robot.bundle import Bundle
    from echolearn.robot.scorer import Scorer


def seeking(scorer: "Scorer", localizer: Mapping[str, Any] | None) -> "Scorer":
    """Return a scorer whose localizer seeks echoes of the `sign` that is asked for, if one is."""
    sign = (localizer or {}).get("sign")
    if sign is None:
        return scorer
    other: Any = replace(scorer.bundle.localizer, sign=sign)  # type: ignore[type-var]
    return replace(scorer, bundle=replace(scorer.bundle, localizer=other))


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
        factors[np.array(without, dtype=int) - 1] = 0.0
        left = int(np.count_nonzero(factors))
        check(left >= 2, "without", list(without), allowed="must leave two microphones")
    return replace(walk, gains=factors)
