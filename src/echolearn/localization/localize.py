"""From recordings to echoes and their columns: the one way of sets, comparisons and robots.

    observation --matched filters--> view --localizer--> echoes --features--> columns

The matched filters are computed once; the localizer and the columns that describe its echoes share
them, half of the work of both. A localizer that whitens makes another view for itself, its echoes
are described in this one.
"""

from collections.abc import Collection

from echolearn.acoustics.types import Array, Echoes, Observation
from echolearn.localization.columns import COLUMNS, TENSORS
from echolearn.localization.estimates import wall_echoes
from echolearn.localization.features import describe
from echolearn.localization.localizer import AUTO, Localizer
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.localization.separation import separate


def localize(
    observation: Observation, localizer: Localizer, *, names: Collection[str] = (*COLUMNS, *TENSORS)
) -> tuple[Echoes, dict[str, Array]]:
    """Estimate the echoes of recordings, and describe them.

    Args:
        observation: samples (B, M, N), the direct path removed.
        localizer: estimates R echoes of each in its search window.
        names: columns and tensors that are wanted (`features`); what is costly and only good for
            others is left out.

    Returns:
        The echoes, fields (B, R), and their columns by name, a row for each of B * R echoes,
        observation by observation.

    Raises:
        BadValue: recordings that cannot be analysed (`faults`).
    """
    view = MatchedFilter(observation, localizer.window)
    if localizer.sign == "either":
        view = view.upright()
    if localizer.echoes == AUTO:
        echoes, beside = wall_echoes(localizer, view.observation, view=view)
        return echoes, describe([view], echoes, names=names) | beside
    echoes = localizer(view.observation, view)
    # Of several echoes each is described as the others leave it.
    return echoes, describe(separate(view, echoes), echoes, names=names)
