"""Echoes of walls where those of floor and ceiling are louder.

    strongest echo --from the array's axis?--> several --> the first that comes from a wall

Each of the several is sought in what the others leave.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array, Echoes, Observation
from echolearn.localization.columns import SEVERAL
from echolearn.localization.correlations import ratio_or_zero
from echolearn.localization.matched_filter import MatchedFilter

LOWEST_SINE = 0.5
"""Sine of the elevation above which an echo counts as a wall's: 30 degrees off the axis."""

SOUGHT = 5
"""Echoes that are sought where the strongest comes from floor or ceiling."""


def wall_echoes(
    localizer: Any, observation: Observation, *, view: MatchedFilter | None
) -> tuple[Echoes, dict[str, Array]]:
    """Return the strongest echo of each recording that comes from a wall, and what it is beside.

    Under a low ceiling the strongest of all comes from there or from the floor. Where it does,
    `SOUGHT` are sought, each in what the others leave; if all of them do, the strongest stays.

    Args:
        localizer: a dataclass with `echoes`, which tells floor and ceiling.
        observation: recordings (B, M, N).
        view: their matched-filter view, if somebody has made one.

    Returns:
        Echoes, fields (B, 1), and by name the columns (B,) that tell one of several echoes from the
        others. Where no others were sought none is stronger, and the nearest is as far away as the
        window is wide, of gain 0.
    """
    if view is None:
        view = MatchedFilter(observation, localizer.window, localizer.azimuths)
    found = replace(localizer, echoes=1)(observation, view)
    beside = {name: np.zeros(len(found.toa)) for name in SEVERAL}
    beside["neighbour_lag"] += view.last - view.first
    rows = np.flatnonzero(~on_no_axis(found)[:, 0])
    if not len(rows):
        return found, beside
    low = replace(observation, samples=observation.samples[rows])
    several = replace(localizer, echoes=SOUGHT)(low, replace(view, observation=low))
    first = on_no_axis(several).argmax(axis=-1)
    fields = {name: values.copy() for name, values in vars(found).items()}
    for name, values in fields.items():
        values[rows] = np.take_along_axis(getattr(several, name), first[:, None], axis=-1)
    rate = view.observation.probe.sample_rate
    ranks = [neighbour_columns(several, rank=rank, sample_rate=rate) for rank in range(SOUGHT)]
    for name, values in beside.items():
        values[rows] = np.stack([each[name] for each in ranks])[first, np.arange(len(rows))]
    return Echoes(**fields), beside


def on_no_axis(echoes: Echoes) -> Array:
    """Tell which echoes come from walls rather than floor or ceiling, shape (B, R), bool."""
    return np.asarray(np.sin(echoes.elevation) > LOWEST_SINE)


def neighbour_columns(echoes: Echoes, *, rank: int, sample_rate: float) -> dict[str, Array]:
    """Return the columns that tell one of several echoes from the others, fields (B,).

    Args:
        echoes: fields (B, R).
        rank: which of the R, from 0, the strongest.
        sample_rate: in Hz.
    """
    others = np.delete(np.arange(echoes.toa.shape[1]), rank)
    apart = np.abs(echoes.toa[:, others] - echoes.toa[:, rank, None])
    nearest = apart.argmin(axis=-1)[:, None]
    own = echoes.gain[:, rank]
    return {
        "rank": np.full(len(own), float(rank)),
        "neighbour_lag": apart.min(axis=-1) * sample_rate,
        "neighbour_gain": ratio_or_zero(
            np.take_along_axis(echoes.gain[:, others], nearest, axis=-1)[:, 0], own
        ),
    }
