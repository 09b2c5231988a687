"""What the command `fit` calls: how the filter is made, and the steps, each that of a command."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echolearn.cli.keys import built, leave_out, opened_set

if TYPE_CHECKING:
    from echolearn.cli.config import Config
    from echolearn.dataset.plans import ScatteredPlan
    from echolearn.training.own_robot import FilterRecipe, Order


def recipe_of(config: "Config") -> "FilterRecipe":
    """Return how the filter is made that a configuration describes."""
    from echolearn.cli.config import build
    from echolearn.training.own_robot import FilterRecipe

    plan = build(config["plan"], "plan")
    return FilterRecipe(
        plan,
        partial(build, config["classifier"], "classifier"),
        window=_window(config["within"], plan),
        **built(config, "target calibration aim"),
    )


def _window(within: list[float] | None, plan: "ScatteredPlan") -> Any:
    """Return the search window for walls within two distances in m; None leaves the plan's."""
    from dataclasses import replace

    from echolearn.checks import check, check_range

    if within is None:
        return None
    check_range("within", within, bounds=(0.1, 100.0, "m"))
    nearest, farthest = within
    allowed = "must be two distances in m, [1.0,2.0]"
    check(nearest < farthest, "within", within, allowed=allowed)
    return replace(plan.window, nearest=nearest, farthest=farthest)


def fitted(order: "Order", config: "Config") -> Path:
    """Make the filter that was ordered step by step, and its page; what is finished is kept."""
    from echolearn.cli.config import build
    from echolearn.dataset.generate import generate
    from echolearn.dataset.labelled_set import Dataset
    from echolearn.robot.survey_map import map_survey
    from echolearn.storage.identity import by_short_names, digest
    from echolearn.training.export import export
    from echolearn.training.own_robot import finish_fit
    from echolearn.training.split import LearningProblem
    from echolearn.training.train import train
    from echolearn.training.walks import walks_plan

    runs = Path(config["runs"])
    again: Any = {
        "runs": runs,
        "command": leave_out(("engine", "workers="), config["command"]),
    }
    scene = order.plan.scene
    engine = built(config, "engine")
    place = generate(order.plan, **engine, **again)
    walks = config["walks"]
    reference = None
    if walks:
        reference = Dataset(generate(walks_plan(order.plan, walks), **engine, **again))
    result = train(
        LearningProblem(opened_set(place.resolve()), target=order.target, seed=config["seed"]),
        name=config["choice"]["classifier"],
        classifier=partial(build, config["classifier"], "classifier"),
        config=by_short_names(config["classifier"]),
        microphones=scene.array.positions,
        **built(config, "calibration aim"),
        **again,
    )
    # Another filter for the same survey has another bundle: robots may still carry this one.
    name = f"{order.folder.name}-{digest([str(result['run'])])}"
    run = runs / "train" / str(result["run"])
    about: Any = {"run": run, "best": None, "array": scene.array, "probe": scene.probe}
    bundle = export(**about, name=name, reference=reference, **again)
    parts = {"set": place, "run": run, "bundle": bundle}
    if len(order.walk):
        mapped = map_survey(survey=order.walk.folder, bundle=bundle, name=name, **again)
        parts["map"] = mapped
    return finish_fit(order, result, parts=parts, command=again["command"])
