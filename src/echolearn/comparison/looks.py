"""How a classifier looks: one colour and one marker in every figure, legend and table of a report.

Colours are those of Okabe and Ito, told apart by colour-blind readers; who shares a colour differs
in the marker.
"""

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from echolearn.evaluation.rows import Model
from echolearn.robot.pages import INKS

BLACK, ORANGE, SKY, GREEN, BLUE, RED, PURPLE, GREY = (
    "#000000", "#e69f00", "#56b4e9", "#009e73", "#0072b2", "#d55e00", "#cc79a7", "#7f7f7f"
)  # fmt: skip
CYCLE = (BLUE, RED, GREEN, ORANGE, PURPLE, SKY, BLACK, GREY)
MARKERS = "osD^vP*Xhd<>"
GLYPHS = "●■◆▲▼✚★✖⬢♦◀▶"
"""The same markers as text."""


class Look(NamedTuple):
    """Colour and marker of a classifier.

    Attributes:
        colour: as matplotlib and SVG take it.
        marker: as matplotlib takes it.
    """

    colour: str
    marker: str

    @property
    def style(self) -> dict[str, Any]:
        """Keywords of matplotlib's lines."""
        return {"color": self.colour, "marker": self.marker}

    @property
    def ink(self) -> str:
        """Colour on a page, which differs in the dark."""
        return INKS[self.colour]

    @property
    def glyph(self) -> str:
        """Marker as text."""
        return GLYPHS[MARKERS.index(self.marker)]


Looks = Mapping[str, Look]


def looks(names: Iterable[str]) -> Looks:
    """Return a look for each name, by their alphabet; no two alike among the first 24."""
    found = {}
    for number, name in enumerate(sorted({*names})):
        found[name] = Look(CYCLE[number % len(CYCLE)], MARKERS[number % len(MARKERS)])
    return found


def looks_of(models: Iterable[Model]) -> Looks:
    """Return the look of each classifier of a comparison."""
    return looks(model.classifier for model in models)


def plain_looks(names: Iterable[str]) -> Looks:
    """Return looks for what is no classifier, in the order of the names: no colour is lent."""
    return {name: Look((BLACK, GREY)[n % 2], MARKERS[n]) for n, name in enumerate(names)}
