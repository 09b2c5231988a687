"""What a study found: a tidy table, a table in per cent, figures in the paper's layout."""

from collections.abc import Sequence
from typing import Any

from matplotlib.axes import Axes
from matplotlib.transforms import offset_copy

from echolearn.comparison.figures import INTERVAL, as_svg, canvas, paint_intervals, styled
from echolearn.comparison.looks import CYCLE, GREY, MARKERS
from echolearn.comparison.template import template
from echolearn.evaluation.rows import Row, distinct, pick, to_csv
from echolearn.studies.study import NAMED

FORMAT = 6
"""Version of the files; part of a study's identity."""

COLOURS = CYCLE[:-1]  # grey is chance's

AXIS = {
    "snr_db": "SNR / dB",
    "sdnr_db": "SDNR / dB",
    "t60": "reverberation time / s",
    "fault": "fault of the array",
    "pings": "pings averaged",
    "stretch": "stretch of noise",
    "array": "array",
}
SEPARATE = ("fault", "stretch", "array")
"""What has nothing between one value and the next: no line joins them."""

TITLES = {
    "toa": "time of arrival within 5 samples",
    "doa": "direction of the matched wall within 5 degrees",
    "on_map": "map point within 0.10 m of a wall",
    "doa_any": "DOA within 5 degrees of any wall",
}
FIGURES = {"toa_doa": ("toa", "doa"), "map": ("on_map", "doa_any")}


def study_files(name: str, *, vary: str, rows: Sequence[Row]) -> dict[str, bytes]:
    """Return the files of a study by name: `study.csv`, `study.md` and the figures.

    Args:
        name: of the study.
        vary: what was varied.
        rows: those of `study.csv`.
    """
    table = template("study.md", room="studies").render(
        name=name,
        rows=rows,
        values=distinct(rows, vary),
        localizers=distinct(rows, "localizer"),
        titles=TITLES,
        axis=AXIS[vary],
    )
    files = {"study.csv": to_csv(rows, columns(vary)), "study.md": table.encode()}
    for figure, metrics in FIGURES.items():
        files[f"figures/{figure}.svg"] = draw_metrics(metrics, vary=vary, rows=rows).encode()
    return files


def columns(vary: str) -> list[str]:
    """Return the columns of `study.csv`."""
    remark = ["remark"] if vary == "array" else []
    return ["localizer", vary, "metric", *INTERVAL, "n", *remark]


@styled
def draw_metrics(metrics: Sequence[str], *, vary: str, rows: Sequence[Row]) -> str:
    """Draw metrics side by side, a line per localizer with its interval; chance is dashed.

    Args:
        metrics: a panel for each.
        vary: what was varied.
        rows: those of `study.csv`.
    """
    figure, axes = canvas(len(metrics), width=9.2, height=4.4, sharey=True)
    for letter, axis, metric in zip("ab", axes, metrics, strict=True):
        paint_metric(axis, vary=vary, rows=pick(rows, metric=metric))
        axis.set(title=f"{letter}) {TITLES[metric]}", xlabel=AXIS[vary], ylim=(-0.02, 1.03))
    axes[0].set_ylabel("share of recordings")
    return as_svg(figure, explained=axes[0], columns=5)


def paint_metric(axis: Axes, *, vary: str, rows: Sequence[Row]) -> None:
    """Draw one metric of every localizer with its intervals.

    Args:
        axis: where.
        vary: what was varied.
        rows: those of the metric; those of chance come last.
    """
    values = distinct(rows, vary)
    x = range(len(values)) if vary in NAMED else values
    names = distinct(rows, "localizer")
    # Shifted lines set no limits of the axis, so an invisible one does.
    axis.plot(x, [0] * len(values), " ")
    for number, name in enumerate(names):
        style = line_style(number) if number < len(names) - 1 else CHANCE_STYLE
        if vary in SEPARATE:
            style = style | {"linestyle": "none", "marker": style["marker"] or "_"}
        # Equal shares stand side by side, a point (1/72 inch) apart.
        aside = number - (len(names) - 1) / 2
        place = offset_copy(axis.transData, axis.get_figure(root=True), x=aside, units="points")
        paint_intervals(
            axis, x, rows=pick(rows, localizer=name), label=name, transform=place, **style
        )
    if vary == "pings":
        axis.set_xscale("log", base=2)
    if vary == "pings" or vary in NAMED:
        axis.set_xticks(x, [str(value).replace("_", " ") for value in values])


CHANCE_STYLE: dict[str, Any] = {"color": GREY, "linestyle": "--", "marker": "", "elinewidth": 0.7}


def line_style(number: int) -> dict[str, Any]:
    """Return the style of a localizer's line."""
    return {
        "color": COLOURS[number % len(COLOURS)],
        "marker": MARKERS[number % len(MARKERS)],
        "markerfacecolor": "none",
        # Shrinking sizes: where localizers find the same, each shows inside the one before.
        "markersize": 3.0 + 5.5 * 0.8**number,
        "linewidth": 1.0 + 1.8 * 0.7**number,
        "elinewidth": 0.7,
    }
