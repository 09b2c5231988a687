"""Which rows of a comparison, and which predictions, each of its figures shows."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from echolearn.comparison import figures
from echolearn.comparison.choice import Comparison, away, chosen, drawn, headline, ranked
from echolearn.comparison.looks import looks_of, plain_looks
from echolearn.comparison.pivot import pivot
from echolearn.comparison.reliability_figure import Answers, reliability
from echolearn.comparison.shown import MAP_METRIC, MapPair, conditions
from echolearn.comparison.tables import (
    levels,
    localizers_of,
    main_localizer,
    placed,
    unfiltered,
)
from echolearn.evaluation.reliability import BANDS_DB
from echolearn.evaluation.rows import (
    PAPER,
    UNFIT,
    Model,
    Row,
    in_band,
    pick,
)
from echolearn.training.predictions import (
    label_rows,
    predict_measured,
    predict_rows,
)

MOST = 3
"""Models that are drawn: more hide each other."""

FEWEST = 20
"""Rows of a panel, at least: two in each bin."""

Panels = dict[str, dict[str, list[Row]]]
"""Rows of a line over SNR, by title of the panel and label of the line."""


def draw_all(comparison: Comparison, pairs: Sequence[MapPair]) -> dict[str, str]:
    """Return every figure of a comparison and of its maps as SVG, by name."""
    sets = draw_dots(comparison) | draw_sets(comparison) | draw_reliability(comparison)
    return sets | (draw_surveys(comparison, pairs) if comparison.surveys else {})


def draw_sets(comparison: Comparison) -> dict[str, str]:
    """Return the figures about labelled sets: AUC by band, belief, arrival times off the grid."""
    shown = away(comparison)
    dataset = comparison.sets[shown]
    rows = pick(comparison.rows, seed="", tested_on=shown, metric="auc")
    looks = looks_of(comparison.models)
    bands = {}
    predictions = {}
    for model in drawn(comparison):
        if not pick(rows, **model._asdict()):
            continue  # made for another robot
        found = pick(rows, **model._asdict())
        # A row without an SNR is about all rows of the set.
        bands[model.classifier] = [row for row in found if row["snr_db"]]
        predictions[model.classifier] = predict_rows(comparison.models[model][0], dataset)
    times = {}
    for name in (next(iter(comparison.sets)), shown):
        one = comparison.sets[name]
        times[name] = (1e3 * one["toa"], one["reflector"])
    return {
        "bands": figures.bands(bands, looks=looks),
        "belief": figures.belief(predictions, label_rows(dataset, resamples=1), looks=looks),
        "arrival_times": figures.arrival_times(times),
    }


def draw_surveys(comparison: Comparison, pairs: Sequence[MapPair]) -> dict[str, str]:
    """Return the figures about surveys: maps before and after, quality over SNR, directions."""
    rows = placed(pick(comparison.rows, seed=""), comparison.surveys.values())
    first, *_, last = 2 * levels(comparison)
    lines = by_panel(unfiltered(rows), line="localizer")
    pictures = {
        "maps_first": filtered(comparison, pairs, snr_db=first),
        "quality": figures.over_snr(
            quality(comparison, rows),
            looks=looks_of(comparison.models),
            ylabel=MAP_METRIC,
            low=0.3,
        ),
        "directions": figures.over_snr(
            lines,
            looks=plain_looks(localizers_of(comparison)),
            ylabel="share of points on a wall, unfiltered",
        ),
    }
    for number, pair in enumerate(pairs, start=1):
        pictures[f"map_{number}_every"] = figures.single_map(pair.survey, pair.kept | True)
        pictures[f"map_{number}_kept"] = figures.single_map(pair.survey, pair.kept)
    if last != first:
        pictures["maps_last"] = filtered(comparison, pairs, snr_db=last)
    return pictures


def draw_dots(comparison: Comparison) -> dict[str, str]:
    """Return the panels of the dot plot, by name."""
    order = [model.classifier for model in ranked(comparison, headline(comparison))]
    about: dict[str, Any] = {
        "looks": looks_of(comparison.models),
        "order": order,
        "best": chosen(comparison).classifier,
    }
    shown = conditions(comparison)
    found = {}
    for number, (title, metric, rows) in enumerate(shown, start=1):
        # Panels of one metric have one axis, so that they can be read across.
        alike = [row for each in shown if each.metric == metric for row in each.rows]
        low = np.nanmin([0.5, *figures.numbers(alike, "ci_low")[0]])
        about |= {"title": title, "metric": metric, "low": float(low)}
        found[f"dots_{number}"] = figures.dots(rows, **about)
    return found


def filtered(comparison: Comparison, pairs: Sequence[MapPair], *, snr_db: str) -> str:
    """Return the maps of every room before and after the chosen model's first seed filters them.

    Args:
        comparison: what was found.
        pairs: its maps.
        snr_db: SNR of those that are drawn.
    """
    here = [pair for pair in pairs if pair.snr_db == snr_db]
    walks = [(pair.title, pair.survey, pair.kept) for pair in here]
    return figures.maps(walks, classifier=chosen(comparison).classifier)


def quality(comparison: Comparison, rows: Sequence[Row]) -> Panels:
    """Return balanced accuracy of the main localizer's maps, a line for each drawn model."""
    names = tuple(model.classifier for model in drawn(comparison))
    maps = pick(rows, kind="survey", localizer=main_localizer(comparison), classifier=names)
    lines = pick(maps, metric="balanced_accuracy", training=headline(comparison))
    return by_panel(lines, line="classifier")


