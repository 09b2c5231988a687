"""Evaluate all models on all sets and surveys, shared out among processes."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, product
from pathlib import Path
from typing import Any, NamedTuple

from echolearn.comparison.choice import Comparison
from echolearn.comparison.localized import localize_survey
from echolearn.comparison.tables import SHOWN_DB
from echolearn.dataset.labelled_set import Dataset
from echolearn.evaluation import pairs, scoring
from echolearn.evaluation.rows import LabelledRows, LocalizedSurvey, Model, Predictions, Row
from echolearn.localization.localizer import Localizer
from echolearn.runtime.processes import processes
from echolearn.runtime.progress import track
from echolearn.training.predictions import label_rows, predict_echoes, predict_rows
from echolearn.training.runs import Run

BASELINE = "threshold_peak"
"""The bare threshold that every other model is tested against."""

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
    """

    models: Models
    roles: Mapping[str, str]
    sets: Mapping[str, Dataset]
    surveys: Mapping[str, Path]
    localizers: Mapping[str, Localizer]


class Evaluation(NamedTuple):
    """What was found on one set or survey: rows of results.csv and of tests.csv, and the survey."""

    rows: list[Row]
    tests: list[Row]
    survey: LocalizedSurvey | None = None


def evaluate(inputs: Inputs, *, resamples: int, workers: int) -> Comparison:
    """Evaluate every model on every set and on every survey by each localizer.

    Args:
        inputs: models, sets, surveys, localizers.
        resamples: bootstrap draws behind every interval.
        workers: processes; the result does not depend on their number.
    """
    models = inputs.models
    jobs = []
    with processes(workers) as pool:
        for dataset in inputs.sets.values():
            jobs.append(pool.submit(evaluate_set, models, dataset.folder, resamples=resamples))
        about: Any = {"localizers": inputs.localizers, "resamples": resamples}
        for folder, name in product(inputs.surveys.values(), inputs.localizers):
            jobs.append(pool.submit(evaluate_survey, models, folder, name=name, **about))
        waiting = track(jobs, "evaluate", unit="sets and surveys")
        done = [job.result() for job in waiting]
    rows: list[Row] = []
    tests: list[Row] = []
    surveys = {}
    for found in done:
        rows += found.rows
        tests += found.tests
        if found.survey:
            source = found.survey.labelled.source
            surveys[source.tested_on, source.localizer] = found.survey
    # All tests of a family are corrected together, so only when all of them are known.
    return Comparison(models, inputs.roles, inputs.sets, surveys, rows, pairs.correct(tests))


def evaluate_set(models: Models, folder: Path, *, resamples: int) -> Evaluation:
    """Evaluate models on a labelled set.

    On a set that any of them was trained on, all are evaluated on held-out rows, and not tested in
    pairs.

    Args:
        models: finished runs of each model.
        folder: folder of the set.
        resamples: bootstrap draws.
    """
    dataset = Dataset(folder)
    labelled = label_rows(dataset, resamples=resamples)
    runs = chain.from_iterable(models.values())
    known = dataset.digest in {run.data_digest for run in runs}
    predictions = predicted(models, lambda run: predict_rows(run, dataset, held_out=known))
    # Of the references chance alone has something to say about labels.
    references = scoring.trivial_predictions(labelled.reference)
    rows: list[Row] = []
    for model, given in (predictions | {Model("chance"): [references["chance"]]}).items():
        rows.extend(scoring.score_labels(model, given, labelled=labelled))
    tests = [] if known else list(against_baseline(predictions, labelled, metric="auc"))
    return Evaluation(rows, tests)


def evaluate_survey(
    models: Models,
    folder: Path,
    *,
    localizers: Mapping[str, Localizer],
    name: str,
    resamples: int,
) -> Evaluation:
    """Evaluate models by the maps they leave of a survey.

    By the first localizer, and at the SNRs that tables show, models are tested in pairs, too.

    Args:
        models: finished runs of each model.
        folder: folder of the survey.
        localizers: localizers by name.
        name: name of the one that estimates the echoes.
        resamples: bootstrap draws.
    """
    survey = localize_survey(folder, localizers[name], name=name, resamples=resamples)
    references = scoring.trivial_predictions(survey.labelled.reference)
    predictions = predicted(models, lambda run: predict_echoes(run, survey))
    everyone = {Model(who): [given] for who, given in references.items()} | predictions
    rows: list[Row] = []
    for model, each in everyone.items():
        rows.extend(scoring.score_map(model, each, survey=survey))
    if name != next(iter(localizers)) or survey.snr_db not in SHOWN_DB:
        return Evaluation(rows, [], survey)
    about: Any = {"metric": "balanced_accuracy", "snr_db": survey.snr_db}
    return Evaluation(rows, list(against_baseline(predictions, survey.labelled, **about)), survey)


def predicted(
    models: Models, predict: Callable[[Run], Predictions]
) -> dict[Model, list[Predictions]]:
    """Return what every run of each model predicts."""
    return {model: list(map(predict, runs)) for model, runs in models.items()}


def against_baseline(
    predictions: Mapping[Model, Sequence[Predictions]],
    labelled: LabelledRows,
    *,
    metric: str,
    snr_db: str = "",
) -> Iterator[Row]:
    """Test every model against the bare threshold of the same training and seeds.

    Models of a leaky split are left out, and those that have no seed in common with the threshold.

    Args:
        predictions: what each model says about the test set.
        labelled: the test set.
        metric: "auc" or "balanced_accuracy".
        snr_db: entry of that column.
    """
    # A threshold's scale is learned as well, so each training has its own.
    baselines = {}
    for model, given in predictions.items():
        if model.classifier == BASELINE:
            baselines[model.training] = given
    for model, given in predictions.items():
        baseline = baselines.get(model.training, ())
        leaky = model.split == "row"
        if model.classifier != BASELINE and not leaky and pairs.pair_seeds(given, baseline):
            found = pairs.paired_difference(given, baseline, labelled=labelled, metric=metric)
            about = model.columns() | labelled.source._asdict()
            yield about | {"against": BASELINE, "snr_db": snr_db} | found
