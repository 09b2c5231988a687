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
from echolearn.comparison.looks import GREY, Look, Looks
from echolearn.evaluation.reliability import curve

ACROSS = 4
"""Panels beside each other."""

Answers = dict[str, tuple[Array, Array]]
"""Truth and confidence of some rows, each (B,), by the model's name."""


@figures.styled
def reliability(panels: Mapping[str, Answers], *, looks: Looks) -> str:
    """Draw reliability diagrams, a panel for each title.

    Args:
        panels: what models say, by title.
        looks: of the models.
    """
    rows = -(-len(panels) // ACROSS)
    across = min(ACROSS, len(panels))
    figure, axes = figures.canvas(
        across, rows=rows, width=2.4 * across, height=2.6 * rows + 0.6, sharey=True
    )
    names = list(dict.fromkeys(name for answers in panels.values() for name in answers))
    for axis, (title, answers) in zip(axes, panels.items(), strict=False):
        axis.plot([0, 1], [0, 1], "--", color=GREY, linewidth=1)
        for name in names:
            paint(axis, answers.get(name), label=name, look=looks[name])
        axis.set(title=title, xlim=(0, 1), ylim=(0, 1), aspect="equal")
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    for axis in axes[::across]:
        axis.set_ylabel("share that is true")
    for axis in axes[len(panels) - across :]:
        axis.set_xlabel("mean confidence")
    return figures.as_svg(figure, explained=axes[0])


def paint(axis: Axes, answers: tuple[Array, Array] | None, *, label: str, look: Look) -> None:
    """Draw one model's points; where it says nothing an empty line, for the legend.

    Args:
        axis: where they are drawn.
        answers: truth and confidence, each (B,).
        label: name of the model.
        look: of the model.
    """
    empty = np.empty(0)
    points = curve(*answers) if answers else (empty, empty, empty)
    belief, share, deviation = points
    # Bins are joined by no line: where they lie close, it would be all that is seen.
    style: Any = {"linestyle": "", "markersize": 4, "elinewidth": 0.7, "alpha": 0.8}
    axis.errorbar(belief, share, yerr=2 * deviation, label=label, **style, **look.style)
