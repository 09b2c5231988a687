"""Reliability by band of SNR, and on measured sound: what is believed against what is true.

A panel is a band of a labelled set or a group of recorded surveys; a line is a model, a point one
of ten bins of equal count, its bar two standard deviations of the share that would be true if all
were as claimed. On the dashed line belief and truth agree: points below it are believed too much.
Labels are those that each model has learned; of recorded surveys, that by which they are judged.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from echolearn.acoustics.types import Array
from echolearn.comparison import figures
from echolearn.comparison.choice import Comparison, drawn
from echolearn.comparison.tables import away, main_localizer
from echolearn.evaluation.calibration_rows import PAPER
from echolearn.evaluation.reliability import BANDS_DB, curve
from echolearn.evaluation.rows import UNFIT, Model, in_band, pick
from echolearn.training.predictions import predict_measured, predict_rows

ACROSS = 4
"""Panels beside each other."""

MOST = 3
"""Models that are drawn: more hide each other."""

FEWEST = 20
"""Rows of a panel, at least: two in each bin."""

Answers = dict[str, tuple[Array, Array]]
"""Truth and confidence of some rows, each (B,), by the model's name."""


def reliability(comparison: Comparison) -> dict[str, str]:
    """Return the figure as SVG, by its name; nothing if no model was made for these robots."""
    panels = banded(comparison) | recorded(comparison)
    panels = {title: answers for title, answers in panels.items() if answers}
    return {"reliability": draw(panels)} if panels else {}


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


def recorded(comparison: Comparison) -> dict[str, Answers]:
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


@figures.styled
def draw(panels: Mapping[str, Answers]) -> str:
    """Draw reliability diagrams, a panel for each title."""
    rows = -(-len(panels) // ACROSS)
    across = min(ACROSS, len(panels))
    figure, axes = figures.canvas(
        across, rows=rows, width=2.4 * across, height=2.6 * rows + 0.6, sharey=True
    )
    names = list(dict.fromkeys(name for answers in panels.values() for name in answers))
    for axis, (title, answers) in zip(axes, panels.items(), strict=False):
        axis.plot([0, 1], [0, 1], "--", color=figures.GREY, linewidth=1)
        for name in names:
            paint(axis, answers.get(name), label=name)
        axis.set(title=title, xlim=(0, 1), ylim=(0, 1), aspect="equal")
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    for axis in axes[::across]:
        axis.set_ylabel("share that is true")
    for axis in axes[len(panels) - across :]:
        axis.set_xlabel("mean confidence")
    return figures.as_svg(figure, explained=axes[0])


def paint(axis: Axes, answers: tuple[Array, Array] | None, *, label: str) -> None:
    """Draw one model's points; where it says nothing an empty line, to keep its colour.

    Args:
        axis: where they are drawn.
        answers: truth and confidence, each (B,).
        label: name of the model.
    """
    empty = np.empty(0)
    points = curve(*answers) if answers else (empty, empty, empty)
    belief, share, deviation = points
    # Bins are joined by no line: where they lie close, it would be all that is seen.
    style: Any = {"linestyle": "", "markersize": 4, "elinewidth": 0.7, "alpha": 0.8}
    axis.errorbar(belief, share, yerr=2 * deviation, label=label, **style)
