"""Evaluate all models on all sets and surveys, shared out among processes."""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, product
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from echolearn.comparison.choice import Comparison, closely
from echolearn.comparison.fitting import (
    Robot,
    check_some_fit,
    fitting_set,
    robot_at,
    split_fitting,
    unfit_rows,
)
from echolearn.comparison.localized import localize_survey
from echolearn.comparison.measured import Unheard, grouped, is_mapped, measured_rows
from echolearn.comparison.pooled import (
    Share,
    pooled_rows,
    pooled_tests,
    set_shares,
    walk_shares,
)
from echolearn.comparison.recorded import healths_of
from echolearn.comparison.rivals import against_baseline, fold_tests, further_tests
from echolearn.comparison.robustness import changes, under_conditions
from echolearn.comparison.tables import SHOWN_DB
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation import pairs, scoring
from echolearn.evaluation.calibration_rows import score_calibration
from echolearn.evaluation.rows import (
    OTHER_LOCALIZER,
    PAPER,
    LocalizedSurvey,
    MeasuredRows,
    Model,
    Predictions,
    Recordings,
    Row,
)
from echolearn.localization.localizer import Localizer
from echolearn.runtime.processes import processes
from echolearn.runtime.progress import track
from echolearn.survey.health import Health
from echolearn.training.predictions import (
    label_rows,
    predict_echoes,
    predict_measured,
    predict_rows,
)
from echolearn.training.runs import Run

Models = Mapping[Model, Sequence[Run]]
"""Finished runs of each model, one for each seed."""


@dataclass(frozen=True)
class Inputs:
    """Who is evaluated, and on what.

    Attributes:
        models: finished runs of each model, one for each seed.
        roles: what each training set was made for, by its plan's name.
        sets: labelled sets by name.
        surveys: folders of surveys by name.
        localizers: localizers by name; the points of the first one are tested in pairs.
        robots: robots of training sets, by the sets' digests.
        trained: folders of these sets, likewise.
        selected: of how many settings a model that was selected is the best.
    """

    models: Models
    roles: Mapping[str, str]
    sets: Mapping[str, Dataset]
    surveys: Mapping[str, Path]
    localizers: Mapping[str, Localizer]
    robots: Mapping[str, Robot] = field(default_factory=dict)
    trained: Mapping[str, Path] = field(default_factory=dict)
    selected: Mapping[Model, int] = field(default_factory=dict)


class Evaluation(NamedTuple):
    """What was found on a set or surveys: rows of both tables, the survey, what is pooled."""

    rows: list[Row]
    tests: list[Row]
    survey: LocalizedSurvey | None = None
    measured: MeasuredRows | None = None
    shares: Sequence[Share] = ()


def evaluate(inputs: Inputs, *, resamples: int, workers: int) -> Comparison:
    """Evaluate every model on every set and on every survey by each localizer.

    Args:
        inputs: models, sets, surveys, localizers.
        resamples: bootstrap draws behind every interval.
        workers: processes; the result does not depend on their number.
    """
    repeated = under_conditions(inputs.sets)
    rows: list[Row] = []
    tests: list[Row] = []
    shares: list[Share] = []
    surveys = {}
    measured = {}
    for found in evaluations(inputs, resamples=resamples, workers=workers):
        rows += found.rows
        tests += found.tests
        # Another condition at the same positions is no further room.
        if not found.rows or found.rows[0]["tested_on"] not in repeated:
            shares += found.shares
        if found.survey:
            source = found.survey.labelled.source
            surveys[source.tested_on, source.localizer] = found.survey
        if found.measured:
            source = found.measured.labelled.source
            measured[source.tested_on, source.localizer] = found.measured
    check_some_fit(rows)
    rows += pooled_rows(shares)
    # All tests of a family are corrected together, so only when all of them are known.
    models = inputs.models
    corrected = pairs.correct([*tests, *pooled_tests(shares), *fold_tests(models)])
    changed = evaluate_conditions(inputs, resamples=resamples)
    return Comparison(
        models, inputs.roles, inputs.sets, surveys, rows, corrected, measured, changed
    )


