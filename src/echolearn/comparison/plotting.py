"""Pictures of what the library returns, for a notebook: `echolearn.plot`.

a walk          -> where the robot stood and looked, and the walls, if they are known
a map           -> points that are kept, and those that are not
an observation  -> J(tau, phi), the steered response over distance and direction
a run           -> its reliability: what it believes of the rows held out, and what is true
"""

from functools import singledispatch
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import EchoMap, Observation
from echolearn.checks import BadValue
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation.reliability import curve
from echolearn.localization.matched_filter import MatchedFilter
from echolearn.robot.by_name import batched
from echolearn.robot.scorer import ScoredEchoes
from echolearn.storage import manifests
from echolearn.storage.identity import digest
from echolearn.survey.survey import Survey
from echolearn.training.predictions import predict_rows
from echolearn.training.runs import Run
from echolearn.training.split import LearningProblem


def plot(thing: Any, axis: Axes | None = None) -> Axes:
    """Draw a walk, a map, an observation or a run: `plot(open_survey("walk"))`.

    Returns:
        The axes that it is drawn in: `axis`, or those of a new figure.

    Raises:
        BadValue: something else, or a run whose set is not there.
    """
    if axis is None:
        _, axis = plt.subplots(layout="constrained")
    _draw(thing, axis)
    return axis


@singledispatch
def _draw(thing: Any, axis: Axes) -> None:
    """Draw a thing of a kind that is known."""
    kinds = "Survey, EchoMap, ScoredEchoes, Observation or Run"
    raise BadValue(f"thing={type(thing).__name__}: must be a {kinds}")


@_draw.register
def _(walk: Survey, axis: Axes) -> None:
    places = np.array([pose.position[:2] for pose in walk.poses])
    heading = np.array([pose.heading for pose in walk.poses])
    axis.plot(*places.T, "-", color="0.8", linewidth=1)
    axis.quiver(*places.T, np.cos(heading), np.sin(heading), color="0.4", width=4e-3)
    for side in walk.walls if walk.walls is not None else ():
        axis.plot(*side.T, color="black", linewidth=2)
    _floor_plan(axis)


@_draw.register
def _(found: EchoMap, axis: Axes) -> None:
    kept = np.ones(len(found.points), dtype=bool) if found.kept is None else found.kept
    axis.plot(*found.points[~kept].T, "x", color="tab:orange", label="not believed")
    axis.plot(*found.points[kept].T, "o", color="tab:blue", label="kept")
    axis.legend()
    _floor_plan(axis)


@_draw.register
def _(scored: ScoredEchoes, axis: Axes) -> None:
    _draw(scored.map, axis)


@_draw.register
def _(observation: Observation, axis: Axes) -> None:
    view = MatchedFilter(batched(observation), SearchWindow())
    # The last directions are those of the array's axis, up and down.
    response = view.steered[0, : view.azimuths]
    order = np.argsort(view.directions[0][: view.azimuths])
    azimuth = np.rad2deg(view.directions[0][order])
    distance = view.toa(np.arange(response.shape[1])) * observation.speed_of_sound / 2
    axis.pcolormesh(distance, azimuth, response[order], shading="nearest", rasterized=True)
    axis.set(xlabel="half the path to microphone 1, m", ylabel="azimuth, degrees")


@_draw.register
def _(run: Run, axis: Axes) -> None:
    dataset = _set_of(run)
    predictions = predict_rows(run, dataset, held_out=True)
    truth = LearningProblem(dataset, target=run.metrics["target"]).labels()[predictions.rows]
    axis.plot([0, 1], [0, 1], "--", color="0.6", linewidth=1)
    belief, share, deviation = curve(truth, predictions.confidence)
    # A bar is two standard deviations of the share, if all were as claimed.
    axis.errorbar(belief, share, yerr=2 * deviation, fmt="o", label=run.metrics["name"])
    axis.set(xlabel="mean confidence", ylabel="share that is true", aspect="equal")
    axis.legend()


def _set_of(run: Run) -> Dataset:
    """Return the set that a run was trained on, which lies beside it."""
    for path in sorted((run.folder.parents[1] / "data").glob(f"*/{manifests.MANIFEST}")):
        if digest(manifests.load_manifest(path.parent)["files"]) == run.data_digest:
            return Dataset(path.parent)
    raise BadValue(f"run={run.identity}: must lie beside its set; generate that again")


def _floor_plan(axis: Axes) -> None:
    axis.set(xlabel="x, m", ylabel="y, m", aspect="equal")
