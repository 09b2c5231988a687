"""Figures of a comparison, as SVG text: the same data give the same bytes.

Colours are those of Okabe and Ito, told apart by colour-blind readers; lines differ in marker as
well.
"""

from collections.abc import Callable, Mapping, Sequence
from io import StringIO
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from echolearn.acoustics.types import Array
from echolearn.evaluation import metrics
from echolearn.evaluation.rows import LabelledRows, LocalizedSurvey, Predictions, Row

BLACK, ORANGE, SKY, GREEN, BLUE, RED, PURPLE, GREY = (
    "#000000", "#e69f00", "#56b4e9", "#009e73", "#0072b2", "#d55e00", "#cc79a7", "#7f7f7f"
)  # fmt: skip
CYCLE = (BLUE, RED, GREEN, ORANGE, PURPLE, SKY, BLACK, GREY)
MARKERS = "osD^vP*Xhd<>"

WOOD = "#c9a58d"
"""Colour of what is spurious or rejected, where it should not catch the eye."""

Panel = tuple[str, LocalizedSurvey, Array]
"""A map: title, survey, and which of its points are kept, shape (P,), bool."""

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


def draw(paint: Callable[[Figure], None], *, width: float, height: float) -> str:
    """Return the SVG of a figure.

    Args:
        paint: draws into the figure.
        width, height: size in inches.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        paint(figure)
        text = StringIO()
        # A date or a version would give the same data other bytes.
        about = {"Date": None, "Creator": None}
        figure.savefig(text, format="svg", metadata=about, bbox_inches="tight")
    return text.getvalue()


def stroke(number: int) -> dict[str, Any]:
    """Return colour and marker of line `number`; they begin anew when they run out."""
    return {"color": CYCLE[number % len(CYCLE)], "marker": MARKERS[number % len(MARKERS)]}


def legend_below(figure: Figure, axis: Axes, *, columns: int = 4) -> None:
    """Explain the lines of an axis below the figure.

    Args:
        figure: drawing that gets the legend.
        axis: panel whose curves are named.
        columns: entries beside each other.
    """
    handles, labels = axis.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=columns)


def maps(panels: Sequence[Panel]) -> str:
    """Draw maps side by side, two in a row."""
    columns = 2
    rows = -(-len(panels) // columns)
    sides = [np.ptp(survey.corners, axis=0) for _, survey, _ in panels]
    # A row is as high as its steepest map, so that all are drawn to one scale.
    slopes = [height / width for width, height in sides]
    height = sum(max(slopes[row * columns : (row + 1) * columns]) for row in range(rows))

    def paint(figure: Figure) -> None:
        """Draw a panel for each map."""
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for axis, (title, survey, kept) in zip(axes, panels, strict=False):
            paint_map(axis, survey, title=title, kept=kept)
        legend_below(figure, axes[0], columns=5)

    return draw(paint, width=4.6 * columns, height=4.0 * height + 0.8 * rows + 0.8)


def paint_map(axis: Axes, survey: LocalizedSurvey, *, title: str, kept: Array) -> None:
    """Draw one map: true walls, path, kept and rejected points, equal axes.

    Args:
        axis: where it is drawn.
        survey: the survey.
        title: title of the map.
        kept: which of its points are kept, shape (P,), bool.
    """
    true = survey.labelled.reference
    outline = np.vstack([survey.corners, survey.corners[:1]])
    axis.plot(*survey.poses.T, color="#b5b5b5", linewidth=1.0, label="path", zorder=1)
    axis.plot(*outline.T, color=BLACK, linewidth=2.0, label="wall", zorder=2)
    cross: Any = {"marker": "x", "color": WOOD, "markersize": 4, "markeredgewidth": 0.9}
    triangle: Any = {"marker": "^", "color": RED, "markersize": 5}
    circle: Any = {"marker": "o", "color": BLUE, "markersize": 4}
    # What matters most comes last, on top of the rest.
    layers = {
        "rejected": (~kept, cross),
        "kept, spurious": (kept & ~true, triangle),
        "kept, on a wall": (kept & true, circle),
    }
    for layer, (label, (shown, style)) in enumerate(layers.items(), start=3):
        axis.plot(*survey.points[shown].T, linestyle="", label=label, zorder=layer, **style)
    told = "no points"
    if kept.any():
        told = f"{(kept & true).sum() / kept.sum():.0%} of {kept.sum()} points on a wall"
    axis.set_title(f"{title}\n{told}", fontsize=9)
    left, bottom = survey.corners.min(axis=0) - 0.6
    right, top = survey.corners.max(axis=0) + 0.6
    axis.set(aspect="equal", xlim=(left, right), ylim=(bottom, top))
    axis.set(xlabel="x / m", ylabel="y / m")
    axis.grid(visible=False)


def over_snr(
    panels: Mapping[str, Mapping[str, Sequence[Row]]], *, ylabel: str, low: float = 0.0
) -> str:
    """Draw a metric against SNR, a panel per room and a line per model, with intervals.

    Args:
        panels: rows of results.csv, one per SNR, by the line's label, by the panel's title.
        ylabel: name of the metric.
        low: lower end of the axis.
    """

    def paint(figure: Figure) -> None:
        """Draw a panel for each room."""
        axes = figure.subplots(1, len(panels), squeeze=False, sharey=True).ravel()
        for axis, (title, lines) in zip(axes, panels.items(), strict=True):
            for number, (label, rows) in enumerate(lines.items()):
                rising = sorted(rows, key=lambda row: float(row["snr_db"]))
                paint_line(axis, rising, label=label, number=number)
            axis.set(title=title, xlabel="SNR / dB", ylim=(low, 1.03))
        axes[0].set_ylabel(ylabel)
        legend_below(figure, axes[0])

    return draw(paint, width=max(4.6 * len(panels), 7.0), height=4.2)


def paint_line(axis: Axes, rows: Sequence[Row], *, label: str, number: int) -> None:
    """Draw one line with its interval as a band.

    Args:
        axis: where it is drawn.
        rows: rows of results.csv, by rising SNR.
        label: name of the line.
        number: number of the line, for its stroke.
    """
    x = np.array([row["snr_db"] for row in rows], dtype=float)
    value, low, high = _figures(rows)
    style = stroke(number)
    axis.plot(x, value, markersize=4, label=label, **style)
    axis.fill_between(x, low, high, color=style["color"], alpha=0.12, linewidth=0)


def _figures(rows: Sequence[Row]) -> Array:
    """Return value and both ends of the interval of each row, shape (3, rows)."""
    cells = [(row["value"], row["ci_low"], row["ci_high"]) for row in rows]
    return np.array(cells, dtype=float).reshape(-1, 3).T


def bands(lines: Mapping[str, Sequence[Row]]) -> str:
    """Draw AUC by SNR band with intervals, a group of points per band.

    Args:
        lines: rows of results.csv with "low:high", by label.
    """

    def paint(figure: Figure) -> None:
        """Draw the curves over SNR bands."""
        axis = figure.subplots()
        names = list(dict.fromkeys(row["snr_db"] for rows in lines.values() for row in rows))
        lowest = 0.5
        for number, (label, rows) in enumerate(lines.items()):
            # Side by side within the band, or intervals would hide each other.
            beside = (number - len(lines) / 2) * 0.07
            x = np.array([names.index(row["snr_db"]) for row in rows]) + beside
            value, low, high = _figures(rows)
            spread = np.abs([low - value, high - value])
            about: Any = {"linestyle": "", "markersize": 4, "elinewidth": 1, "label": label}
            axis.errorbar(x, value, yerr=spread, **about, **stroke(number))
            lowest = min([lowest, *low])
        axis.axhline(0.5, color=GREY, linestyle="--", linewidth=1)
        axis.set_xticks(range(len(names)), [name.replace(":", " to ") + " dB" for name in names])
        axis.set(ylabel="AUC", xlabel="SNR band", ylim=(lowest - 0.04, 1.02))
        legend_below(figure, axis)

    return draw(paint, width=9.2, height=4.4)


def belief(predictions: Mapping[str, Predictions], labelled: LabelledRows) -> str:
    """Draw precision-recall and reliability curves of several models on one labelled set."""

    def paint(figure: Figure) -> None:
        """Draw the two curves side by side."""
        left, right = figure.subplots(1, 2)
        for number, (label, given) in enumerate(predictions.items()):
            reference = labelled.reference[given.rows]
            precision, recall = metrics.pr_curve(reference, given.confidence)
            mean, observed = metrics.reliability_curve(reference, given.confidence)
            style = stroke(number)
            left.plot(recall, precision, color=style["color"], label=label)
            right.plot(mean, observed, markersize=4, label=label, **style)
        left.axhline(labelled.reference.mean(), color=GREY, linestyle="--", linewidth=1)
        left.set(title="precision and recall", xlabel="recall", ylabel="precision")
        left.set(xlim=(0, 1.01), ylim=(0, 1.03))
        right.plot([0, 1], [0, 1], color=GREY, linestyle="--", linewidth=1)
        right.set(title="reliability", xlabel="mean confidence", ylabel="share of reflectors")
        right.set(xlim=(0, 1), ylim=(0, 1))
        legend_below(figure, left)

    return draw(paint, width=9.2, height=4.4)


def arrival_times(sets: Mapping[str, tuple[Array, Array]]) -> str:
    """Draw what a classifier that knows the TOA alone can learn: how labels depend on the TOA.

    Args:
        sets: estimated TOA in ms, shape (B,), and whether it is a reflector, shape (B,), by title.
    """
    every = np.concatenate([toa for toa, _ in sets.values()])
    edges = np.linspace(every.min(), every.max(), 65)

    def paint(figure: Figure) -> None:
        """Draw a panel for each set."""
        axes = figure.subplots(1, len(sets), squeeze=False, sharey=True).ravel()
        for axis, (title, (toa, reflector)) in zip(axes, sets.items(), strict=True):
            both = [toa[reflector], toa[~reflector]]
            axis.hist(
                both,
                edges,
                weights=[np.full(len(part), 1.0 / len(toa)) for part in both],
                stacked=True,
                label=["reflector", "spurious"],
                color=[BLUE, WOOD],
            )
            axis.set(title=title, xlabel="estimated time of arrival / ms")
        axes[0].set_ylabel("share of observations")
        axes[0].legend(loc="upper right")

    return draw(paint, width=4.6 * len(sets), height=3.0)
