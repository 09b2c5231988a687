"""A filter for one robot, made from its own recordings, and the map that it leaves.

    survey --examine--> Health --reach--> plan for this robot --generate, train, export--> bundle
    robot.yaml -------------------------> plan for this robot, likewise
    bundle, survey --map--> map;    all of it --finish_fit--> runs/fit/<name>/fit.html

What is known of the robot comes from its survey: microphones, loudspeaker, burst, sample rate, how
far it hears and how long the place rings. Random rooms in the plan's ranges, as rough as measured
ones, do the rest. Each step is that of a command and keeps what is finished, so an interrupted fit
goes on where it was.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from echolearn.acoustics.arrays import mirror_azimuth
from echolearn.acoustics.geometry import SearchWindow
from echolearn.checks import BadValue, check, check_choice, check_name
from echolearn.classifiers.calibration import METHODS
from echolearn.classifiers.classifier import Classifier
from echolearn.classifiers.operating_point import read_aim
from echolearn.dataset.plans import ScatteredPlan
from echolearn.storage import manifests
from echolearn.storage.files import clean, write_atomic
from echolearn.storage.identity import plain
from echolearn.storage.once import locked
from echolearn.survey.examining import examine
from echolearn.survey.health import Health, mended
from echolearn.survey.proof import read_proved
from echolearn.survey.reach import UNHEARD, Reach, reach_of
from echolearn.survey.robot_file import read_robot
from echolearn.survey.survey import Survey
from echolearn.training.fit_page import PAGE, Fit, fit_page

RANGE_OF_T60 = (0.6, 1.5)
"""Factors of the reverberation time that was heard, between which rooms are drawn."""

TARGETS = ("reflector", "on_map", "time_and_direction")
"""Labels that can be learned."""

LONGEST_T60 = 2.0
"""s, longest reverberation time of a room that is drawn."""


@dataclass(frozen=True)
class FilterRecipe:
    """How a filter is made for a robot.

    Attributes:
        plan: rooms, levels and realism of the labelled set; robot, window and reverberation time
            are those of the survey.
        make: returns the classifier, unfitted.
        target: label to learn; None takes `on_map`, or `time_and_direction` where there is no map,
            or mirror images are on it.
        calibration, aim: as those of `train`.
        window: where echoes are sought; None takes the plan's.
    """

    plan: ScatteredPlan
    make: Callable[[], Classifier]
    target: str | None = None
    calibration: str = "platt"
    aim: str = "precision 0.9"
    window: SearchWindow | None = None

    def __post_init__(self) -> None:
        # A set takes minutes: what is wrong with what follows it is told before.
        if self.target is not None:
            check_choice("target", self.target, *TARGETS)
        check_choice("calibration", self.calibration, *METHODS)
        read_aim(self.aim)
        self.make()


@dataclass(frozen=True)
class Order:
    """A filter that is to be made for a robot.

    Attributes:
        folder: where the page goes, `runs/fit/<name>`.
        walk: the robot's recordings; without a pose where there are none yet.
        health: what they say about themselves, or None.
        plan: of the labelled set of this robot.
        target: label to learn.
        told: what was concluded, a line each.
    """

    folder: Path
    walk: Survey
    health: Health | None
    plan: ScatteredPlan
    target: str
    told: list[str]


def order_for(survey: Path, recipe: FilterRecipe, *, runs: Path, name: str | None = None) -> Order:
    """Return what a filter for the robot of a survey calls for, and print what was concluded.

    Args:
        survey: folder in the recorded-survey format.
        recipe: how filters are made.
        runs: folder of everything generated.
        name: name of the page's folder under `runs/fit`, and beginning of all others; that of the
            survey unless given.

    Raises:
        BadValue: a survey that cannot be trusted, or a robot that no set can be made for.
    """
    name = name or Path(survey).resolve().name
    folder = _free_folder(name, runs)
    walk, _ = read_proved(Path(survey))
    walk = replace(walk, window=recipe.window or recipe.plan.window)
    health = examine(walk)
    sound = mended(walk, health)
    reach = reach_of(sound)
    plan = plan_for(sound, reach, recipe=recipe, name=name)
    told = conclusions(sound, reach, plan=plan)
    for line in (*health.mended, *health.noticed, *told):
        print(line, flush=True)
    return Order(folder, walk, health, plan, _target(recipe, walk), told)


def order_before(
    robot: Path, recipe: FilterRecipe, *, runs: Path, name: str | None = None
) -> Order:
    """Return what a filter calls for whose robot has recorded nothing, and print what is known.

    Args:
        robot: file that describes it (`survey.robot_file`).
        recipe: how filters are made.
        runs: folder of everything generated.
        name: as that of `order_for`; the file's unless given.

    Raises:
        BadValue: a file that describes no robot, or a robot that no set can be made for.
    """
    name = name or Path(robot).stem
    folder = _free_folder(name, runs)
    walk = replace(read_robot(robot), window=recipe.window or recipe.plan.window)
    plan = plan_for(walk, UNHEARD, recipe=recipe, name=name)
    told = conclusions(walk, UNHEARD, plan=plan)
    for line in told:
        print(line, flush=True)
    return Order(folder, walk, None, plan, _target(recipe, walk), told)


def _target(recipe: FilterRecipe, walk: Survey) -> str:
    """Return the label that a filter learns."""
    # Of an echo that has a mirror image one point only is on the map, by chance.
    placed = walk.mapped and mirror_azimuth(walk.array) is None
    return recipe.target or ("on_map" if placed else "time_and_direction")


def finish_fit(
    order: Order,
    result: Mapping[str, Any],
    *,
    parts: Mapping[str, Path],
    command: str | None = None,
) -> Path:
    """Write the page of a filter and its map, and return it.

    Args:
        order: what was made.
        result: metrics of the trained run.
        parts: folders of the steps: set, run, bundle, and map if something was heard.
        command: what makes it again; None says nothing about it.
    """
    fit = Fit(order.folder, order.walk, order.health, order.told, result, parts)
    about = {"kind": "fit", "parts": {key: path.name for key, path in parts.items()}}
    _write(order.folder, fit_page(fit), about=about | manifests.command_entry(command))
    return order.folder / PAGE


def plan_for(walk: Survey, reach: Reach, *, recipe: FilterRecipe, name: str) -> ScatteredPlan:
    """Return the plan of a set that teaches what a robot hears.

    Args:
        walk: its recordings, mended.
        reach: what they tell of the place.
        recipe: what else the plan has.
        name: of the set.

    Raises:
        BadValue: a loudspeaker that moves on its own, which no plan carries.
    """
    carried = walk.loudspeakers is None
    hint = "a filter is made for a robot that carries its loudspeaker"
    place = f"{walk.folder}/poses.csv loudspeaker"
    check(carried, place, "moves on its own", allowed="must be carried", hint=hint)
    plan = recipe.plan
    window = recipe.window or plan.window
    low, high = plan.t60
    if np.isfinite(reach.t60):
        # No large room can be as dead as the smallest: the plan's least time is kept.
        low = round(min(max(low, RANGE_OF_T60[0] * reach.t60), LONGEST_T60 - 0.1), 2)
        high = round(min(max(low + 0.1, RANGE_OF_T60[1] * reach.t60), LONGEST_T60), 2)
    localizer: Any = replace(plan.localizer, window=window)  # type: ignore[type-var]
    try:
        return replace(plan, name=name, window=window, localizer=localizer, t60=(low, high))
    except BadValue as error:
        raise BadValue(f"{walk.folder}: no set can be made for this robot; {error}") from None


def conclusions(walk: Survey, reach: Reach, *, plan: ScatteredPlan) -> list[str]:
    """Return what was concluded of a robot and its place, a line each.

    Args:
        walk: its recordings.
        reach: what they tell of the place.
        plan: of the set that is made.
    """
    probe = walk.emitted
    burst = 1000 * len(probe.samples) / probe.sample_rate
    window = plan.window
    why = "noise hides" if len(walk) else "no recording yet tells"
    hears = f"{why} how far echoes are heard"
    if np.isfinite(reach.farthest):
        hears = f"echoes stand out of the noise up to those of walls {reach.farthest:.1f} m away"
    rings = f"{why} how long the place rings"
    if np.isfinite(reach.t60):
        rings = f"the place rings for {reach.t60:.2f} s (T60)"
    return [
        f"robot: {len(walk.array)} microphones, a burst of {burst:.0f} ms at "
        f"{probe.sample_rate:g} Hz",
        f"window: {_sought(walk, reach, window=window)}",
        f"reach: {hears}",
        f"decay: {rings}; rooms are drawn with {plan.t60[0]:g} to {plan.t60[1]:g} s",
        f"set: {plan.rows} simulated recordings of this robot in random rooms",
    ]


def _sought(walk: Survey, reach: Reach, *, window: SearchWindow) -> str:
    """Return how near and how far walls are sought, and what bounds it.

    Args:
        walk: its recordings, mended.
        reach: what they tell of the place.
        window: where echoes are sought.
    """
    text = f"walls are sought from {window.nearest:g} to {window.farthest:g} m (within=)"
    if walk.direct == "fir":
        text = f"{text}; nearer ones are taken off with the direct path"
    # Of a wall that noise hides nothing is found, however far the window goes.
    if reach.farthest < window.farthest:
        text = f"{text}; the farther ones are hidden by noise"
    return text


def _free_folder(name: str, runs: Path) -> Path:
    """Return the folder of a fit.

    Raises:
        BadValue: a path for a name, or something else than a fit is there.
    """
    check_name("name", name)
    folder = Path(runs) / "fit" / name
    names = {path.name for path in folder.glob("[!.]*")} if folder.is_dir() else set()
    foreign = (names and PAGE not in names) or (folder.exists() and not folder.is_dir())
    allowed = "must be a new name, or that of a fit"
    check(not foreign, "name", folder.name, allowed=allowed, hint=f"{folder} is something else")
    return folder


def _write(folder: Path, content: bytes, *, about: Mapping[str, Any]) -> None:
    """Write the page, in place of the one before, and then its manifest."""
    with locked(folder):
        clean(folder)
        write_atomic(folder / PAGE, content)
        manifests.finish(folder, plain(about), files=[PAGE])
