"""The commands: each builds what its configuration describes, and makes one call of the library.

    configuration --build--> arguments --one call--> where the result is

A command receives plain containers, as `compose.compose` returns them; its docstring is what
`echolearn --help` says. Libraries are imported inside, so that asking for help stays fast.
"""

import shlex
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echolearn.cli.fitting import fitted, recipe_of
from echolearn.cli.keys import (
    built,
    called,
    leave_out,
    named,
    needed,
    open_set,
    opened_set,
    path_of,
    recorded_survey,
    walk_cells,
    without_inputs,
)
from echolearn.cli.set_robot import robot_of_set
from echolearn.cli.tuning import tune_classifier

SHOWN = ("host=", "port=", "foxglove=", "mcap=", "dds=", "until=", "lines=")
"""Words of `live` that make no other map."""

if TYPE_CHECKING:
    from echolearn.cli.config import Config
    from echolearn.dataset.labelled_set import Dataset
    from echolearn.dataset.plans import Plan


def _generate(config: "Config") -> Path:
    """Make the labelled set of a plan; continues where it was interrupted."""
    from echolearn.dataset.generate import generate

    return generate(
        runs=Path(config["runs"]),
        **built(config, "plan engine"),
        command=leave_out(("engine", "workers="), config["command"]),
    )


def _train(config: "Config") -> Path:
    """Train a classifier on the set of a plan, calibrate, export and evaluate it."""
    from echolearn.cli.config import build
    from echolearn.storage.identity import by_short_names
    from echolearn.training.split import LearningProblem
    from echolearn.training.train import train
    from echolearn.training.variants import variant_text

    classifier = without_inputs(config["classifier"], config["without"])
    division = built(config, "target seed split test_share validation_share train_rows")
    dataset = open_set(config)
    problem = LearningProblem(dataset, **division)
    # Built only if it has to be trained, since its library takes seconds to load.
    make = partial(build, classifier, "classifier")
    about = by_short_names(classifier)
    variant = variant_text(config.get("varied", {}))
    if config["init"]:
        # It loads what runs models, which others do not need.
        from echolearn.training.adapting import begun, earlier_filter

        told = built(config, "force") | {"runs": Path(config["runs"])}
        earlier = earlier_filter(config["init"], problem, **told)
        make = partial(begun, make, earlier)
        about["init"] = earlier.told["sha256"]
        variant = "-".join(filter(None, (variant_text({"from": earlier.classifier}), variant)))
    logger = config.get("logger")
    array = dataset.array or build(config["scene"]["array"], "scene.array")
    result = train(
        problem,
        classifier=make,
        config=about,
        runs=Path(config["runs"]),
        microphones=array.positions,
        variant=variant,
        logger=partial(build, logger, "logger") if logger else None,
        **built(config, "name folds calibration aim without command"),
    )
    return Path(config["runs"]) / "train" / str(result["run"])


def _survey(config: "Config") -> Path:
    """Simulate a robot's walk through a room and store its recordings."""
    from echolearn.simulation.levels import NoiseLevels
    from echolearn.simulation.survey import survey

    return survey(
        levels=NoiseLevels(config["snr_db"], config["sdnr_db"], config["pings"]),
        runs=Path(config["runs"]),
        **built(config, "name room scene poses start seed noise_seconds realism command"),
    )


def _import(config: "Config") -> Path:
    """Import published measurements as a recorded survey, with their truth and licence."""
    from echolearn.survey.imported import import_survey

    return import_survey(
        runs=Path(config["runs"]),
        folder=path_of(config["folder"]),
        **built(config["scene"], "probe", prefix="scene."),
        **built(config, "name source protocol snr_db draw command"),
    )


def _compare(config: "Config") -> None:
    """Compare every trained run on every test set and survey: tables, tests, figures, report."""
    from echolearn.cli.names import chosen_runs
    from echolearn.comparison.compare import compare
    from echolearn.comparison.walks import compare_walks
    from echolearn.training.variants import Wanted

    runs, among = chosen_runs(config["runs"])
    about: Any = {"wanted": Wanted(among, config["select"]), "readme": path_of(config["readme"])}
    about |= built(config, "name resamples command")
    if config["walks"]:
        compare_walks(walk_cells(config, runs, plan_of=_plan_of), runs=runs, **about)
        return
    about |= built(config, "tested surveys bundles localizers workers")
    compare(runs=runs, plan_of=_plan_of, **about)


