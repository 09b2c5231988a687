"""The errors of which a classifier was surest, and what its array heard there: `worst.csv`.

Row i of a set depends on the set's plan and i alone, so its recording is made again from its seed
and the matched filters are steered once more: J(tau, phi), with the echo that the localizer chose
and the true ones. A set's manifest holds arrays as hashes; whoever has composed its plan again, and
proved that it is the same, gives it (`PlanOf`).
"""

from collections.abc import Callable

import numpy as np

from echolearn.acoustics.rooms import true_echoes
from echolearn.comparison.choice import Comparison, away, chosen, is_evaluated
from echolearn.comparison.examined import BELIEVED, MISSED, Picture, Worst
from echolearn.dataset.labelled_set import Dataset
from echolearn.dataset.plans import Plan
from echolearn.dataset.records import recordings_of
from echolearn.evaluation.rows import Row
from echolearn.localization.localizer import returned
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.training.predictions import label_rows, predict_rows

COLUMNS = (
    "classifier trained_on tested_on seed row error confidence snr_db toa azimuth elevation"
).split()
"""Columns of `worst.csv`."""

LISTED, DRAWN = 20, 3
"""Errors of either kind that are listed, and that are drawn."""

PlanOf = Callable[[Dataset], Plan | None]
"""The plan that a set was made by, or None where nobody knows."""


def worst_errors(comparison: Comparison, plan_of: PlanOf) -> Worst:
    """Return the errors of which the chosen model was surest, with pictures of some."""
    model = chosen(comparison)
    run = comparison.models[model][0]
    shown = away(comparison)
    dataset = comparison.sets[shown]
    if not is_evaluated(comparison, model, name=shown):
        return Worst([], [])
    given = predict_rows(run, dataset)
    true = label_rows(dataset, resamples=1).reference[given.rows]
    about: Row = {"classifier": model.classifier, "trained_on": model.trained_on}
    about |= {"tested_on": dataset.name, "seed": run.seed}
    rows = []
    for error, wrong, order in (
        (BELIEVED, ~true & given.kept, -given.confidence),
        (MISSED, true & ~given.kept, given.confidence),
    ):
        ranked = np.argsort(order, kind="stable")
        for place in ranked[wrong[ranked]][:LISTED]:
            number = int(given.rows[place])
            confidence = float(given.confidence[place])
            cells = {"row": number, "error": error, "confidence": confidence}
            rows.append(about | cells | _estimate(dataset, number))
    plan = plan_of(dataset)
    if plan is None:
        return Worst(rows, [])
    drawn = [
        row
        for error in (BELIEVED, MISSED)
        for row in [each for each in rows if each["error"] == error][:DRAWN]
    ]
    return Worst(rows, [picture(plan, row) for row in drawn])


def _estimate(dataset: Dataset, number: int) -> Row:
    """Return the SNR of a row, and what its localizer chose."""
    rows = np.array([number])
    names = ("toa", "azimuth", "elevation")
    found = {name: float(dataset.gather(name, rows)[0]) for name in names}
    return {"snr_db": float(dataset.ratio_db[number])} | found


def picture(plan: Plan, row: Row) -> Picture:
    """Return what was heard for a row of a plan's set.

    Args:
        plan: that the set was made by.
        row: row of `worst.csv`.
    """
    # An observation with R echoes has R rows.
    observed = row["row"] // returned(plan.localizer)
    observation, [spot] = recordings_of(plan, range(observed, observed + 1))
    view = MatchedFilter(observation, plan.window)
    # The array's axis, floor and ceiling, comes after the level directions and is not drawn.
    level = view.steered[0][: view.azimuths].astype(float)
    lags = np.arange(level.shape[1])
    speed = plan.scene.speed_of_sound
    return Picture(
        row,
        response=level / max(level.max(), np.finfo(float).tiny),
        azimuths=view.directions[0][: view.azimuths],
        distances=speed * view.toa(lags) / 2,
        truth=true_echoes(spot.room, spot.pose, array=plan.scene.array, speed_of_sound=speed),
        speed_of_sound=speed,
    )
