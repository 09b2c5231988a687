"""Rows of `poses.csv` from standard input: the line protocol.

    index,x_m,y_m,z_m,heading_rad,file      a row, as `poses.csv` has it
    file                                    the same at the last pose that odometry told

A row goes to the survey's `poses.csv`, and from there into the map like any other, so that a killed
command loses none, and the survey is whole at the end. Numbers must grow: a line that was sent
twice is told from a new one without remembering all.
"""

import os
import select
from collections.abc import Callable
from io import StringIO
from pathlib import Path

from echolearn.acoustics.types import Pose
from echolearn.checks import BadValue, check
from echolearn.storage.files import unwritable
from echolearn.survey.poses import CELLS, row_cells

READ = 1 << 16
"""Bytes that are read at once; a longer line is none."""


class LineInput:
    """Lines of a file descriptor.

    Attributes:
        ended: whether no more come.
    """

    def __init__(
        self, path: Path, *, descriptor: int = 0, odometry: Callable[[], Pose | None] | None = None
    ) -> None:
        """Open it.

        Args:
            path: of the table that the rows go to.
            descriptor: where lines come from.
            odometry: returns the last pose that is known; None where nothing tells it.
        """
        self.ended = False
        self._path = path
        self._from = descriptor
        self._odometry = odometry
        self._rest = b""
        self._last = -1
        self._heading = self._opened()

    def wait(self, seconds: float) -> list[BadValue]:
        """Wait for lines at most so long, append their rows, and return what is wrong with some."""
        if not select.select([self._from], [], [], seconds)[0]:
            return []
        read = os.read(self._from, READ)
        *lines, self._rest = (self._rest + read).split(b"\n")
        if not read:
            # The last line may lack its end.
            lines.append(self._rest)
            self.ended = True
        wrong = []
        if len(self._rest) > READ:
            wrong.append(BadValue(f"line={len(self._rest)} bytes: must be shorter"))
            self._rest = b""
        for line in lines:
            try:
                self._take(line.decode("utf-8", "replace").strip())
            except BadValue as error:
                wrong.append(error)
        return wrong

    def _opened(self) -> str:
        """Return the heading of the table, written if there is none, and cut off half a row."""
        try:
            self._path.touch()
            with self._path.open("r+b") as file:
                content = file.read()
                whole = content.rfind(b"\n") + 1
                file.truncate(whole)
                text = content[:whole].decode("utf-8-sig", "replace")
                if not text:
                    text = ",".join(CELLS) + "\n"
                    file.seek(0)
                    file.write(text.encode())
        except OSError as error:
            raise unwritable(self._path, error) from error
        for cells in row_cells(self._path, StringIO(text)):
            self._last = max(self._last, cells["index"])
        return text.splitlines(keepends=True)[0]

    def _take(self, line: str) -> None:
        """Append the row of a line, if it holds one."""
        if not line or line.startswith("#"):
            return
        if "," not in line:
            line = self._placed(line)
        for cells in row_cells(Path("line"), StringIO(f"{self._heading}{line}\n")):
            index = cells["index"]
            allowed = f"must be more than the last, {self._last}"
            hint = "was the line sent twice?"
            check(index > self._last, "line index", index, allowed=allowed, hint=hint)
            with self._path.open("ab", buffering=0) as file:
                file.write(f"{line}\n".encode())
            self._last = index

    def _placed(self, name: str) -> str:
        """Return the row of a recording at the last pose that odometry told."""
        pose = self._odometry() if self._odometry else None
        if pose is None:
            hint = f"a row is {','.join(CELLS)}; a name alone needs dds= and odometry"
            raise BadValue(f"line={name!a:.80}: must tell where it was recorded; {hint}")
        known = dict(zip(CELLS, [self._last + 1, *pose.position, pose.heading, name], strict=True))
        columns = self._heading.strip().split(",")
        return ",".join(str(known.get(column.strip(), "")) for column in columns)
