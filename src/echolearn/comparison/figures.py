"""Figures of a comparison, as SVG text: the same data give the same bytes.

A classifier has the colour and marker of its `Look` in each of them.
"""

from collections.abc import Mapping, Sequence
from io import StringIO
from itertools import chain
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from echolearn.acoustics.sides import polylines
from echolearn.acoustics.types import Array
from echolearn.comparison.looks import BLACK, BLUE, GREY, RED, Looks
from echolearn.comparison.template import share_on_walls
from echolearn.evaluation import metrics
from echolearn.evaluation.rows import (
    LabelledRows,
    LocalizedSurvey,
    Predictions,
    Row,
    distinct,
)

INTERVAL = ("value", "ci_low", "ci_high")
"""Columns of a figure and of both ends of its interval."""

WOOD = "#c9a58d"
"""Colour of what is spurious or rejected, where it should not catch the eye."""

Walk = tuple[str, LocalizedSurvey, Array]
"""A title, a survey, and which of its points a filter keeps, shape (P,), bool."""

STYLE: Any = {
    "svg.hashsalt": "echolearn",
    "svg.fonttype": "path",
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e4e4e4",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
}


styled = mpl.rc_context(STYLE)
"""Decorator of what draws: a style counts when lines are made, and again when they are saved."""