def by_panel(rows: Sequence[Row], *, line: str) -> Panels:
    """Return rows by the place of their survey, and then by their column `line`."""
    found: Panels = {}
    for (place, label), cells in pivot(rows, lines=("place", line), cells="snr_db").items():
        found.setdefault(place, {})[label] = list(cells.values())
    return found


def draw_reliability(comparison: Comparison) -> dict[str, str]:
    """Return the figure as SVG, by its name; nothing if no model was made for these robots."""
    panels = banded(comparison) | measured_panels(comparison)
    panels = {title: answers for title, answers in panels.items() if answers}
    looks = looks_of(comparison.models)
    return {"reliability": reliability(panels, looks=looks)} if panels else {}


def fitting(comparison: Comparison, tested_on: str) -> list[Model]:
    """Return the drawn models that say something about a set or a group of surveys."""
    rows = pick(comparison.rows, tested_on=tested_on, seed="", snr_db="")
    fit = [row for row in rows if row["metric"] not in UNFIT]
    return [model for model in drawn(comparison) if pick(fit, **model._asdict())][:MOST]


def banded(comparison: Comparison) -> dict[str, Answers]:
    """Return what models say in each band of the set whose curves are drawn, by title."""
    name = away(comparison)
    dataset = comparison.sets[name]
    found: dict[str, Answers] = {}
    for model in fitting(comparison, name):
        given = predict_rows(comparison.models[model][0], dataset)
        truth = dataset[model.target or PAPER].astype(bool)[given.rows]
        for low, high in BANDS_DB:
            inside = in_band(dataset.ratio_db, low=low, high=high)[given.rows]
            if inside.sum() >= FEWEST:
                answers = found.setdefault(f"{low} to {high} dB", {})
                answers[model.classifier] = truth[inside], given.confidence[inside]
    return found


def measured_panels(comparison: Comparison) -> dict[str, Answers]:
    """Return what models say of recorded surveys, by the name of their group."""
    found = {}
    for (group, localizer), measured in comparison.measured.items():
        if localizer != main_localizer(comparison):
            continue
        answers = {}
        for model in fitting(comparison, group):
            given = predict_measured(comparison.models[model][0], measured)
            answers[model.classifier] = measured.labelled.reference, given.confidence
        found[f"measured: {group}"] = answers
    return found
