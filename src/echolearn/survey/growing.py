"""A survey that is still being recorded: its rows and recordings, each when it is whole.

    poses.csv grows --read--> rows --survey_at--> surveys of one pose each

A row is whole with the end of its line. A recording that cannot be read may be half written: it is
tried again when its file has changed, and left out when it has stayed as it is for `PATIENCE`. One
that is not there yet is waited for. Rows stand in memory only while they wait, and no more are read
ahead than `AHEAD`.
"""

import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any

from echolearn.checks import BadValue, check
from echolearn.survey.audio import check_size
from echolearn.survey.poses import LARGEST_CSV, poses_of, row_cells
from echolearn.survey.reader import with_poses
from echolearn.survey.survey import Survey

PATIENCE = 2.0
"""Seconds for which a broken recording may stay as it is before it is left out."""

AHEAD = 4096
"""Rows that wait for their recordings, at most."""

CHUNK = 1 << 13
"""Bytes of `poses.csv` that are read at once; no row is longer."""

BESIDE = ("emitted", "noise_statistics", "calibration_recorded")
"""What is read or computed once for all poses of a survey, whatever is mended in them."""


@dataclass
class Waiting:
    """A row whose recording is not mapped yet.

    Attributes:
        cells: of the row, by column.
        state: size and time of its file when it was last tried; None if it was not there.
        since: when that was first so, in s.
        error: what was wrong with it.
        told: whether it was told that its file is not there.
    """

    cells: Mapping[str, Any]
    state: tuple[int, int] | None = None
    since: float = field(default_factory=time.monotonic)
    error: BadValue = field(default_factory=lambda: BadValue("not tried"))
    told: bool = False


@dataclass
class GrowingSurvey:
    """The rows of a growing `poses.csv`.

    Attributes:
        described: the survey, without poses.
        heading: text above the rows, with the names of the columns.
        place: bytes that were read.
        rows: rows that were read, the heading among them.
        waiting: rows whose recordings are not mapped yet, at most `AHEAD`.
    """

    described: Survey
    heading: str = ""
    place: int = 0
    rows: int = 0
    waiting: deque[Waiting] = field(default_factory=deque)

    @property
    def path(self) -> Path:
        """Its table."""
        return self.described.folder / "poses.csv"

    def read(self) -> Iterator[Mapping[str, Any] | BadValue]:
        """Yield rows that have become whole, or what is wrong with them; some, if there are many.

        Raises:
            BadValue: the file is too large, or its first row does not name the columns.
        """
        check_size(self.path, LARGEST_CSV)
        with suppress(FileNotFoundError), self.path.open("rb") as file:
            file.seek(self.place)
            read = file.read(CHUNK)
            whole = read[: read.rfind(b"\n") + 1]
            place = f"{self.path} row {self.rows + 1}"
            short = bool(whole) or len(read) < CHUNK
            check(short, place, f"{CHUNK} bytes", allowed="must be shorter")
            for line in whole.splitlines(keepends=True):
                if len(self.waiting) >= AHEAD:
                    return
                self.place += len(line)
                self.rows += 1
                yield from self._row(line)

    def _row(self, line: bytes) -> Iterator[Mapping[str, Any] | BadValue]:
        """Yield the cells of a line, or what is wrong with them; nothing of a heading."""
        text = line.decode("utf-8-sig", "replace")
        if not self.heading or self.heading.lower().startswith("sep=") and self.rows == 2:
            self.heading += text
            # What is wrong with the columns is so for all rows.
            list(row_cells(self.path, StringIO(self.heading)))
            return
        try:
            before = self.rows - self.heading.count("\n") - 1
            for cells in row_cells(self.path, StringIO(self.heading + text), before=before):
                # A recording that lies elsewhere is not looked at, let alone waited for.
                survey_at(self.described, cells)
                yield cells
        except BadValue as error:
            yield error

    def ready(self) -> Iterator[Waiting]:
        """Yield the waiting rows, oldest first, whose files have changed since they were tried."""
        for row in list(self.waiting):
            state = self._state(row)
            if state is not None and state != row.state:
                row.state = state
                row.since = time.monotonic()
                yield row

    def given_up(self) -> list[Waiting]:
        """Return rows whose recordings have been broken for too long; they wait no more."""
        latest = time.monotonic() - PATIENCE
        found = [row for row in self.waiting if row.state is not None and row.since < latest]
        for row in found:
            self.waiting.remove(row)
        return found

    def overdue(self) -> list[Waiting]:
        """Return rows whose recordings have not been there for `PATIENCE`, each of them once."""
        latest = time.monotonic() - PATIENCE
        found = [
            row for row in self.waiting if row.state is None and row.since < latest and not row.told
        ]
        for row in found:
            row.told = True
        return found

    @property
    def unread(self) -> bool:
        """Whether there are bytes that were not read."""
        return self.path.exists() and self.path.stat().st_size > self.place

    def _state(self, row: Waiting) -> tuple[int, int] | None:
        """Return size and time of the recording of a row, None if it is not there."""
        try:
            about = (self.described.folder / row.cells["file"]).stat()
        except (OSError, ValueError):
            return None
        return about.st_size, about.st_mtime_ns


def survey_at(described: Survey, cells: Mapping[str, Any], *, like: Survey | None = None) -> Survey:
    """Return the survey of one pose.

    Args:
        described: all that is known without it.
        cells: of its row.
        like: that of another pose; what was read beside its recording is not read again.

    Raises:
        BadValue: its recording lies elsewhere.
    """
    survey = with_poses(described, poses_of([cells]))
    return survey if like is None else sharing(survey, like)


def sharing(survey: Survey, like: Survey) -> Survey:
    """Return a survey that reads nothing again that another of the same folder has read."""
    vars(survey).update({key: vars(like)[key] for key in BESIDE if key in vars(like)})
    return survey
