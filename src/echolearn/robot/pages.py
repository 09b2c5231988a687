"""Pages that open offline: a template of a room, and the head that all of them have."""

from collections.abc import Mapping
from importlib import resources
from string import Template


def filled_page(room: str, name: str, *, filled: Mapping[str, str]) -> bytes:
    """Return a page.

    Args:
        room: whose template it is.
        name: of the template.
        filled: text of each of its gaps, as HTML.
    """
    head = _template("robot", "head.html")
    return Template(_template(room, name)).substitute(filled, head=head).encode()


def _template(room: str, name: str) -> str:
    return (resources.files(f"echolearn.{room}") / "templates" / name).read_text()