def evaluations(inputs: Inputs, *, resamples: int, workers: int) -> list[Evaluation]:
    """Return what is found on every set and on every survey by each localizer, in their order.

    Args:
        inputs: models, sets, surveys, localizers.
        resamples: bootstrap draws behind every interval.
        workers: processes.
    """
    models = inputs.models
    best = closely(models, inputs.roles)
    jobs = []
    mapped = [folder for folder in inputs.surveys.values() if is_mapped(folder)]
    with processes(workers) as pool:
        # Whatever is refused is so before any work, once for all localizers.
        healths = healths_of(inputs.surveys.values(), pool)
        shared: Any = {"robots": inputs.robots, "resamples": resamples}
        for dataset in inputs.sets.values():
            jobs.append(pool.submit(evaluate_set, models, dataset.folder, best=best, **shared))
        about = shared | {"localizers": inputs.localizers, "healths": healths}
        for folder, name in product(mapped, inputs.localizers):
            given = about | {"name": name, "best": best}
            jobs.append(pool.submit(evaluate_survey, models, folder, **given))
        for (group, folders), name in product(grouped(inputs.surveys).items(), inputs.localizers):
            given = about | {"name": name}
            jobs.append(pool.submit(evaluate_measured, models, group, folders=folders, **given))
        waiting = track(jobs, "evaluate", unit="sets and surveys")
        return [job.result() for job in waiting]


def evaluate_set(
    models: Models,
    folder: Path,
    *,
    robots: Mapping[str, Robot],
    resamples: int,
    best: Mapping[str, Model] = MappingProxyType({}),
) -> Evaluation:
    """Evaluate models on a labelled set.

    On a set that any of them was trained on, all are evaluated on held-out rows, and not tested in
    pairs.

    Args:
        models: finished runs of each model.
        folder: folder of the set.
        robots: robots of training sets, by the sets' digests.
        resamples: bootstrap draws.
        best: best learned model of each training that is looked at closely.
    """
    dataset = Dataset(folder)
    labelled = label_rows(dataset, resamples=resamples)
    models, unfit = fitting_set(models, dataset, robots=robots)
    runs = chain.from_iterable(models.values())
    known = dataset.digest in {run.data_digest for run in runs}
    predictions = predicted(models, lambda run: predict_rows(run, dataset, held_out=known))
    # Of the references chance alone has something to say about labels.
    references = scoring.trivial_predictions(labelled.reference)
    rows: list[Row] = []
    for model, given in (predictions | {Model("chance"): [references["chance"]]}).items():
        rows.extend(scoring.score_labels(model, given, labelled=labelled))
        # Calibration is about the label that was learned.
        target = dataset[model.target or PAPER].astype(bool)
        rows.extend(score_calibration(model, given, labelled=replace(labelled, reference=target)))
    rows += unfit_rows(unfit, labelled.source)
    if known:
        return Evaluation(rows, [])
    tests = [
        *against_baseline(predictions, labelled, metric="auc"),
        *further_tests(predictions, labelled, metric="auc", best=best),
    ]
    positions = len(np.unique(labelled.groups))
    shares = set_shares(rows, labelled.source, positions=positions)
    return Evaluation(rows, tests, shares=shares)


def evaluate_conditions(inputs: Inputs, *, resamples: int) -> list[Row]:
    """Return the rows about sets that repeat positions of others under another condition."""
    repeated = under_conditions(inputs.sets)
    names = sorted({*repeated, *repeated.values()})
    # Who was trained at these positions is asked only about those that its split held out.
    trained = {run.data_digest for runs in inputs.models.values() for run in runs}
    known = any(inputs.sets[name].digest in trained for name in names)
    given: dict[Model, dict[str, list[Predictions]]] = {}
    for name in names:
        fit, _ = fitting_set(inputs.models, inputs.sets[name], robots=inputs.robots)
        for model, runs in fit.items():
            answers = [predict_rows(run, inputs.sets[name], held_out=known) for run in runs]
            given.setdefault(model, {})[name] = answers
    about: dict[str, Any] = {"sets": inputs.sets, "resamples": resamples}
    return [row for model in given for row in changes(model, given[model], **about)]