def _plan_of(dataset: "Dataset") -> "Plan | None":
    """Return the plan that a set was made by, composed anew; None of a set from elsewhere.

    A stranger's command is not composed: it could name code to be called.
    """
    from echolearn.checks import BadValue
    from echolearn.cli.compose import compose
    from echolearn.cli.config import UsageError, build
    from echolearn.dataset.generate import folder_of
    from echolearn.storage import known

    manifest = dataset.manifest
    if "command" not in manifest or not known.is_known(manifest["sha256"], known.MADE):
        return None
    with suppress(BadValue, UsageError):
        [(_, config)] = compose("generate", shlex.split(manifest["command"])[2:])
        plan: Plan = build(config["plan"], "plan")
        if folder_of(plan, Path()).name == dataset.folder.resolve().name:
            return plan
    return None


def _study(config: "Config") -> None:
    """Measure every localizer's accuracy against SNR, reverberation, rotor noise or faults."""
    from dataclasses import fields

    from echolearn.studies.page import check_page, publish
    from echolearn.studies.run import run_study
    from echolearn.studies.study import Study

    _check_bursts(config)
    page = path_of(config["page"])
    if page:
        # Before the work of an hour.
        check_page(page, config["name"])
    keys = " ".join(field.name for field in fields(Study))
    made = run_study(
        Study(**built(config, keys, prefix="study.")),
        runs=Path(config["runs"]),
        command=leave_out(("page=", "workers="), config["command"]),
        **built(config, "name workers resamples"),
    )
    if page:
        publish(made, page)


def _check_bursts(config: "Config") -> None:
    """Raise `BadValue` where a study would put bursts of noise in place of another probe."""
    from echolearn.checks import check

    kept = config["bursts"] == "one" or config["choice"].get("scene/probe", "noise") == "noise"
    hint = "each position would draw a burst of noise"
    allowed = "must be one, that of scene/probe"
    check(kept, "bursts", config["bursts"], allowed=allowed, hint=hint)


def _bench(config: "Config") -> Path:
    """Time every stage beside its peers; write tables and figures."""
    from echolearn.bench.run import bench

    return bench(
        localizers=localizers(config["choice"]["plan"]),
        runs=Path(config["runs"]),
        page=path_of(config["page"]),
        scaling=path_of(config["scaling"]),
        **built(config, "plan growing realistic stages workers repetitions long_repetitions"),
        **built(config, "seconds batch positions rows t60 peer_t60 microphones azimuths command"),
    )


def _export(config: "Config") -> Path:
    """Make a trained run a bundle: a folder that a robot loads with numpy and onnxruntime alone."""
    from echolearn.storage.named import folder_named
    from echolearn.training.export import export

    runs = Path(config["runs"])
    walks = named(config, "reference", place="data")
    evidence = [str(folder_named(each, "compare", runs=runs)) for each in config["evidence"]]
    return export(
        run=named(config, "run", place="train"),
        best=named(config, "best", place="compare"),
        card=path_of(config["card"]),
        reference=opened_set(walks.resolve()) if walks else None,
        runs=runs,
        evidence=evidence,
        command=leave_out(("card=", "evidence="), config["command"]),
        **(robot_of_set(config) | built(config, "name aim resamples")),
    )


def _map(config: "Config") -> Path:
    """Map a recorded survey with a bundle: points, walls, an occupancy grid, a drawing."""
    from echolearn.robot.shipped import ALLOWED, find_bundle
    from echolearn.robot.survey_map import map_survey

    return map_survey(
        survey=recorded_survey(config),
        bundle=find_bundle(needed(config, "bundle", allowed=ALLOWED), Path(config["runs"])),
        runs=Path(config["runs"]),
        **built(config, "name resolution resample direct played ros"),
        **built(config, "without gains localizer command"),
    )


