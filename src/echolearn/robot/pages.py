"""Pages that open offline: a template of a room, one style for all, figures within the page.

SVG --inline_svg--> markup whose colours follow the page, light or dark, with a text for whoever
cannot see it
"""

import re
from collections.abc import Mapping
from html import escape
from importlib import resources
from string import Template

INKS = {
    "#000000": "currentColor",
    "#ffffff": "var(--card)",
    "#e4e4e4": "var(--line)",
    "#b5b5b5": "var(--faint)",
    "#7f7f7f": "var(--grey)",
    "#9a9a9a": "var(--grey)",
    "#c9a58d": "var(--wood)",
    "#e69f00": "var(--orange)",
    "#56b4e9": "var(--sky)",
    "#009e73": "var(--green)",
    "#0072b2": "var(--blue)",
    "#d55e00": "var(--red)",
    "#cc79a7": "var(--purple)",
}
"""Colours of drawings, and what a page calls them: the style says what they are in the dark."""


def page_head() -> str:
    """Return how every page begins: character set, width of the device, the style."""
    return f"{_template('robot', 'head.html')}<style>{_template('robot', 'style.css')}</style>\n"


def filled_page(room: str, name: str, *, filled: Mapping[str, str]) -> bytes:
    """Return a page.

    Args:
        room: whose template it is.
        name: of the template.
        filled: text of each of its gaps, as HTML.
    """
    return Template(_template(room, name)).substitute(filled, head=page_head()).encode()


def inline_svg(drawing: str, *, name: str, text: str) -> str:
    """Return a drawing as part of a page.

    Args:
        drawing: SVG of our own making.
        name: of the drawing, in letters, digits and `_`; no two on a page share one.
        text: what is seen, for whoever does not see it.
    """
    svg = drawing[drawing.index("<svg") :]
    # A page needs no address of a name space, and a style would hold for the whole page.
    svg = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>|<style.*?</style>", "", svg, flags=re.S)
    svg = re.sub(r'\sxmlns(:\w+)?="[^"]*"', "", svg)
    # Two drawings may name a part alike.
    svg = re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}-", svg)
    svg = re.sub("#[0-9a-f]{6}", lambda found: INKS.get(found[0], found[0]), svg)
    return svg.replace("<svg ", f'<svg role="img" aria-label="{escape(text)}" ', 1)


def _template(room: str, name: str) -> str:
    return (resources.files(f"echolearn.{room}") / "templates" / name).read_text()
