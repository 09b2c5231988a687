"""Which estimated echoes are true: the labels of a row.

By the true echoes of a pose: by time alone, within 10 samples of one (`reflector`), and by time and
direction, within 10 degrees of it as well (`time_and_direction`). Each true echo serves one
estimate. By the room's outline: the echo's map point lies within 0.10 m of it (`on_map`).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.types import Array, Echoes, MicArray, Truth
from echolearn.evaluation.matching import (
    TOA_TOLERANCE_SAMPLES,
    UNMATCHED,
    agree,
    match_echoes,
)
from echolearn.evaluation.metrics import rates

MAP_TOLERANCE = 0.10
"""m; a map point this close to a wall is true."""


class Labels(NamedTuple):
    """Truth of B echoes, each of shape (B,), bool; None where it is not known."""

    strict: Array | None
    by_time: Array | None


def on_map(points: Array, sides: Array) -> Array:
    """Return which map points (P, 2) lie on one of the sides (S, 2, 2) of a floor plan."""
    return np.asarray(distance_to_outline(points, sides) <= MAP_TOLERANCE)


def label_echoes(
    truth: Sequence[Truth], echoes: Echoes, *, sample_rate: float, array: MicArray | None = None
) -> Labels:
    """Return which echoes of P poses are true, pose by pose.

    Args:
        truth: true echoes of each pose.
        echoes: fields (P, R).
        sample_rate: in Hz; times may miss by samples of it.
        array: what heard them; None tells all directions apart.
    """
    tolerance = TOA_TOLERANCE_SAMPLES / sample_rate
    fields = zip(truth, echoes.toa, echoes.azimuth, echoes.elevation, strict=True)
    found = [labels_at(true, *echo, tolerance=tolerance, array=array) for true, *echo in fields]
    return Labels(*(joined(parts) for parts in zip(*found, strict=True)))


def labels_at(
    true: Truth,
    toa: Array,
    azimuth: Array,
    elevation: Array,
    *,
    tolerance: float,
    array: MicArray | None = None,
) -> Labels:
    """Return which of R echoes at one pose are true.

    Args:
        true: the true echoes there.
        toa, azimuth, elevation: of the echoes, shape (R,).
        tolerance: of times, in s.
        array: as that of `label_echoes`.
    """
    by_time = match_echoes(true.toa, toa, tolerance=tolerance) != UNMATCHED
    if np.isnan(true.azimuth).any():
        return Labels(None, by_time)
    near = agree(true, azimuth=azimuth, elevation=elevation, array=array)
    both = match_echoes(true.toa, toa, tolerance=tolerance, allowed=near)
    return Labels(both != UNMATCHED, by_time)


def joined(parts: Sequence[Array | None]) -> Array | None:
    """Return labels as one array; None unless all parts are known."""
    known = [part for part in parts if part is not None]
    return np.concatenate(known) if len(known) == len(parts) else None


def echo_scores(labels: Labels, kept: Array) -> dict[str, Array]:
    """Return what a filter keeps of true and false echoes; by time alone, names begin with `time_`.

    Args:
        labels: truth of B echoes.
        kept: shape (B,), bool.
    """
    found = {}
    for prefix, reference in (("", labels.strict), ("time_", labels.by_time)):
        if reference is not None:
            rate = rates(reference, kept)
            found[f"{prefix}precision"] = rate["precision"]
            found[f"{prefix}true_retention"] = rate["recall"]
            found[f"{prefix}spurious_removal"] = rate["specificity"]
    return found
