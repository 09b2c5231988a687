"""Figures of a comparison that was looked at more closely: ranks, curves, importance, errors."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from echolearn.comparison.choice import Comparison
from echolearn.comparison.examined import BELIEVED, Examined, Picture, learning_curves
from echolearn.comparison.figures import INTERVAL, as_svg, canvas, paint_line, styled
from echolearn.comparison.looks import BLACK, BLUE, GREY, ORANGE, Looks, looks_of
from echolearn.comparison.ranking import Ranking
from echolearn.evaluation import ranks
from echolearn.evaluation.rows import Row, distinct, pick

STROKES = ("-", "--", ":", "-.")
"""Lines of different trainings."""


def draw_examined(examined: Examined, comparison: Comparison) -> dict[str, str]:
    """Return every figure that there is something for, as SVG, by name."""
    found = {}
    looks = looks_of(comparison.models)
    if examined.ranking:
        found["ranks"] = critical_differences(examined.ranking, looks=looks)
    curves = learning_curves(comparison)
    if curves:
        found["learning"] = learning(curves, looks=looks)
    if examined.importance:
        found["importance"] = importances(examined.importance, looks=looks)
    if examined.worst.pictures:
        found["worst"] = errors(examined.worst.pictures)
    return found


@styled
def critical_differences(ranking: Ranking, *, looks: Looks) -> str:
    """Draw mean ranks on a line, best on the left; bars join models that cannot be told apart."""
    count = len(ranking.names)
    groups = ranks.cliques(ranking.ranks, difference=ranking.difference)
    half = -(-count // 2)
    rows = half + 1 + 0.45 * len(groups)
    figure, [axis] = canvas(1, width=7.4, height=0.9 + 0.24 * rows)
    low, high = 1.0, float(count)
    reach = 0.42 * (high - low)
    axis.set(xlim=(low - reach, high + reach), ylim=(-rows, 2.2))
    axis.axis("off")
    axis.plot([low, high], [0, 0], color=BLACK, linewidth=1, marker="")
    for tick in range(1, count + 1):
        axis.plot([tick, tick], [0, 0.25], color=BLACK, linewidth=1, marker="")
        axis.text(tick, 0.35, str(tick), ha="center", va="bottom")
    # The critical difference as a ruler above the line.
    ruler = [low, min(low + ranking.difference, high)]
    axis.plot(ruler, [1.5, 1.5], color=BLACK, linewidth=1.5, marker="|")
    axis.text(ruler[1] + 0.1, 1.5, f"critical difference {ranking.difference:.2f}", va="center")

    for number, group in enumerate(groups):
        ends = ranking.ranks[[group[0], group[-1]]] + [-0.06, 0.06]
        level = -0.45 * (number + 1)
        axis.plot(
            ends, [level, level], color=GREY, linewidth=3.5, marker="", solid_capstyle="round"
        )
    under = 0.45 * len(groups) + 0.8
    for place, (name, rank) in enumerate(zip(ranking.names, ranking.ranks, strict=True)):
        # The better half is named on the left, from above; the others on the right, from below.
        left = place < half
        depth = -under - (place if left else count - 1 - place)
        edge, beside = (low - 0.05, -0.05 * reach) if left else (high + 0.05, 0.05 * reach)
        style: Any = {"color": GREY, "linewidth": 0.8, "marker": ""}
        axis.plot([rank, rank, edge], [0, depth, depth], **style)
        axis.plot([edge], [depth], markersize=5, **looks[name].style)
        text = f"{name}  {rank:.1f}" if left else f"{rank:.1f}  {name}"
        axis.text(edge + beside, depth, text, ha="right" if left else "left", va="center")
    return as_svg(figure)


@styled
def learning(curves: Mapping[str, Sequence[Row]], *, looks: Looks) -> str:
    """Draw AUC against the number of training rows with intervals, a line for each model."""
    figure, [axis] = canvas(1, width=7.4, height=4.2)
    trainings = distinct((rows[0] for rows in curves.values()), "training")
    for label, rows in curves.items():
        # A classifier keeps its look; trainings differ in the stroke.
        stroke = STROKES[trainings.index(rows[0]["training"]) % len(STROKES)]
        style = looks[rows[0]["classifier"]].style
        paint_line(axis, rows, label=label, along="train", linestyle=stroke, **style)
    axis.set_xscale("log")
    ticks = sorted({round(row["train"]) for rows in curves.values() for row in rows})
    axis.set_xticks(ticks, [str(tick) for tick in ticks])
    axis.minorticks_off()
    axis.set(xlabel="rows trained on", ylabel="AUC")
    return as_svg(figure, explained=axis, columns=2)


@styled
def importances(rows: Sequence[Row], *, looks: Looks) -> str:
    """Draw what the AUC loses without each column, a panel for each model, with intervals."""
    names = distinct(rows, "classifier")
    columns = distinct(sorted(rows, key=lambda row: -float(row["value"])), "column")[::-1]
    height = 0.9 + 0.24 * len(columns)
    figure, axes = canvas(len(names), width=max(7.4, 2.6 * len(names)), height=height, sharey=True)
    for axis, name in zip(axes, names, strict=True):
        for row in pick(rows, classifier=name):
            value, low, high = (float(row[key]) for key in INTERVAL)
            place = columns.index(row["column"])
            axis.barh(place, value, color=looks[name].colour, height=0.6, alpha=0.7)
            axis.plot([low, high], [place, place], color=BLACK, linewidth=1, marker="")
        axis.axvline(0, color=GREY, linewidth=0.8)
        axis.set(title=name, xlabel="loss of AUC", axisbelow=True)
        # Labels of more ticks would touch those of the next panel.
        axis.xaxis.set_major_locator(MaxNLocator(3))
        axis.grid(visible=False, axis="y")
    axes[0].set_yticks(range(len(columns)), columns)
    return as_svg(figure)


@styled
def errors(pictures: Sequence[Picture]) -> str:
    """Draw J(tau, phi) of each error, with the echo that was chosen and the true ones."""
    across = 3 if len(pictures) > 2 else len(pictures)
    down = -(-len(pictures) // across)
    figure, axes = canvas(across, rows=down, width=2.9 * across, height=2.7 * down + 0.6)
    for axis in axes[len(pictures) :]:
        axis.axis("off")
    for axis, picture in zip(axes, pictures, strict=False):
        paint_picture(axis, picture)
    return as_svg(figure, explained=axes[0], columns=2)


def paint_picture(axis: Axes, picture: Picture) -> None:
    """Draw one J(tau, phi): distance across, direction up."""
    row = picture.row
    degrees = np.degrees(picture.azimuths)
    distances = picture.distances
    ends = (distances[0], distances[-1], degrees[0], degrees[-1])
    style: Any = {"aspect": "auto", "origin": "lower", "extent": ends}
    axis.imshow(np.maximum(picture.response, 0.0), cmap="Greys", **style)
    scale = picture.speed_of_sound / 2
    truth: Any = {"color": ORANGE, "marker": "o", "markersize": 9, "fillstyle": "none"}
    estimate: Any = {"color": BLUE, "marker": "x", "markersize": 8, "markeredgewidth": 2}
    walls = scale * picture.truth.toa, np.degrees(picture.truth.azimuth)
    axis.plot(*walls, linestyle="", markeredgewidth=1.5, label="true echo", **truth)
    chosen = [scale * row["toa"]], [np.degrees(row["azimuth"])]
    axis.plot(*chosen, linestyle="", label="estimate", **estimate)
    axis.set(xlim=ends[:2], ylim=ends[2:], xlabel="distance / m", ylabel="azimuth / degrees")
    axis.grid(visible=False)
    said = "spurious, believed" if row["error"] == BELIEVED else "true, not believed"
    title = f"row {row['row']}: {said} {row['confidence']:.2f}\nSNR {row['snr_db']:.0f} dB"
    axis.set_title(title, fontsize=8)
