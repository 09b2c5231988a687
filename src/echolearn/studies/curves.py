"""What a study found, to read and to look at: a tidy table, figures in the paper's layout, a table
in words.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from echolearn.acoustics.types import Array
from echolearn.comparison.compare import to_csv
from echolearn.comparison.figures import CYCLE, GREY, MARKERS, draw

FORMAT = 5
"""Version of the files; part of a study's identity."""

COLOURS = CYCLE[:-1]  # grey is chance's
STROKES: Sequence[Any] = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
"""Of lines, as many as have no divisor in common with the colours: 28 lines differ."""

READABLE = 6
"""Columns of a table up to which each share has its interval beside it."""

Row = dict[str, Any]

AXIS = {
    "snr_db": "SNR / dB",
    "sdnr_db": "SDNR / dB",
    "t60": "reverberation time / s",
    "fault": "fault of the array",
    "pings": "pings averaged",
    "stretch": "stretch of noise",
}
APART = ("fault", "stretch")
"""What has nothing between one value and the next: no line joins them."""
PANELS = {
    "toa_doa": {
        "toa": "a) time of arrival within 5 samples",
        "doa": "b) direction of the matched wall within 5 degrees",
    },
    "map": {
        "on_map": "a) map point within 0.10 m of a wall",
        "doa_any": "b) DOA within 5 degrees of any wall",
    },
}


def make(name: str, vary: str, rows: Sequence[Row]) -> dict[str, bytes]:
    """Return the files of a study by name: `study.csv`, `study.md` and the figures."""
    columns = ["localizer", vary, "metric", "value", "ci_low", "ci_high", "n"]
    files = {"study.csv": to_csv(rows, columns), "study.md": table(name, vary, rows).encode()}
    return files | {
        f"figures/{figure}.svg": draw_panels(vary, rows, panels).encode()
        for figure, panels in PANELS.items()
    }


def table(name: str, vary: str, rows: Sequence[Row]) -> str:
    """Return the shares in per cent, a line per localizer and a column per value, for each metric.

    A few columns have their intervals; of many, the text says how far these reach.
    """
    values = list(dict.fromkeys(row[vary] for row in rows))
    few = len(values) <= READABLE
    text = [f"# Study {name}: share of recordings in %, n = {rows[0]['n']} at each value"]
    for metric, title in {**PANELS["toa_doa"], **PANELS["map"]}.items():
        text += ["", f"**{title.split(') ')[-1]}**, by {AXIS[vary]}", ""]
        text += [f"| | {' | '.join(map(str, values))} |", "|---" * (len(values) + 1) + "|"]
        for localizer in dict.fromkeys(row["localizer"] for row in rows):
            found = [
                row for row in rows if row["localizer"] == localizer and row["metric"] == metric
            ]
            text.append(
                f"| {localizer} | {' | '.join(in_words(row, interval=few) for row in found)} |"
            )
    reach = max(max(row["value"] - row["ci_low"], row["ci_high"] - row["value"]) for row in rows)
    brackets = (
        "stand in brackets" if few else f"reach at most {100 * reach:.0f} points to either side"
    )
    return "\n".join([*text, "", f"95 % intervals (bootstrap over positions) {brackets}."]) + "\n"


def in_words(row: Row, *, interval: bool) -> str:
    """Return a share in per cent, with its interval if asked for."""
    value, low, high = (f"{100 * row[key]:.0f}" for key in ("value", "ci_low", "ci_high"))
    return f"{value} [{low}, {high}]" if interval else value


def draw_panels(vary: str, rows: Sequence[Row], panels: Mapping[str, str]) -> str:
    """Draw metrics side by side, a line per localizer with its interval; chance is dashed."""

    def paint(figure: Figure) -> None:
        axes = figure.subplots(1, len(panels), squeeze=False, sharey=True).ravel()
        for axis, (metric, title) in zip(axes, panels.items(), strict=True):
            paint_metric(axis, vary, [row for row in rows if row["metric"] == metric])
            axis.set(title=title, xlabel=AXIS[vary], ylim=(-0.02, 1.03))
        axes[0].set_ylabel("share of recordings")
        handles, labels = axes[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)

    return draw(paint, width=9.2, height=4.4)


def paint_metric(axis: Axes, vary: str, rows: Sequence[Row]) -> None:
    """Draw one metric of every localizer."""
    values = list(dict.fromkeys(row[vary] for row in rows))
    names = list(dict.fromkeys(row["localizer"] for row in rows))
    known = [name for name in names if name != "chance"]
    for name in names:
        found = [row for row in rows if row["localizer"] == name]
        number = known.index(name) if name in known else None
        x = dodged(vary, values, number=number, count=len(known))
        paint_line(axis, name, found, x=x, number=number, apart=vary in APART)
    if vary == "pings":
        axis.set_xscale("log", base=2)
        axis.set_xticks(values, [str(value) for value in values])
    if vary == "fault":
        axis.set_xticks(range(len(values)), [str(value).replace("_", " ") for value in values])


def paint_line(
    axis: Axes, name: str, rows: Sequence[Row], *, x: Array, number: int | None, apart: bool
) -> None:
    """Draw one localizer with its interval as a band, or with bars if values stand `apart`; number
    None is chance.
    """
    style: Any = {"color": GREY, "linestyle": "--"}
    if number is not None:
        style = {
            "color": COLOURS[number % len(COLOURS)],
            "linestyle": STROKES[number % len(STROKES)],
        }
        style |= {"marker": MARKERS[number % len(MARKERS)], "markerfacecolor": "none"}
        style |= {
            "markersize": 3.0 + 5.5 * 0.8**number,
            "linewidth": 1.0 + 1.8 * 0.7**number,
        }  # equal ones nest
    value, low, high = (
        np.array([row[key] for row in rows]) for key in ("value", "ci_low", "ci_high")
    )
    if apart and number is not None:
        style["linestyle"] = "none"
        axis.errorbar(
            x, value, yerr=np.abs([low - value, high - value]), label=name, elinewidth=1, **style
        )
        return
    axis.plot(x, value, label=name, **style)
    axis.fill_between(x, low, high, color=style["color"], alpha=0.08, linewidth=0)


def dodged(vary: str, values: Sequence[Any], *, number: int | None, count: int) -> Array:
    """Return where a localizer's points stand along the axis: beside those of the others, nearer
    than the next value.

    Args:
        vary: `pings` has a logarithmic axis.
        values: V, ascending; faults stand at 0, 1, 2 ...
        number: of the localizer; None is chance, which stands at the values themselves.
        count: localizers.
    """
    place = np.arange(len(values)) if vary == "fault" else np.array(values, dtype=float)
    along = np.log2(place) if vary == "pings" else place.astype(float)
    if number is not None and len(values) > 1:
        widest = np.inf if vary in APART else 0.007 * np.ptp(along)
        step = min(0.7 * np.diff(along).min() / count, widest)
        along = along + (number - (count - 1) / 2) * step
    return np.exp2(along) if vary == "pings" else along


def show(folder: Path) -> None:
    """Print a study's table, and where its figures are."""
    print((folder / "study.md").read_text(), flush=True)
    for path in sorted((folder / "figures").glob("*.svg")):
        print(path, flush=True)
