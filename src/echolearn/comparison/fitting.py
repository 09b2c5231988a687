"""Was a run trained for this robot? It must have the array and the rate of what it is tested on.

A classifier of columns computes something on any array, and one of tensors fails on another number
of microphones; neither was made for it. So a comparison says of each such pair, in a row of its
own, that the array or the rate is another, and nothing else. Likewise where the columns that a
model looks at are not there, as those of several echoes are not where one was sought, and where a
bundle meets the set that it was trained on without its run.
"""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from echolearn.acoustics.turned_array import DISPLACED, turn_between
from echolearn.acoustics.types import Array, MicArray
from echolearn.checks import check
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation.rows import (
    MISSING_COLUMNS,
    OTHER_ARRAY,
    OTHER_RATE,
    OWN_SET,
    UNFIT,
    Model,
    Recordings,
    Row,
    distinct,
    pick,
)
from echolearn.storage.identity import plain
from echolearn.survey.reader import read_survey
from echolearn.training.runs import Run


class Robot(NamedTuple):
    """What test rows were recorded with.

    Attributes:
        array: microphones in plain containers, as manifests have them.
        sample_rate: in Hz.
        positions: of the microphones, shape (M, 3), in m; None where only their digest is known.
    """

    array: Mapping[str, Any]
    sample_rate: float
    positions: Array | None = None


def robot_of(array: MicArray, sample_rate: float) -> Robot:
    """Return what recordings with these microphones at this rate were made with."""
    return Robot(plain(array), sample_rate, array.positions)


def robot_in(scene: Mapping[str, Any]) -> Robot:
    """Return the robot of a set, by the scene in its manifest."""
    return Robot(scene["array"], scene["probe"]["sample_rate"])


def robot_at(folder: Path) -> Robot:
    """Return the robot of a survey."""
    survey = read_survey(folder)
    return robot_of(survey.array, survey.emitted.sample_rate)


def misfit(run: Run, trained: Robot | None, *, tested: Robot) -> str:
    """Return which of `UNFIT` holds of a run and what it is tested on; nothing if it fits.

    Args:
        run: finished run.
        trained: robot of its training set; None where that is not known, which fits all.
        tested: robot of the test rows.
    """
    if trained is None:
        return ""
    if trained.sample_rate != tested.sample_rate:
        return OTHER_RATE
    if trained.array == tested.array:
        return ""
    # Digests differ as soon as a digit does: a robot's own survey may have fewer.
    known = run.metrics.get("microphones")
    if known is None or tested.positions is None or len(known) != len(tested.positions):
        return OTHER_ARRAY
    _, off = turn_between(np.array(known), tested.positions)
    return OTHER_ARRAY if off > DISPLACED else ""


def split_fitting(
    models: Mapping[Model, Sequence[Run]],
    trained: Mapping[str, Robot],
    *,
    tested: Robot,
    holds: Callable[[set[str]], bool],
    data: str = "",
) -> tuple[dict[Model, Sequence[Run]], dict[Model, str]]:
    """Return the models whose runs fit what they are tested on, and of the others why not.

    Args:
        models: finished runs of each model.
        trained: robots of training sets by the sets' digests.
        tested: robot of the test rows.
        holds: tells whether these have all of some columns.
        data: digest of the set that they are; of recordings none.
    """
    fitting: dict[Model, Sequence[Run]] = {}
    unfit: dict[Model, str] = {}
    for model, runs in models.items():
        reasons = [misfit(run, trained.get(run.data_digest), tested=tested) for run in runs]
        reasons += [MISSING_COLUMNS for run in runs if not holds({*run.inputs})]
        unknown = [run for run in runs if not run.metrics.get("held_out", True)]
        reasons += [OWN_SET for run in unknown if run.data_digest == data]
        found = next(filter(None, reasons), "")
        if found:
            unfit[model] = found
        else:
            fitting[model] = runs
    return fitting, unfit


def fitting_set(
    models: Mapping[Model, Sequence[Run]], dataset: Dataset, *, robots: Mapping[str, Robot]
) -> tuple[dict[Model, Sequence[Run]], dict[Model, str]]:
    """Return the models that can say something about a set, and of the others why not.

    Args:
        models: finished runs of each model.
        dataset: the set.
        robots: robots of training sets, by the sets' digests.
    """
    robot = robot_in(dataset.manifest["plan"]["scene"])
    return split_fitting(models, robots, tested=robot, holds=dataset.holds, data=dataset.digest)


def unfit_rows(unfit: Mapping[Model, str], source: Recordings) -> list[Row]:
    """Return a row for each model that says why it is not evaluated."""
    cells = {"seed": "", "snr_db": "", "n": 0, "value": np.nan, "ci_low": "", "ci_high": ""}
    return [
        model.columns() | source._asdict() | cells | {"metric": reason}
        for model, reason in unfit.items()
    ]


def check_some_fit(rows: Sequence[Row]) -> None:
    """Raise `BadValue` if walks are mapped for whose robot no run was trained."""
    walks = pick(rows, kind="survey")
    known = any(row["role"] != "reference" and row["metric"] not in UNFIT for row in walks)
    names = ", ".join(distinct(walks, "tested_on"))
    allowed = "must be of an array and a rate for which a run was trained"
    hint = "generate and train with their scene, scene=..."
    check(known or not walks, "surveys", names, allowed=allowed, hint=hint)
