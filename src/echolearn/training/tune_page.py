"""What a search has found, as a page and as an experiment that `train` takes.

FoundSettings --history, importance, slices--> tune.html, one file, offline
--best--> experiment/<name>.yaml: echolearn train experiment=<name> --config-dir=<folder>
"""

import json
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from io import StringIO
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from echolearn.robot.pages import filled_page, inline_svg
from echolearn.training.search_space import Choices, Range, Space

TEMPLATE = "tune.html"

BLUE, GREY, RED = "#0072b2", "#9a9a9a", "#d55e00"

STYLE: Any = {"svg.hashsalt": "echolearn", "svg.fonttype": "path", "font.size": 9}

Tried = tuple[int, str, float | None, Mapping[str, Any]]
"""Number, state, value if any, and parameters of a trial, a list or mapping as JSON."""


@dataclass(frozen=True)
class FoundSettings:
    """A search that is done.

    Attributes:
        name: of its folder and of the experiment.
        classifier: whose settings were sought.
        metric: figure on validation rows that was to be large.
        space: what was tried.
        trials: all of them, in order; one at least has a value.
        importance: share of the value's variation that each key explains; empty if unknown.
        command: what continues the search.
    """

    name: str
    classifier: str
    metric: str
    space: Space
    trials: Sequence[Tried]
    importance: Mapping[str, float]
    command: str

    @property
    def completed(self) -> list[tuple[int, float, Mapping[str, Any]]]:
        """Number, value and parameters of the trials that have a value."""
        return [(n, value, params) for n, _, value, params in self.trials if value is not None]

    @property
    def best(self) -> tuple[int, float, Mapping[str, Any]]:
        """Number, value and parameters of the trial of the largest value, the first of equals."""
        return max(self.completed, key=lambda each: (each[1], -each[0]))

    def values(self) -> dict[str, Any]:
        """Return the best settings, as a configuration has them."""
        found: dict[str, Any] = {}
        for key, value in self.best[2].items():
            each = self.space[key]
            if isinstance(each, Choices):
                found[key] = json.loads(value)
            else:
                found[key] = [value] if each.listed else value
        return found

    def edges(self) -> list[str]:
        """Return a line on each key whose best value lies at the edge of its range."""
        lines = []
        for key, value in self.best[2].items():
            each = self.space[key]
            if isinstance(each, Range) and each.at_edge(value):
                between = f"[{each.low}, {each.high}]"
                lines.append(f"{key}={value:.4g}: the best lies at the edge of {between}; widen it")
        return lines


def experiment(search: FoundSettings) -> str:
    """Return the YAML file of the best settings."""
    number, value, _ = search.best
    figure = f"{search.metric} {value:.4f} on validation rows"
    lines = [
        "# @package _global_",
        f"# Trial {number} of {len(search.trials)}: {figure},",
        f"# by {search.command}",
        "defaults:",
        f"  - override /classifier: {search.classifier}",
        "",
        f"name: {json.dumps(search.name)}",
        "classifier:",
    ]
    nested: dict[str, Any] = {}
    for key, each in search.values().items():
        *groups, last = key.split(".")
        place = nested
        for group in groups:
            place = place.setdefault(group, {})
        place[last] = each
    # JSON on one line is YAML, whatever stands in it.
    lines += [f"  {key}: {json.dumps(each)}" for key, each in nested.items()]
    return "\n".join(lines) + "\n"


def tune_page(search: FoundSettings) -> bytes:
    """Return the page."""
    number, value, _ = search.best
    states = [state for _, state, _, _ in search.trials]
    counts = ", ".join(f"{states.count(each)} {each}" for each in dict.fromkeys(states))
    words = ["echolearn", "train", f"experiment={search.name}", "--config-dir=<this folder>"]
    best = [f"{key}: {json.dumps(each)}" for key, each in search.values().items()]
    filled = {
        "title": escape(search.name),
        "lead": escape(
            f"{search.metric} {value:.4f} on validation rows, by trial {number} of "
            f"{len(states)} ({counts}). The best of many is too good: only rows that the search "
            "has not seen tell what it is worth."
        ),
        "best": _items(best),
        "train": escape(shlex.join(words).replace("'", "")),
        "edges": _items(search.edges() or ["No best value lies at the edge of its range."]),
        "history": _drawn(_history, search, title="Value of each trial and the best so far"),
        "importance": _drawn(_importance, search, title="How much each setting matters"),
        "slices": _drawn(_slices, search, title="Value against each setting"),
        "rows": _rows(search),
        "keys": "".join(f"<th>{escape(key)}</th>" for key in search.space),
    }
    return filled_page("training", TEMPLATE, filled=filled)