def canvas(
    columns: int, *, width: float, height: float, rows: int = 1, **shared: Any
) -> tuple[Figure, list[Axes]]:
    """Return an empty figure and its panels, row by row.

    Args:
        columns, rows: number of panels beside and below each other.
        width, height: size in inches.
        shared: what panels have in common, as `sharey=True`.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **shared)
    return figure, axes.ravel().tolist()


def as_svg(
    figure: Figure, *, explained: Axes | None = None, columns: int = 4, tight: bool = True
) -> str:
    """Return a figure as SVG.

    Args:
        figure: what was drawn.
        explained: panel whose lines are named below the figure; none if they are named elsewhere.
        columns: names beside each other.
        tight: whether the page ends where the drawing does.
    """
    if explained is not None:
        handles, labels = explained.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=columns)
    text = StringIO()
    # A date or a version would give the same data other bytes.
    about = {"Date": None, "Creator": None}
    ends = "tight" if tight else None
    figure.savefig(text, format="svg", metadata=about, bbox_inches=ends)
    return text.getvalue()


@styled
def maps(walks: Sequence[Walk], *, classifier: str) -> str:
    """Draw maps before and after a classifier filters them, side by side.

    Args:
        walks: a row for each.
        classifier: name of what decides which points are kept.
    """
    slopes = []
    for _, survey, _ in walks:
        across, along = np.ptp(survey.walls, axis=(0, 1))
        slopes.append(along / across)
    # A row is as high as its map, so that all are drawn to one scale.
    height = 4.0 * sum(slopes) + 0.8 * len(walks) + 0.8
    figure, axes = canvas(2, rows=len(walks), width=9.2, height=height)
    for row, (title, survey, kept) in enumerate(walks):
        before, after = axes[2 * row : 2 * row + 2]
        paint_map(before, survey, title=f"{title}: every estimate", kept=np.ones_like(kept))
        paint_map(after, survey, title=f"{title}: filtered by {classifier}", kept=kept)
    return as_svg(figure, explained=axes[0], columns=5)


@styled
def single_map(survey: LocalizedSurvey, kept: Array) -> str:
    """Draw one map without title and legend, for a page that lays two over each other.

    Args:
        survey: the survey.
        kept: which of its points are kept, shape (P,), bool.
    """
    across, along = np.ptp(survey.walls, axis=(0, 1))
    figure, [axis] = canvas(1, width=4.6, height=4.0 * along / across + 0.5)
    paint_map(axis, survey, title="", kept=kept)
    axis.set_title("")
    # Both maps must have one size: what is cut to its content may differ by a label.
    return as_svg(figure, tight=False)


def paint_map(axis: Axes, survey: LocalizedSurvey, *, title: str, kept: Array) -> None:
    """Draw one map: true walls, path, kept and rejected points, equal axes.

    Args:
        axis: where it is drawn.
        survey: the survey.
        title: title of the map.
        kept: which of its points are kept, shape (P,), bool.
    """
    true = survey.labelled.reference
    # NaN lifts the pen between lines.
    gap = np.full((1, 2), np.nan)
    outline = np.vstack([part for line in polylines(survey.walls) for part in (gap, line)][1:])
    points = survey.points
    # What matters most comes last, on top of the rest.
    layers = (
        ("path", survey.poses, "-", "#b5b5b5", 1.0),
        ("wall", outline, "-", BLACK, 2.0),
        ("rejected", points[~kept], "x", WOOD, 4.0),
        ("kept, spurious", points[kept & ~true], "^", RED, 5.0),
        ("kept, on a wall", points[kept & true], "o", BLUE, 4.0),
    )
    for order, (label, places, form, colour, size) in enumerate(layers, start=1):
        about: Any = {"color": colour, "linewidth": size, "markersize": size, "zorder": order}
        axis.plot(*places.T, form, label=label, **about)
    axis.set_title(f"{title}\n{share_on_walls(true, kept)}", fontsize=9)
    across, along = np.transpose(
        [survey.walls.min(axis=(0, 1)) - 0.6, survey.walls.max(axis=(0, 1)) + 0.6]
    )
    axis.set(aspect="equal", xlim=across, ylim=along, xlabel="x / m", ylabel="y / m")
    axis.grid(visible=False)


@styled
def dots(
    rows: Sequence[Row],
    *,
    looks: Looks,
    order: Sequence[str],
    title: str,
    metric: str,
    best: str,
    low: float,
) -> str:
    """Draw one condition: a line for each classifier, its figure as a point with its interval.

    Args:
        rows: rows of results.csv, one for each classifier.
        looks: of the classifiers.
        order: names of all classifiers, from above, so that conditions can be read across.
        title: of the condition.
        metric: what the figure is called.
        best: the chosen classifier.
        low: lower end of the axis.
    """
    figure, [axis] = canvas(1, width=3.9, height=0.85 + 0.2 * len(order))
    for row in rows:
        name = row["classifier"]
        value, *ends = (float(row[key]) for key in INTERVAL)
        place = len(order) - order.index(name)
        axis.plot(ends, [place, place], color=looks[name].colour, linewidth=1.2)
        axis.plot([value], [place], linestyle="", markersize=5, **looks[name].style)
    axis.axvline(0.5, color=GREY, linestyle="--", linewidth=1)
    axis.set_yticks(range(len(order), 0, -1), order)
    for label in axis.get_yticklabels():
        label.set_fontweight("bold" if label.get_text() == best else "normal")
    axis.set(xlim=(low - 0.02, 1.02), ylim=(0.4, len(order) + 0.6), xlabel=metric)
    axis.set_title(title, fontsize=9)
    return as_svg(figure, tight=False)


@styled
def over_snr(
    panels: Mapping[str, Mapping[str, Sequence[Row]]],
    *,
    looks: Looks,
    ylabel: str,
    low: float = 0.0,
) -> str:
    """Draw a metric against SNR, a panel per room and a line per model, with intervals.

    Args:
        panels: rows of results.csv, one per SNR, by the line's label, by the panel's title.
        looks: of the lines.
        ylabel: name of the metric.
        low: lower end of the axis.
    """
    width = max(4.6 * len(panels), 7.0)
    figure, axes = canvas(len(panels), width=width, height=4.2, sharey=True)
    for axis, (title, lines) in zip(axes, panels.items(), strict=True):
        for label, rows in lines.items():
            rising = sorted(rows, key=lambda row: float(row["snr_db"]))
            paint_line(axis, rising, label=label, **looks[label].style)
        axis.set(title=title, xlabel="SNR / dB", ylim=(low, 1.03))
    axes[0].set_ylabel(ylabel)
    return as_svg(figure, explained=axes[0])


def paint_line(
    axis: Axes, rows: Sequence[Row], *, label: str, along: str = "snr_db", **style: Any
) -> None:
    """Draw one line with its interval as a band.

    Args:
        axis: where it is drawn.
        rows: rows of results.csv, by rising `along`.
        label: name of the line.
        along: column of the horizontal axis.
        style: of the line, as matplotlib takes it.
    """
    x, value, low, high = numbers(rows, along, *INTERVAL)
    [line] = axis.plot(x, value, markersize=4, label=label, **style)
    axis.fill_between(x, low, high, color=line.get_color(), alpha=0.12, linewidth=0)


def numbers(rows: Sequence[Row], *columns: str) -> Array:
    """Return what stands in columns of rows, shape (columns, rows)."""
    return np.array([[row[name] for row in rows] for name in columns], dtype=float)


def paint_intervals(axis: Axes, x: Any, *, rows: Sequence[Row], **style: Any) -> None:
    """Draw a point for each row with its interval as a bar.

    Args:
        axis: where they are drawn.
        x: where each stands, shape (rows,).
        rows: rows with value and interval.
        style: of the points, as matplotlib's `errorbar` takes it.
    """
    value, *ends = numbers(rows, *INTERVAL)
    axis.errorbar(x, value, yerr=np.abs(ends - value), **style)


@styled
def bands(lines: Mapping[str, Sequence[Row]], *, looks: Looks) -> str:
    """Draw AUC by SNR band with intervals, a group of points per band.

    Args:
        lines: rows of results.csv with "low:high", by label.
        looks: of the lines.
    """
    figure, [axis] = canvas(1, width=9.2, height=4.4)
    names = distinct(chain.from_iterable(lines.values()), "snr_db")
    lowest = 0.5
    style: Any = {"linestyle": "", "markersize": 4, "elinewidth": 1}
    for number, (label, rows) in enumerate(lines.items()):
        # Side by side within the band, or intervals would hide each other.
        beside = (number - len(lines) / 2) * 0.07
        x = [names.index(row["snr_db"]) + beside for row in rows]
        paint_intervals(axis, x, rows=rows, label=label, **style, **looks[label].style)
        lowest = min([lowest, *numbers(rows, "ci_low")[0]])
    axis.axhline(0.5, color=GREY, linestyle="--", linewidth=1)
    axis.set_xticks(range(len(names)), [name.replace(":", " to ") + " dB" for name in names])
    axis.set(ylabel="AUC", xlabel="SNR band", ylim=(lowest - 0.04, 1.02))
    return as_svg(figure, explained=axis)


@styled
def belief(predictions: Mapping[str, Predictions], labelled: LabelledRows, *, looks: Looks) -> str:
    """Draw precision-recall and reliability curves of several models on one labelled set.

    Args:
        predictions: what each model says, by its name.
        labelled: the set.
        looks: of the models.
    """
    figure, [left, right] = canvas(2, width=9.2, height=4.4)
    for label, given in predictions.items():
        reference = labelled.reference[given.rows]
        precision, recall = metrics.pr_curve(reference, given.confidence)
        style = looks[label].style
        # A few markers tell curves of one colour from each other.
        left.plot(recall, precision, label=label, markevery=0.1, markersize=4, **style)
        right.plot(*metrics.reliability_curve(reference, given.confidence), markersize=4, **style)
    left.axhline(labelled.reference.mean(), color=GREY, linestyle="--", linewidth=1)
    left.set(title="precision and recall", xlabel="recall", ylabel="precision")
    left.set(xlim=(0, 1.01), ylim=(0, 1.03))
    right.plot([0, 1], [0, 1], "--", color=GREY, linewidth=1)
    right.set(title="reliability", xlabel="mean confidence", ylabel="share of reflectors")
    right.set(xlim=(0, 1), ylim=(0, 1))
    return as_svg(figure, explained=left)


@styled
def arrival_times(sets: Mapping[str, tuple[Array, Array]]) -> str:
    """Draw what a classifier that knows the TOA alone can learn: how labels depend on the TOA.

    Args:
        sets: estimated TOA in ms, shape (B,), and whether it is a reflector, shape (B,), by title.
    """
    every = np.concatenate([toa for toa, _ in sets.values()])
    edges = np.linspace(every.min(), every.max(), 65)
    colours = {"reflector": BLUE, "spurious": WOOD}
    figure, axes = canvas(len(sets), width=4.6 * len(sets), height=3.0, sharey=True)
    for axis, (title, (toa, reflector)) in zip(axes, sets.items(), strict=True):
        both = [toa[reflector], toa[~reflector]]
        weights = [np.full(len(part), 1.0 / len(toa)) for part in both]
        about: Any = {"label": list(colours), "color": list(colours.values())}
        axis.hist(both, edges.tolist(), weights=weights, stacked=True, **about)
        axis.set(title=title, xlabel="estimated time of arrival / ms")
    axes[0].set_ylabel("share of observations")
    axes[0].legend(loc="upper right")
    return as_svg(figure)
