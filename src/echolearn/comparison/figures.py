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
from echolearn.evaluation.scoring import Answer, Heard, Row, Sheet

BLACK, ORANGE, SKY, GREEN, BLUE, RED, PURPLE, GREY = (
    "#000000", "#e69f00", "#56b4e9", "#009e73", "#0072b2", "#d55e00", "#cc79a7", "#7f7f7f"
)  # fmt: skip
CYCLE = (BLUE, RED, GREEN, ORANGE, PURPLE, SKY, BLACK, GREY)
MARKERS = "osD^vP*Xhd<>"

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
    """Return the SVG of a figure of that size in inches, painted by `paint`."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        paint(figure)
        text = StringIO()
        figure.savefig(
            text, format="svg", metadata={"Date": None, "Creator": None}, bbox_inches="tight"
        )
    return text.getvalue()


def maps(panels: Sequence[tuple[str, Heard, Array]], *, columns: int = 2) -> str:
    """Draw maps side by side.

    Args:
        panels: title, survey, and which of its points are kept, shape (P,), bool.
        columns: panels in a row.
    """
    rows = -(-len(panels) // columns)
    sizes = [np.ptp(heard.corners, axis=0) for _, heard, _ in panels]
    height = sum(
        max(s[1] / s[0] for s in sizes[r * columns : (r + 1) * columns]) for r in range(rows)
    )

    def paint(figure: Figure) -> None:
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for axis, (title, heard, kept) in zip(axes, panels, strict=False):
            paint_map(axis, title, heard, kept)
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)

    return draw(paint, width=4.6 * columns, height=4.0 * height + 0.8 * rows + 0.8)


def paint_map(axis: Axes, title: str, heard: Heard, kept: Array) -> None:
    """Draw one map: true walls, path, kept and rejected points, equal axes."""
    true = heard.sheet.reference
    corners = np.vstack([heard.corners, heard.corners[:1]])
    axis.plot(*heard.poses.T, color="#b5b5b5", linewidth=1.0, label="path", zorder=1)
    axis.plot(*corners.T, color=BLACK, linewidth=2.0, label="wall", zorder=2)
    rejected = heard.points[~kept]
    axis.plot(
        *rejected.T,
        linestyle="",
        marker="x",
        color="#c9a58d",
        markersize=4,
        markeredgewidth=0.9,
        label="rejected",
        zorder=3,
    )
    axis.plot(
        *heard.points[kept & ~true].T,
        linestyle="",
        marker="^",
        color=RED,
        markersize=5,
        label="kept, spurious",
        zorder=4,
    )
    axis.plot(
        *heard.points[kept & true].T,
        linestyle="",
        marker="o",
        color=BLUE,
        markersize=4,
        label="kept, on a wall",
        zorder=5,
    )
    precision = (
        f"{(kept & true).sum() / kept.sum():.0%} of {kept.sum()} points on a wall"
        if kept.any()
        else "no points"
    )
    axis.set_title(f"{title}\n{precision}", fontsize=9)
    low, high = heard.corners.min(axis=0) - 0.6, heard.corners.max(axis=0) + 0.6
    axis.set(
        aspect="equal",
        xlim=(low[0], high[0]),
        ylim=(low[1], high[1]),
        xlabel="x / m",
        ylabel="y / m",
    )
    axis.grid(visible=False)


def over_snr(
    panels: Mapping[str, Mapping[str, Sequence[Row]]], *, ylabel: str, low: float = 0.0
) -> str:
    """Draw a metric against SNR, a panel per room and a line per contestant, with intervals.

    Args:
        panels: title -> label -> rows of results.csv, one per SNR.
        ylabel: name of the metric.
        low: lower end of the axis.
    """

    def paint(figure: Figure) -> None:
        axes = figure.subplots(1, len(panels), squeeze=False, sharey=True).ravel()
        for axis, (title, lines) in zip(axes, panels.items(), strict=True):
            for number, (label, rows) in enumerate(lines.items()):
                paint_line(
                    axis, label, sorted(rows, key=lambda row: float(row["snr_db"])), number=number
                )
            axis.set(title=title, xlabel="SNR / dB", ylim=(low, 1.03))
        axes[0].set_ylabel(ylabel)
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)

    return draw(paint, width=max(4.6 * len(panels), 7.0), height=4.2)


def paint_line(axis: Axes, label: str, rows: Sequence[Row], *, number: int) -> None:
    """Draw one line with its interval as a band."""
    x = [float(row["snr_db"]) for row in rows]
    colour = CYCLE[number % len(CYCLE)]
    axis.plot(
        x,
        [row["value"] for row in rows],
        color=colour,
        marker=MARKERS[number % len(MARKERS)],
        markersize=4,
        label=label,
    )
    axis.fill_between(
        x,
        [row["ci_low"] for row in rows],
        [row["ci_high"] for row in rows],
        color=colour,
        alpha=0.12,
        linewidth=0,
    )


def bands(lines: Mapping[str, Sequence[Row]]) -> str:
    """Draw AUC by SNR band with intervals, a group of points per band; rows of results.csv with
    "low:high".
    """

    def paint(figure: Figure) -> None:
        axis = figure.subplots()
        names = list(dict.fromkeys(str(row["snr_db"]) for rows in lines.values() for row in rows))
        for number, (label, rows) in enumerate(lines.items()):
            x = (
                np.array([names.index(str(row["snr_db"])) for row in rows])
                + (number - len(lines) / 2) * 0.07
            )
            value = np.array([row["value"] for row in rows])
            spread = np.abs(np.array([[row["ci_low"], row["ci_high"]] for row in rows]).T - value)
            style: Any = {
                "color": CYCLE[number % len(CYCLE)],
                "marker": MARKERS[number % len(MARKERS)],
            }
            axis.errorbar(
                x,
                value,
                yerr=spread,
                linestyle="",
                markersize=4,
                elinewidth=1,
                label=label,
                **style,
            )
        axis.axhline(0.5, color=GREY, linestyle="--", linewidth=1)
        axis.set_xticks(range(len(names)), [name.replace(":", " to ") + " dB" for name in names])
        lowest = min([0.5, *(float(row["ci_low"]) for rows in lines.values() for row in rows)])
        axis.set(ylabel="AUC", xlabel="SNR band", ylim=(lowest - 0.04, 1.02))
        handles, labels = axis.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)

    return draw(paint, width=9.2, height=4.4)


def belief(answers: Mapping[str, Answer], sheet: Sheet) -> str:
    """Draw precision-recall and reliability curves of several classifiers on one labelled set."""

    def paint(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        for number, (label, answer) in enumerate(answers.items()):
            reference = sheet.reference[answer.rows]
            precision, recall, _ = metrics.pr_curve(reference, answer.confidence)
            _, mean, observed, _ = metrics.reliability_curve(reference, answer.confidence)
            colour = CYCLE[number % len(CYCLE)]
            left.plot(recall, precision, color=colour, label=label)
            right.plot(
                mean,
                observed,
                color=colour,
                marker=MARKERS[number % len(MARKERS)],
                markersize=4,
                label=label,
            )
        left.axhline(sheet.reference.mean(), color=GREY, linestyle="--", linewidth=1)
        left.set(
            xlabel="recall",
            ylabel="precision",
            ylim=(0, 1.03),
            xlim=(0, 1.01),
            title="precision and recall",
        )
        right.plot([0, 1], [0, 1], color=GREY, linestyle="--", linewidth=1)
        right.set(
            xlabel="mean confidence",
            ylabel="share of reflectors",
            title="reliability",
            xlim=(0, 1),
            ylim=(0, 1),
        )
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4)

    return draw(paint, width=9.2, height=4.4)


def arrival_times(sets: Mapping[str, tuple[Array, Array]]) -> str:
    """Draw what a classifier that knows the TOA alone can learn: true reflectors and others by
    estimated TOA.

    Args:
        sets: title -> estimated TOA in ms, shape (B,), and whether it is a reflector, shape (B,).
    """

    def paint(figure: Figure) -> None:
        axes = figure.subplots(1, len(sets), squeeze=False, sharey=True).ravel()
        low = min(toa.min() for toa, _ in sets.values())
        edges = np.linspace(low, max(toa.max() for toa, _ in sets.values()), 65)
        for axis, (title, (toa, reflector)) in zip(axes, sets.items(), strict=True):
            weight = 1.0 / len(toa)
            both = [toa[reflector], toa[~reflector]]
            labels, colours = ["reflector", "spurious"], [BLUE, "#c9a58d"]
            axis.hist(
                both,
                edges,
                weights=[np.full(len(v), weight) for v in both],
                stacked=True,
                label=labels,
                color=colours,
            )
            axis.set(title=title, xlabel="estimated time of arrival / ms")
        axes[0].set_ylabel("share of observations")
        axes[0].legend(loc="upper right")

    return draw(paint, width=4.6 * len(sets), height=3.0)


def powers(
    panels: Mapping[str, Mapping[str, Sequence[tuple[float, float, float, float]]]],
    *,
    ylabel: str,
    level: bool = False,
) -> str:
    """Draw how something grows with several parameters, in logarithms, a panel per parameter.

    Args:
        panels: parameter -> label -> points (its value, median, lower and upper quartile).
        ylabel: name of what grows.
        level: draw what should stay the same: from zero, not in logarithms.
    """

    def paint(figure: Figure) -> None:
        axes = figure.subplots(1, len(panels), squeeze=False).ravel()
        for axis, (parameter, lines) in zip(axes, panels.items(), strict=True):
            for number, (label, points) in enumerate(lines.items()):
                x, median, low, high = np.array(points).T
                style: Any = {
                    "color": CYCLE[number % len(CYCLE)],
                    "marker": MARKERS[number % len(MARKERS)],
                }
                axis.errorbar(
                    x,
                    median,
                    yerr=[median - low, high - median],
                    markersize=4,
                    label=label,
                    **style,
                )
            ticks = sorted({point[0] for points in lines.values() for point in points})
            axis.set(
                xscale="log",
                xlabel=parameter,
                **({"ylim": (0, None)} if level else {"yscale": "log"}),
            )
            axis.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
            axis.set_xticks([], minor=True)
            axis.legend(loc="best", fontsize=7)
        axes[0].set_ylabel(ylabel)

    return draw(paint, width=4.4 * len(panels), height=3.8)
