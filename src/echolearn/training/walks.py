"""The reference of a bundle: what its classifier learned from, as simulated walks hear it.

A training set draws room, noise and robot anew for each row, so none of its rows belong together,
and statistics over them say nothing of how much those of one survey vary. A set of the same plan
whose `poses` is above 1 has what is needed: that many successive rows share one room, one level of
noise, one gain and one robot, drawn as each row of the training set draws its own, and differ in
place, heading and noise. Each of these groups is one survey of the training kind.

    training set, set of walks --reference_of--> Reference --> reference.npz
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from echolearn.checks import check
from echolearn.classifiers.inputs import is_tensor
from echolearn.dataset.labelled_set import Dataset
from echolearn.dataset.plans import ScatteredPlan
from echolearn.localization.columns import COLUMNS
from echolearn.robot.domain import LEVEL
from echolearn.robot.reference import Reference

POSES = 8
"""Poses of a simulated walk: enough for a median, and few, since each takes 17 ms to simulate."""

WALKS = 512
"""Walks of a reference."""

TAIL = 0.01
"""Share of the training rows beyond each limit."""

OWN = ("name", "seed", "rows", "role", "poses", "shard_rows", "further")
"""Keys of a plan in which a set of walks may differ from the set that it stands for."""

OF_THE_PLACE = ("toa", "gain", "gain_delay", "power", "azimuth", "elevation", "azimuth_mpdr")
"""Columns that say where a robot stands, turns and how loud it is set rather than how it hears."""


def walks_plan(plan: ScatteredPlan, walks: int = WALKS) -> ScatteredPlan:
    """Return the plan of the walks that stand for the set of a plan."""
    name = f"{plan.name}_walks"
    return replace(plan, name=name, seed=plan.seed + 1, poses=POSES, rows=POSES * walks)


def reference_of(inputs: Sequence[str], dataset: Dataset, *, walks: Dataset) -> Reference:
    """Return what a classifier's training set looks like, walk by walk.

    Args:
        inputs: what the classifier looks at; for one of tensors it is told by columns.
        dataset: set that it was trained on.
        walks: set of walks of the same plan.

    Raises:
        BadValue: a set of another plan, without walks, or with too few to tell anything.
    """
    plan = dataset.manifest["plan"]
    allowed = "must be null for a classifier of walls, which knows no single echoes"
    check("walks" not in plan, "reference", walks.name, allowed=allowed)
    _check_alike(plan, walks.manifest["plan"])
    names = tuple(inputs)
    if is_tensor(inputs):
        names = tuple(name for name in COLUMNS if name not in OF_THE_PLACE)
    poses = walks.manifest["plan"]["poses"]
    count = len(walks) // (poses * walks.echoes)
    least = round(len(names) / LEVEL)
    allowed = f"must be at least {least} walks of {poses} poses for {len(names)} columns"
    hint = "of fewer, none can be rare enough for Holm's correction"
    check(count >= least, "reference", f"{count} walks", allowed=allowed, hint=hint)

    # Of several echoes of a pose the strongest, which comes first, speaks for it.
    rows = np.arange(count * poses) * walks.echoes
    columns = [walks.gather(name, rows).reshape(count, poses) for name in names]
    usual = [np.quantile(dataset[name], [TAIL, 1.0 - TAIL]) for name in names]
    return Reference(names, np.stack(columns, axis=-1), np.stack(usual, axis=-1))


def _check_alike(plan: Any, other: Any) -> None:
    """Raise `BadValue` unless the second plan, of a set, is that of walks of the first."""
    several = other.get("poses", 1) > 1
    hint = "echolearn generate ... plan.poses=8 plan.rows=4096 plan.name=<name> plan.seed=<other>"
    allowed = "must be a set of walks"
    check(several, "reference", other["name"], allowed=allowed, hint=hint)
    keys = sorted(({*plan} | {*other}) - {*OWN})
    differ = [key for key in keys if plan.get(key) != other.get(key)]
    allowed = f"must be of the plan of {plan['name']}"
    shown = f"{other['name']}, which differs in {', '.join(differ)}"
    check(not differ, "reference", shown, allowed=allowed)
    fresh = plan["seed"] != other["seed"]
    hint = "walks that the classifier has learned from are no others"
    check(fresh, "reference", other["name"], allowed="must have another plan.seed", hint=hint)
