"""The commands, each on a few lines: what it builds from its configuration, which function it
calls, what it returns.

A command receives plain containers, as `config.compose` gives them, and returns where the result
is. Libraries are imported inside, so that asking for help stays fast.
"""

import shlex
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from echolearn.storage.identity import by_short_names

if TYPE_CHECKING:
    from echolearn.dataset.labelled_set import Dataset

Config = dict[str, Any]


def generate(config: Config) -> Path:
    """Make the labelled set of a plan; continues where it was interrupted."""
    from echolearn.cli.config import build
    from echolearn.dataset.generate import generate

    plan, engine = build(config["plan"], "plan"), build(config["engine"], "engine")
    words = [
        word
        for word in shlex.split(config["command"])
        if not word.startswith(("engine", "workers="))
    ]
    return generate(plan, runs=Path(config["runs"]), engine=engine, command=shlex.join(words))


def train(config: Config) -> Path:
    """Train a classifier on the set of a plan, calibrate, export and judge it."""
    from echolearn.checks import check
    from echolearn.cli.config import build
    from echolearn.dataset.generate import folder_of
    from echolearn.training.split import Task
    from echolearn.training.train import train as fit

    runs, about = Path(config["runs"]), config["classifier"]
    folder = folder_of(build(config["plan"], "plan"), runs)
    hint = f"run: echolearn generate plan={config['choice']['plan']}"
    check(
        folder.is_dir(),
        "plan",
        folder.name,
        allowed=f"a set that exists under {folder.parent}",
        hint=hint,
    )
    dataset = open_set(folder.resolve())
    task = Task(
        dataset,
        **{
            key: config[key]
            for key in ("target", "seed", "split", "test_share", "validation_share")
        },
    )
    result = fit(
        task,
        name=config["name"],
        classifier=lambda: build(about, "classifier"),
        config=by_short_names(about),
        runs=runs,
        folds=config["folds"],
        command=config["command"],
    )
    return runs / "train" / str(result["run"])


@cache
def open_set(folder: Path) -> "Dataset":
    """Open a set, once for all the jobs of a multirun."""
    from echolearn.dataset.labelled_set import Dataset

    return Dataset(folder)


def survey(config: Config) -> Path:
    """Simulate a robot's walk through a room and store its recordings."""
    from echolearn.cli.config import build
    from echolearn.simulation.levels import NoiseLevels
    from echolearn.simulation.survey import survey as walk

    about = build(without(config, "choice rir noise diffuse runs snr_db sdnr_db pings"))
    levels = NoiseLevels(config["snr_db"], config["sdnr_db"], config["pings"])
    return walk(**about, levels=levels, runs=Path(config["runs"]))


def compare(config: Config) -> None:
    """Compare every trained run on every test set and survey: tables, tests, figures, report."""
    from echolearn.cli.config import build
    from echolearn.comparison.compare import compare as judge

    readme = Path(config["readme"]) if config["readme"] else None
    judge(
        **build(without(config, "choice window runs readme")),
        runs=Path(config["runs"]),
        readme=readme,
    )


def study(config: Config) -> None:
    """Measure every localizer's accuracy against SNR, reverberation, rotor noise or faults."""
    from echolearn.cli.config import build
    from echolearn.studies.page import check_page, publish
    from echolearn.studies.run import run_study
    from echolearn.studies.study import Study

    page, outside = Path(config["page"] or ""), ("name", "runs", "workers", "resamples", "command")
    if config["page"]:
        check_page(page, config["name"])
    about = build(without(config, "choice rir noise diffuse page " + " ".join(outside)), "study")
    words = [
        word
        for word in shlex.split(config["command"])
        if not word.startswith(("page=", "workers="))
    ]
    given = {key: config[key] for key in outside} | {
        "runs": Path(config["runs"]),
        "command": shlex.join(words),
    }
    folder = run_study(Study(**about), **given)
    if config["page"]:
        publish(folder, page)


def bench(config: Config) -> Path:
    """Time every stage beside its peers; write tables and figures."""
    from echolearn.bench.run import bench as measure
    from echolearn.cli.config import build

    given = build(without(config, "choice scene rir noise localizer window runs page scaling"))
    pages = {key: Path(config[key]) if config[key] else None for key in ("page", "scaling")}
    return measure(
        **given | pages, localizers=localizers(config["choice"]["plan"]), runs=Path(config["runs"])
    )


def localizers(plan: str) -> dict[str, Any]:
    """Return every localizer that has a file, by its name, with the search window of a plan."""
    from echolearn.cli.compose import compose
    from echolearn.cli.config import build, folder

    names = ",".join(sorted(path.stem for path in (folder() / "localizer").glob("*.yaml")))
    jobs = compose("generate", [f"plan={plan}", f"localizer={names}"], many=True)
    return {job["choice"]["localizer"]: build(job["localizer"], "localizer") for _, job in jobs}


def export(config: Config) -> Path:
    """Make a trained run a bundle: a folder that a robot loads with numpy and onnxruntime alone."""
    from echolearn.cli.config import build
    from echolearn.training.export import export as pack

    run, best = (Path(config[key]) if config[key] else None for key in ("run", "best"))
    carried = {key: build(config["scene"][key], f"scene.{key}") for key in ("array", "probe")}
    rest = {key: config[key] for key in ("name", "resamples", "command")}
    return pack(run=run, best=best, runs=Path(config["runs"]), **carried, **rest)


def draw(config: Config) -> Path:
    """Map a recorded survey with a bundle: points, walls, an occupancy grid, a drawing."""
    from echolearn.checks import check
    from echolearn.robot.survey_map import draw as chart

    for key, hint in (
        ("survey", "a folder in the recorded-survey format"),
        ("bundle", "a folder of echolearn export"),
    ):
        check(
            bool(config[key]),
            key,
            config[key],
            allowed=hint,
            hint=f"name it: echolearn map {key}=<folder>",
        )
    survey, bundle, runs = (Path(config[key]) for key in ("survey", "bundle", "runs"))
    rest = {
        key: config[key] for key in ("name", "resolution", "resample", "direct", "ros", "command")
    }
    return chart(survey=survey, bundle=bundle, runs=runs, **rest)


def verify(folder: str) -> str:
    """Re-prove finished folders: every file's size and checksum; of a bundle, also what its model
    computes.
    """
    from echolearn.checks import check
    from echolearn.storage import manifests

    check(
        folder != "",
        "folder",
        "",
        allowed="must be a folder that echolearn made",
        hint="is a variable of the shell empty?",
    )
    place = Path(folder)
    if (place / manifests.BUNDLE).is_file():
        from echolearn.robot.scorer import prove

        return f"{folder}: {prove(place)}"
    if (place / "survey.yaml").exists():
        from echolearn.survey.proof import prove as hear

        return f"{folder}: {hear(place)}"
    return f"{folder}: whole, {len(manifests.verify(place)['files'])} files"


COMMANDS: dict[str, Callable[[Config], Path | None]] = {
    "generate": generate,
    "train": train,
    "survey": survey,
    "compare": compare,
    "study": study,
    "bench": bench,
    "export": export,
    "map": draw,
}
