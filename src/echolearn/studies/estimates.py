"""Estimates of a study: what each localizer gets right in the recordings at one value.

Processes that make them load this module, and so nothing that draws.
"""

from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Array
from echolearn.storage import manifests
from echolearn.studies.accuracy import DRAWS, METRICS, drawn_by_chance, is_right, strongest_echo
from echolearn.studies.recordings import Condition, Position, record
from echolearn.studies.study import Study


def write_estimates(study: Study, folder: Path, *, index: int) -> None:
    """Write what localizers get right at one value.

    Args:
        study: names the values, the localizers and the trials.
        folder: of the shards.
        index: number of the value.
    """
    manifests.write_shard(folder, index, array=estimate(study, study.values[index]))


def estimate(study: Study, value: Any) -> Array:
    """Return what every localizer gets right in the recordings at one value.

    Returns:
        Records, shape (trials,): `position`, its number; `hit`, shape (localizers + 1, 4): for each
        localizer, whether the metrics in the order of `METRICS` are met, and last the share for
        `chance`.
    """
    condition = study.condition(value)
    shape = (len(study.localizers) + 1, len(METRICS))
    table = np.empty(study.trials, dtype=[("position", int), ("hit", float, shape)])
    shared_out = np.array_split(np.arange(study.trials), study.positions)
    for number, (pose, trials) in enumerate(zip(study.poses(), shared_out, strict=True)):
        position = study.position(number, pose).under(condition)
        table["position"][trials] = number
        table["hit"][trials] = evaluate_position(
            study, position, condition=condition, trials=trials
        )
    return table


def evaluate_position(
    study: Study, position: Position, *, condition: Condition, trials: Array
) -> Array:
    """Return which metrics each localizer and, last, chance meet at one position.

    Args:
        study: localizers, window and seed.
        position: where, and with what.
        condition: levels, fault, room.
        trials: numbers of its recordings, shape (B,).

    Returns:
        Shape (B, localizers + 1, 4); of chance the share of its draws; NaN where a localizer
        refuses the array.
    """
    observation = record(position, condition, trials=trials.tolist(), seed=study.seed)
    other = condition.array is not None
    may_refuse = condition.fault.dead > 0 or other
    estimates = [
        strongest_echo(localizer, observation, may_refuse=may_refuse)
        for localizer in study.localizers.values()
    ]
    rng = stream(study.seed, "guess", position.number)
    count = len(trials) * DRAWS
    estimates.append(drawn_by_chance(position.scene, study.window, count=count, rng=rng))
    shares = []
    for each in estimates:
        right = is_right(each, room=condition.room, pose=position.pose, scene=position.scene)
        if other:
            # What a dead microphone costs is wrong, what no array like this can tell is no number.
            right = np.where(np.isnan(each[:, :1]), np.nan, right)
        shares.append(right.reshape(len(trials), -1, len(METRICS)).mean(axis=1))
    return np.stack(shares, axis=1)