def evaluate_survey(
    models: Models,
    folder: Path,
    *,
    localizers: Mapping[str, Localizer],
    name: str,
    robots: Mapping[str, Robot],
    resamples: int,
    best: Mapping[str, Model] = MappingProxyType({}),
    healths: Mapping[Path, Health] = MappingProxyType({}),
) -> Evaluation:
    """Evaluate models by the maps they leave of a survey.

    By the first localizer, and at the SNRs that tables show, models are tested in pairs, too.

    Args:
        models: finished runs of each model.
        folder: folder of the survey.
        localizers: localizers by name.
        name: name of the one that estimates the echoes.
        robots: robots of training sets, by the sets' digests.
        resamples: bootstrap draws.
        best: best learned model of each training that is looked at closely.
        healths: what recordings say about themselves, of surveys that were examined.
    """
    about: Any = {"further": looked_at(models), "health": healths.get(folder)}
    survey = localize_survey(folder, localizers[name], name=name, resamples=resamples, **about)
    holds = survey.columns.keys().__ge__
    models, unfit = split_fitting(models, robots, tested=robot_at(folder), holds=holds)
    references = scoring.trivial_predictions(survey.labelled.reference)
    predictions = predicted(models, lambda run: predict_echoes(run, survey))
    everyone = {Model(who): [given] for who, given in references.items()} | predictions
    rows: list[Row] = []
    for model, each in everyone.items():
        rows.extend(scoring.score_map(model, each, survey=survey))
    rows += unfit_rows(unfit, survey.labelled.source)
    if name != next(iter(localizers)):
        return Evaluation(rows, [], survey)
    shares = list(walk_shares(predictions, survey))
    if survey.snr_db not in SHOWN_DB:
        return Evaluation(rows, [], survey, shares=shares)
    about = {"metric": "balanced_accuracy", "snr_db": survey.snr_db}
    tests = [
        *against_baseline(predictions, survey.labelled, **about),
        *further_tests(predictions, survey.labelled, best=best, **about),
    ]
    return Evaluation(rows, tests, survey, shares=shares)


def evaluate_measured(
    models: Models,
    group: str,
    *,
    folders: Sequence[Path],
    localizers: Mapping[str, Localizer],
    name: str,
    robots: Mapping[str, Robot],
    resamples: int,
    healths: Mapping[Path, Health] = MappingProxyType({}),
) -> Evaluation:
    """Evaluate models by what they say of every echo of recorded surveys.

    Args:
        models: finished runs of each model.
        group: name under which the surveys are judged.
        folders: their folders, all of one array.
        localizers: localizers by name.
        name: name of the one that estimates the echoes.
        robots: robots of training sets, by the sets' digests.
        resamples: bootstrap draws.
        healths: what recordings say about themselves, of surveys that were examined.
    """
    robot = robot_at(folders[0])
    about: Any = {"further": looked_at(models), "healths": healths, "resamples": resamples}
    try:
        measured = measured_rows(group, folders, localizer=localizers[name], name=name, **about)
    except Unheard as error:
        print(f"{group}, {name}: {error}", file=sys.stderr, flush=True)
        source = Recordings(group, kind="measured", localizer=name)
        _, unfit = split_fitting(models, robots, tested=robot, holds=lambda _: True)
        return Evaluation(unfit_rows(dict.fromkeys(models, OTHER_LOCALIZER) | unfit, source), [])
    models, unfit = split_fitting(
        models, robots, tested=robot, holds=measured.columns.keys().__ge__
    )
    references = scoring.trivial_predictions(measured.labelled.reference)
    kept = ("keep_everything", "chance")
    everyone = {Model(who): [references[who]] for who in kept}
    everyone |= predicted(models, lambda run: predict_measured(run, measured))
    rows: list[Row] = []
    for model, each in everyone.items():
        rows.extend(scoring.score_measured(model, each, measured=measured))
    return Evaluation(rows + unfit_rows(unfit, measured.labelled.source), [], measured=measured)


def looked_at(models: Models) -> set[str]:
    """Return the names of all columns and tensors that some run looks at."""
    return {name for runs in models.values() for run in runs for name in run.inputs}


def predicted(
    models: Models, predict: Callable[[Run], Predictions]
) -> dict[Model, list[Predictions]]:
    """Return what every run of each model predicts."""
    return {model: list(map(predict, runs)) for model, runs in models.items()}
