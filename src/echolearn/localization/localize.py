"""From recordings to echoes and their columns: the one way of sets, comparisons and robots.

    observation --matched filters--> view --localizer--> echoes --features--> columns

The matched filters are computed once; the localizer and the columns that describe its echoes share
them, half of the work of both. A localizer that whitens makes another view for itself, its echoes
are described in this one.
"""

from collections.abc import Collection, Sequence

import numpy as np

from echolearn.acoustics.geometry import direction
from echolearn.acoustics.types import Array, Echoes, Observation
from echolearn.localization.agreement import agreement_columns
from echolearn.localization.candidates import candidates
from echolearn.localization.cfar import cfar
from echolearn.localization.columns import AGREEMENT, CFAR, COLUMNS, EVERY_TENSOR, TENSORS
from echolearn.localization.correlation_map import correlation_map
from echolearn.localization.features import echo_columns, recording_columns, steered_columns
from echolearn.localization.localizer import AUTO, Localizer
from echolearn.localization.matched_filter import COMPILED, Filters, MatchedFilter
from echolearn.localization.separation import separate
from echolearn.localization.tensors import echo_covariances
from echolearn.localization.wall_echoes import neighbour_columns, wall_echoes


def localize(
    observation: Observation,
    localizer: Localizer,
    *,
    names: Collection[str] = (*COLUMNS, *TENSORS),
    filters: Filters = COMPILED,
) -> tuple[Echoes, dict[str, Array]]:
    """Estimate the echoes of recordings, and describe them.

    Args:
        observation: samples (B, M, N), the direct path removed.
        localizer: estimates R echoes of each in its search window.
        names: columns and tensors that are wanted (`features`); what is costly and only good for
            others is left out.
        filters: what computes the matched filters.

    Returns:
        The echoes, fields (B, R), and their columns by name, a row for each of B * R echoes,
        observation by observation.

    Raises:
        BadValue: recordings that cannot be analysed (`faults`).
    """
    view = MatchedFilter(observation, localizer.window, filters=filters)
    if localizer.sign == "either":
        view = view.upright()
    if localizer.echoes == AUTO:
        echoes, beside = wall_echoes(localizer, view.observation, view=view)
        return echoes, describe([view], echoes, names=names) | beside
    echoes = localizer(view.observation, view)
    # Of several echoes each is described as the others leave it.
    return echoes, describe(separate(view, echoes), echoes, names=names)


def describe(
    views: Sequence[MatchedFilter],
    echoes: Echoes,
    *,
    names: Collection[str] = (*COLUMNS, *TENSORS),
) -> dict[str, Array]:
    """Return columns (B * R,) and tensors (B * R, ...): a row for each echo.

    Rows go observation by observation. What speaks of the whole recording is the same for all
    echoes.

    Args:
        views: matched-filter view of B observations for each echo, as the others leave it.
        echoes: their echoes, fields (B, R).
        names: what is wanted; what is costly and only good for others is not computed, though some
            may come along.
    """
    beams, tensor = recording_columns(views[0], names)
    rate = views[0].observation.probe.sample_rate
    each = []
    for r, view in enumerate(views):
        one = Echoes(*(values[:, r] for values in vars(echoes).values()))
        # Their order is that of the columns in the files of sets.
        columns = echo_columns(view, one) | beams
        index = view.index(one.toa)
        toward = direction(one.azimuth, one.elevation)
        columns |= steered_columns(view, index, toward=toward) | tensor
        if not {*AGREEMENT}.isdisjoint(names):
            columns |= agreement_columns(view, index, toward=toward)
        if CFAR in names:
            columns[CFAR] = cfar(view, index, toward=toward)
        if not {*EVERY_TENSOR}.isdisjoint(names):
            columns |= echo_covariances(view, index, toward=toward, names=names)
        if "correlation_map" in names:
            columns["correlation_map"] = correlation_map(view, index, toward=toward)
        if len(views) > 1:
            columns |= neighbour_columns(echoes, rank=r, sample_rate=rate)
        each.append(columns)
    found = {
        name: np.stack([columns[name] for columns in each], axis=1).reshape(-1, *first.shape[1:])
        for name, first in each[0].items()
    }
    if "candidates" in names:
        found["candidates"] = candidates(found, echoes=len(views))
    return found
