"""Pages of people: what killed commands have left there goes, and nothing of anybody else's."""

import signal
import subprocess
import sys

import pytest

from echolearn.storage.marked_page import Markers, write_beside, write_between

MARKERS = Markers("<!-- begin -->", "<!-- end -->", "page")
PAGE = "# Mine\n<!-- begin -->\nold\n<!-- end -->\n"
NEW = "# Mine\n<!-- begin -->\nnew\n<!-- end -->\n"

SLOW = """
import sys, time
from pathlib import Path
from echolearn.storage.files import write_atomic

write_atomic(Path(sys.argv[1]), lambda file: (print(flush=True), time.sleep(60)))
"""


def killed_while_writing(path):
    """Leave what a command leaves that is killed while it writes a file."""
    with subprocess.Popen([sys.executable, "-c", SLOW, path], stdout=subprocess.PIPE) as writer:
        assert writer.stdout.readline()
        writer.send_signal(signal.SIGKILL)


@pytest.mark.parametrize(
    "write",
    [
        lambda page: write_between(page, "new", markers=MARKERS),
        lambda page: write_beside(page, NEW.encode()),
    ],
)
def test_what_a_killed_command_left_of_a_page_goes(tmp_path, write):
    page = tmp_path / "[my] page.md"
    page.write_text(PAGE)
    killed_while_writing(page)
    (tmp_path / f".{page.name}.lock").touch()
    assert len(list(tmp_path.iterdir())) == 3
    # All of these are somebody else's.
    others = {".m page.md.0123456789ab.tmp", ".my notes.tmp", f".{page.name}.mine.tmp", ".a.lock"}
    for name in others:
        (tmp_path / name).touch()
    write(page)
    assert {path.name for path in tmp_path.iterdir()} == {page.name, *others}
    assert page.read_text() == NEW