def _items(lines: Sequence[str]) -> str:
    return "".join(f"<li>{escape(line)}</li>" for line in lines)


def _rows(search: FoundSettings) -> str:
    """Return the trials as rows of a table, the best first."""
    order = sorted(search.trials, key=lambda each: (each[2] is None, -(each[2] or 0), each[0]))
    rows = []
    for number, state, value, params in order:
        shown = [str(number), state, "" if value is None else f"{value:.4f}"]
        shown += [_short(params.get(key, "")) for key in search.space]
        rows.append("<tr>" + "".join(f"<td>{escape(each)}</td>" for each in shown) + "</tr>")
    return "\n".join(rows)


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _drawn(
    draw: Callable[[FoundSettings], Figure | None], search: FoundSettings, *, title: str
) -> str:
    """Return a figure as SVG with a title that is read aloud, or why there is none.

    Args:
        draw: draws it.
        search: what is shown.
        title: what it shows, in words.
    """
    with mpl.rc_context(STYLE):
        figure = draw(search)
        if figure is None:
            return '<p class="soft">Not known after so few trials.</p>'
        text = StringIO()
        # A date or a version would give the same search other bytes.
        figure.savefig(text, format="svg", metadata={"Date": None, "Creator": None})
    return inline_svg(text.getvalue(), name=title.replace(" ", "_"), text=title)


def _history(search: FoundSettings) -> Figure:
    figure = Figure(figsize=(7, 3), layout="constrained")
    axes = figure.subplots()
    number, value, _ = zip(*search.completed, strict=True)
    axes.plot(number, value, "o", color=GREY, markersize=4, label="trial")
    axes.step(number, np.maximum.accumulate(value), where="post", color=BLUE, label="best so far")
    stopped = [n for n, state, _, _ in search.trials if state != "complete"]
    if stopped:
        low = min(value)
        axes.plot(stopped, [low] * len(stopped), "x", color=RED, label="stopped or failed")
    axes.set(xlabel="trial", ylabel=search.metric)
    axes.legend(frameon=False)
    return figure


def _importance(search: FoundSettings) -> Figure | None:
    if not search.importance:
        return None
    keys = sorted(search.importance, key=lambda key: search.importance[key])
    figure = Figure(figsize=(7, 0.5 + 0.32 * len(keys)), layout="constrained")
    axes = figure.subplots()
    axes.barh(keys, [search.importance[key] for key in keys], color=BLUE)
    axes.set(xlabel="share of the variation explained", xlim=(0, 1))
    return figure


def _slices(search: FoundSettings) -> Figure:
    columns = 3
    rows = -(-len(search.space) // columns)
    figure = Figure(figsize=(7, 2.1 * rows), layout="constrained")
    panels: list[Axes] = figure.subplots(rows, columns, squeeze=False, sharey=True).ravel().tolist()
    for axes, (key, each) in zip(panels, search.space.items(), strict=False):
        known = [(params[key], value) for _, value, params in search.completed if key in params]
        tried, value = zip(*known, strict=True)
        axes.plot(tried, value, "o", color=BLUE, markersize=3, alpha=0.7)
        axes.set_title(key, fontsize=9)
        if isinstance(each, Range) and each.log:
            axes.set_xscale("log")
        elif isinstance(each, Choices):
            axes.tick_params(axis="x", rotation=60)
    for axes in panels[len(search.space) :]:
        axes.set_visible(False)
    panels[0].set_ylabel(search.metric)
    return figure
