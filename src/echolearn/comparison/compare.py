"""Compare every trained run on every test set and survey: tables, tests, figures, one page.

    load -> evaluate each set and survey in processes -> correct -> tables -> report

The comparison is identified by what goes into it (runs, sets, surveys, settings); a finished one is
not redone.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

from echolearn.checks import BadValue, check, check_list, check_name, check_whole
from echolearn.comparison import importance, ranking, report, robustness, shifts, warnings, worst
from echolearn.comparison.choice import Comparison, chosen_run, headline
from echolearn.comparison.evaluate import Inputs, evaluate
from echolearn.comparison.examined import Examined
from echolearn.comparison.finding import find_set, find_survey, survey_digest
from echolearn.comparison.fitting import robot_in
from echolearn.comparison.importance import importance_rows
from echolearn.comparison.ranking import rank_models, rank_rows
from echolearn.comparison.recorded import is_examined
from echolearn.comparison.shifts import shift_rows
from echolearn.comparison.shown import Shown
from echolearn.comparison.warnings import all_warnings, tell
from echolearn.comparison.worst import PlanOf, worst_errors
from echolearn.dataset.labelled_set import FORMAT, Dataset
from echolearn.evaluation.rows import BUNDLE, to_csv
from echolearn.localization.localizer import Localizer
from echolearn.storage.advice import command_line
from echolearn.storage.files import clean, write_atomic
from echolearn.storage.identity import digest, plain
from echolearn.storage.manifests import (
    MANIFEST,
    Contents,
    command_entry,
    finish,
    listed_bytes,
    load_manifest,
    verify,
)
from echolearn.storage.marked_page import around
from echolearn.storage.once import once
from echolearn.training.variants import EVERY, Wanted, find_runs, selection_lines

ABOUT = " role method split target kind set_role room localizer train_rows without"
"""Columns of both tables that tell what a row is about, so that no name need be taken apart."""

COLUMNS = "classifier trained_on tested_on seed snr_db noise metric value ci_low ci_high n" + ABOUT
TEST_COLUMNS = (
    "classifier against trained_on tested_on snr_db metric difference ci_low ci_high p p_holm n"
) + f"{ABOUT} test"


def compare(
    *,
    name: str,
    tested: Sequence[str],
    surveys: Sequence[str],
    localizers: Mapping[str, Localizer],
    runs: Path,
    bundles: Sequence[str] = (),
    wanted: Wanted = EVERY,
    resamples: int = 1000,
    workers: int = 1,
    readme: Path | None = None,
    plan_of: PlanOf = lambda dataset: None,
    command: str | None = None,
) -> Path:
    """Evaluate all trained runs and return the comparison's folder; a finished one is only shown.

    Args:
        name: name of the folder under `runs/compare`.
        tested: names of labelled sets.
        surveys: names of surveys.
        localizers: localizers by name, by each of which surveys are localized.
        runs: folder of everything generated.
        bundles: names or folders of bundles, which are compared beside the runs.
        wanted: which of the trained runs.
        resamples, workers: bootstrap draws behind intervals; processes.
        readme: a file whose results table, between markers, is replaced.
        plan_of: the plan that a set was made by, if known, to draw errors from.
        command: what makes the comparison again, for its manifest; None says nothing about it.

    Raises:
        BadValue: a set, survey or bundle that is missing or damaged, no runs, no markers.
    """
    lists = {"tested": tested, "surveys": surveys, "bundles": bundles}
    _check(name, lists, readme=readme, resamples=resamples, workers=workers)
    inputs = load_inputs(Path(runs), **lists, localizers=localizers, wanted=wanted)
    known = identity(inputs) | {"resamples": resamples, "report": report.FORMAT}
    folder = Path(runs) / "compare" / name

    def make() -> Contents:
        """Evaluate everything, write the comparison, and return what of it is shown."""
        comparison = evaluate(inputs, resamples=resamples, workers=workers)
        examined = look_closer(comparison, inputs, plan_of=plan_of, resamples=resamples)
        about = {"kind": "comparison", "inputs": known, **command_entry(command)}
        return _write(folder, comparison, examined=examined, about=about)

    # Shown is what this command has made or found: another one may write into the folder by now.
    found = once(folder, finished=partial(_finished, folder, known), make=make, doing="makes it")
    report.show(found, folder=folder, readme=readme)
    return folder


def _check(
    name: str,
    lists: Mapping[str, Sequence[str]],
    *,
    readme: Path | None,
    resamples: int,
    workers: int,
) -> None:
    check_name("name", name)
    for key, names in lists.items():
        check_list(key, names)
        known = [str(each) for each in names]
        check(
            len(set(known)) == len(known),
            key,
            ", ".join(known),
            allowed="must hold each name only once",
        )
    some = len(lists["tested"]) > 0
    check(some, "tested", "[]", allowed="must name at least one labelled set")
    check_whole("resamples", resamples, low=20, high=100_000)
    check_whole("workers", workers, low=1, high=1024)
    if readme is not None:
        around(readme, report.RESULTS)


def load_inputs(
    runs: Path,
    *,
    tested: Sequence[str],
    surveys: Sequence[str],
    localizers: Mapping[str, Localizer],
    bundles: Sequence[str] = (),
    wanted: Wanted = EVERY,
) -> Inputs:
    """Return the finished runs and the bundles, by model, and what is asked for.

    Args:
        runs, tested, surveys, localizers, bundles, wanted: as those of `compare`.

    Raises:
        BadValue: something is missing or damaged.
    """
    # What opens models takes a while to load, and who only looks at results needs none.
    from echolearn.comparison import bundled
    from echolearn.robot.examination import examine_run

    models = defaultdict(list)
    finished, selected = find_runs(runs, wanted)
    for run in finished:
        # Before any work, and once for all processes.
        examine_run(run.folder, run.metrics["sha256"])
        models[run.model].append(run)
    hint = f"run first: {command_line('train', runs=runs)}"
    check(len(models) > 0, "runs", runs, allowed="must be a folder with trained runs", hint=hint)
    enough = len(localizers) > 0 or not surveys
    check(enough, "localizers", "{}", allowed="must hold at least one, to localize the surveys")
    known = _known_sets(runs)
    plans = [each["plan"] for each in known.values()]
    current = {folder: each for folder, each in known.items() if each.get("format") == FORMAT}
    trained = {digest(each["files"]): folder for folder, each in current.items()}
    robots = {key: robot_in(current[folder]["plan"]["scene"]) for key, folder in trained.items()}
    found = bundled.opened_bundle(bundles, runs, finished=finished)
    return Inputs(
        models | {run.model: [run] for run, _ in found},
        {plan["name"]: plan["role"] for plan in plans if "role" in plan},
        _named_sets([find_set(runs, key) for key in tested]),
        _named_surveys(runs, surveys),
        localizers,
        {run.data_digest: robot for run, robot in found} | robots,
        trained,
        selected,
    )


def _named_sets(folders: Sequence[Path]) -> dict[str, Dataset]:
    """Return sets by the name of their plan, or of their folder where two share one."""
    # Whether a set was named by its plan or by its folder, it is there once.
    opened = [Dataset(place) for place in dict.fromkeys(each.resolve() for each in folders)]
    names = [each.name for each in opened]
    return {each.name if names.count(each.name) == 1 else each.folder.name: each for each in opened}


def _named_surveys(runs: Path, surveys: Sequence[str]) -> dict[str, Path]:
    """Return folders of surveys as they are called, those under `runs` by their names."""
    found = {key: find_survey(runs, key) for key in surveys}
    usual = (runs / "survey").resolve()
    return {
        place.name if place.resolve().parent == usual else key: place
        for key, place in found.items()
    }


def _known_sets(runs: Path) -> dict[Path, dict[str, Any]]:
    """Return the manifests of all sets that tell their plan, by folder."""
    # A training set's role is wanted also where the set itself is not among those tested; sets of
    # another version, which have none, may stand beside them.
    folders = [path.parent for path in runs.glob(f"data/*/{MANIFEST}")]
    there = {folder: load_manifest(folder) for folder in folders}
    return {folder: each for folder, each in there.items() if _tells_plan(each)}


def _tells_plan(manifest: Mapping[str, Any]) -> bool:
    """Tell whether a manifest, which a stranger may have written, names a plan and its scene."""
    plan = manifest.get("plan")
    kinds = {"name": str, "scene": dict}
    return isinstance(plan, dict) and all(isinstance(plan.get(k), v) for k, v in kinds.items())


def identity(inputs: Inputs) -> dict[str, Any]:
    """Return what tells inputs from all others, as plain containers; every survey is proved."""
    every = [run for each in inputs.models.values() for run in each]
    bundles = {
        run.metrics["name"]: run.metrics["model"]["sha256"]
        for run in every
        if run.model.role == BUNDLE
    }
    runs = [run for run in every if run.model.role != BUNDLE]
    # Recorded walks are examined first; comparisons of before took them as they are, and had no
    # bundles.
    examined = any(map(is_examined, inputs.surveys.values()))
    later = ({"bundles": bundles} if bundles else {}) | ({"examined": True} if examined else {})
    if inputs.selected:
        later["selected"] = {model.classifier: n for model, n in inputs.selected.items()}
    return later | {
        "runs": {run.identity: run.metrics["model"]["sha256"] for run in runs},
        "sets": {key: dataset.digest for key, dataset in inputs.sets.items()},
        "surveys": {key: survey_digest(place) for key, place in inputs.surveys.items()},
        "localizers": plain(dict(inputs.localizers)),
    }


def _finished(folder: Path, inputs: Mapping[str, Any]) -> Contents | None:
    """Return what is shown of a comparison if it is whole and made from these inputs."""
    with suppress(BadValue):
        manifest = verify(folder)
        if manifest.get("inputs") == inputs:
            return listed_bytes(folder, manifest, names=report.SHOWN)
    return None


def _write(
    folder: Path, comparison: Comparison, *, examined: Examined, about: Mapping[str, Any]
) -> Contents:
    """Write a comparison's files, and return those that are shown.

    Args:
        folder: of the comparison.
        comparison: what was found.
        examined: what is known of it besides.
        about: entries of its manifest.
    """
    tell(examined.warnings)
    # What an interrupted command or another comparison of this name has left goes first.
    clean(folder)
    clean(folder / "figures")
    files = {
        "results.csv": to_csv(comparison.rows, COLUMNS.split()),
        "tests.csv": to_csv(comparison.tests, TEST_COLUMNS.split()),
    }
    if comparison.repeated:
        files["robustness.csv"] = to_csv(comparison.repeated, robustness.COLUMNS.split())
    files |= examined_files(examined, comparison)
    files |= page_files(comparison, name=folder.name, examined=examined)
    for file, content in files.items():
        write_atomic(folder / file, content)
    finish(folder, {**about, "chosen": chosen_run(comparison).identity}, files=files)
    return {name: files[name] for name in report.SHOWN if name in files}


def page_files(comparison: Comparison, *, name: str, examined: Examined) -> dict[str, bytes]:
    """Return the report, its figures and its table by name.

    Args:
        comparison: what was found.
        name: of the comparison.
        examined: what is known of it besides.
    """
    from echolearn.comparison.answer import answers
    from echolearn.comparison.drawings import draw_all
    from echolearn.comparison.examined_figures import draw_examined
    from echolearn.comparison.map_pairs import map_pairs

    shown = Shown(answers(comparison), map_pairs(comparison))
    drawings = draw_all(comparison, shown.pairs) | draw_examined(examined, comparison)
    return report.make(comparison, shown=shown, drawings=drawings, name=name, examined=examined)


def look_closer(
    comparison: Comparison, inputs: Inputs, *, plan_of: PlanOf, resamples: int
) -> Examined:
    """Look at a comparison more closely.

    Args:
        comparison: what was found.
        inputs: what it was found of.
        plan_of: the plan that a set was made by.
        resamples: bootstrap draws behind intervals.
    """
    moved = list(shift_rows(comparison, inputs.trained))
    return Examined(
        rank_models(comparison),
        importance=list(importance_rows(comparison, resamples=resamples)),
        shifts=moved,
        worst=worst_errors(comparison, plan_of),
        warnings=all_warnings(
            comparison, trained=inputs.trained, surveys=inputs.surveys, shifts=moved
        ),
        selected=selection_lines(inputs.selected),
    )


def examined_files(examined: Examined, comparison: Comparison) -> dict[str, bytes]:
    """Return the CSV files of what was found, by name."""
    ranked = examined.ranking
    rows = rank_rows(ranked, headline(comparison)) if ranked else []
    warned = [each._asdict() for each in examined.warnings]
    return {
        "ranks.csv": to_csv(rows, ranking.COLUMNS),
        "importance.csv": to_csv(examined.importance, importance.COLUMNS),
        "shifts.csv": to_csv(examined.shifts, shifts.COLUMNS),
        "worst.csv": to_csv(examined.worst.rows, worst.COLUMNS),
        "warnings.csv": to_csv(warned, warnings.COLUMNS),
    }
