"""Text that commands write into people's pages, between two markers; all the rest stays."""

from pathlib import Path
from typing import NamedTuple

from echolearn.checks import BadValue, check
from echolearn.storage import files
from echolearn.storage.once import locked


class Markers(NamedTuple):
    """Two lines of a page, each there once; what stands between them is replaced.

    Attributes:
        begin, end: the lines.
        name: of the key that names the page, for errors.
    """

    begin: str
    end: str
    name: str


def around(page: Path, markers: Markers) -> tuple[str, str]:
    """Return what stands before and after the replaceable text of a page, its two markers included.

    Raises:
        BadValue: the file cannot be read, or has not each marker once, in this order.
    """
    begin, end, name = markers
    try:
        text = Path(page).read_bytes().decode()
    except (OSError, ValueError) as error:
        raise BadValue(f"{name}={page}: cannot be read ({files.one_line(error)})") from None
    before, *between = text.split(begin)
    rest = between[0].split(end) if len(between) == 1 else []
    check(
        len(rest) == 2 and end not in before,
        name,
        page,
        allowed=f"a file with one {begin} and then one {end}",
    )
    return before + begin, end + rest[1]


def between(page: Path, markers: Markers) -> str:
    """Return the replaceable text of a page; see `around` for errors."""
    before, after = around(page, markers)
    return Path(page).read_bytes().decode()[len(before) : -len(after)]


def write_between(page: Path, text: str, markers: Markers) -> None:
    """Put `text` between the markers of a page, atomically, one command after another; see `around`
    for errors.
    """
    around(page, markers)
    with locked(page):
        before, after = around(page, markers)
        files.write_atomic(Path(page), f"{before}\n{text}\n{after}".encode())
