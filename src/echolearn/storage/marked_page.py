"""Text that commands write into people's pages, between two markers; all the rest stays.

Pages and the figures beside them lie among other files of people's own: of what killed commands
have left there, only that goes which belongs to the file that is written.
"""

from glob import escape
from pathlib import Path
from typing import NamedTuple

from echolearn.checks import BadValue, check
from echolearn.storage import files
from echolearn.storage.once import locked


class Markers(NamedTuple):
    """Two lines of a page, each there once; what stands between them is replaced.

    Attributes:
        begin: first line.
        end: last line.
        name: key that names the page, for errors.
    """

    begin: str
    end: str
    name: str


def around(page: Path, markers: Markers) -> tuple[str, str]:
    """Return what stands before and after the text between two markers, the markers included.

    Raises:
        BadValue: the file cannot be read, or has not each marker once, in this order.
    """
    begin, end, name = markers
    try:
        text = Path(page).read_bytes().decode()
    except (OSError, ValueError) as error:
        raise BadValue(f"{name}={page}: cannot be read ({files.one_line(error)})") from None
    before, _, rest = text.partition(begin)
    _, _, after = rest.partition(end)
    once = text.count(begin) == text.count(end) == rest.count(end) == 1
    check(once, name, page, allowed=f"must be a file with one {begin} and then one {end}")
    return before + begin, end + after


def write_between(page: Path, text: str, *, markers: Markers) -> None:
    """Replace the text between the markers of a page, atomically, one command after another.

    Args:
        page: file that somebody wrote.
        text: lines that belong between the markers.
        markers: the two lines around it.

    Raises:
        BadValue: as `around` does.
    """
    around(page, markers)
    with locked(page):
        # Another command may have written to the page meanwhile.
        before, after = around(page, markers)
        _replace(Path(page), f"{before}\n{text}\n{after}".encode())


def write_beside(path: Path, content: bytes) -> None:
    """Write a file that a page shows, atomically, one command after another."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with locked(path):
        _replace(path, content)


def _replace(path: Path, content: bytes) -> None:
    files.clean(path.parent, escape(path.name))
    files.write_atomic(path, content)