def _live(config: "Config") -> Path:
    """Map a survey while it is recorded, show the map as it grows, and write it when that ends."""
    from echolearn.robot.live.following import live_survey
    from echolearn.robot.live.viewers import Viewing
    from echolearn.robot.shipped import ALLOWED, find_bundle

    return live_survey(
        survey=recorded_survey(config),
        bundle=find_bundle(needed(config, "bundle", allowed=ALLOWED), Path(config["runs"])),
        runs=Path(config["runs"]),
        viewing=Viewing(**built(config, "host port foxglove mcap dds")),
        # What is written is what `map` writes, so that is what makes it again.
        command=leave_out(SHOWN, config["command"]).replace("echolearn live", "echolearn map", 1),
        **built(config, "name until lines resolution resample direct played"),
        **built(config, "without gains localizer"),
    )


def _check(config: "Config") -> Path:
    """Examine a recorded survey before anything is trusted: a screen of text and a page."""
    from echolearn.robot.check import check_survey
    from echolearn.robot.shipped import find_bundle

    return check_survey(
        survey=recorded_survey(config),
        bundle=find_bundle(config["bundle"], Path(config["runs"])) if config["bundle"] else None,
        runs=Path(config["runs"]),
        **built(config, "name resample direct played without gains command"),
    )


def _label(config: "Config") -> Path:
    """Make the labelled set of a recorded survey whose walls or true echoes are known."""
    from echolearn.checks import check_list
    from echolearn.comparison.recorded_set import label_survey

    check_list("beside", config["beside"])
    return label_survey(
        recorded_survey(config),
        beside=[called(each, "survey", config=config, key="beside") for each in config["beside"]],
        runs=Path(config["runs"]),
        **built(config, "localizer name role height further command"),
    )


def _fit(config: "Config") -> Path:
    """Make a filter for a robot from its recordings, and their map; or before it has recorded."""
    from echolearn.checks import check
    from echolearn.survey.reader import read_survey
    from echolearn.survey.robot_file import read_robot
    from echolearn.training.own_robot import order_before, order_for

    about: Any = {"runs": Path(config["runs"]), "name": config["name"]}
    robot = path_of(config["robot"])
    # What is wrong with robot or survey is said of it, not of the scene that is taken from it.
    if robot is not None:
        alone = config["survey"] is None
        hint = "a survey describes its robot itself"
        check(alone, "robot", robot, allowed="must be null where survey= is given", hint=hint)
        read_robot(robot)
        order = order_before(robot, recipe_of(config), **about)
    else:
        survey = recorded_survey(config, hint="robot=<robot.yaml> before there is a recording")
        read_survey(survey)
        order = order_for(survey, recipe_of(config), **about)
    return fitted(order, config)


COMMANDS: dict[str, Callable[["Config"], Path | None]] = {
    "generate": _generate,
    "train": _train,
    "tune": tune_classifier,
    "survey": _survey,
    "import": _import,
    "compare": _compare,
    "study": _study,
    "bench": _bench,
    "export": _export,
    "check": _check,
    "map": _map,
    "live": _live,
    "fit": _fit,
    "label": _label,
}


def verify_folder(name: str) -> str:
    """Check every byte of finished folders; of a bundle, also what its model computes."""
    from echolearn.checks import check, printable
    from echolearn.storage import manifests

    allowed = "must be a folder that echolearn made"
    check(name != "", "folder", "", allowed=allowed, hint="is a variable of the shell empty?")
    place = Path(name)
    if (place / manifests.BUNDLE).is_file():
        from echolearn.robot import scorer

        return printable(f"{name}: {scorer.verify_bundle(place)}")
    if (place / "survey.yaml").exists():
        from echolearn.survey import proof

        return printable(f"{name}: {proof.verify_survey(place)}")
    manifest = manifests.verify(place)
    manifests.check_own_name(place, manifest)
    return printable(f"{name}: whole, {len(manifest['files'])} files")


def localizers(plan: str) -> dict[str, Any]:
    """Return every localizer that has a file, by its name, with the search window of a plan."""
    from echolearn.cli.compose import compose
    from echolearn.cli.config import build
    from echolearn.cli.own import options_of

    names = options_of("localizer")
    jobs = compose("generate", [f"plan={plan}", f"localizer={','.join(names)}"], many=True)
    return {job["choice"]["localizer"]: build(job["localizer"], "localizer") for _, job in jobs}
