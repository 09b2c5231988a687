"""`live`: a folder that grows is followed until it ends, and then mapped as a whole.

    look for what is whole --map it, show it--> wait --> look again;  told to stop --> `map_survey`

It stops at SIGINT or SIGTERM, when standard input ends, or after a number of poses. The map is then
what `map_survey` makes of the folder as it stands, to the byte: what was shown meanwhile is thrown
away but for its table.
"""

import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import current_thread, main_thread
from typing import Any

from echolearn.checks import check, check_name, check_whole
from echolearn.robot.choices import suited, with_gains
from echolearn.robot.live.growing_grid import GrowingGrid
from echolearn.robot.live.line_input import LineInput
from echolearn.robot.live.live_folder import LiveFolder, live_inputs
from echolearn.robot.live.live_map import LiveMap
from echolearn.robot.live.session import LiveSession
from echolearn.robot.live.viewers import Viewers, Viewing
from echolearn.robot.scorer import load
from echolearn.robot.survey_map import map_survey, seeking
from echolearn.storage.manifests import MANIFEST
from echolearn.storage.once import claimed
from echolearn.survey.growing import PATIENCE
from echolearn.survey.proof import prove_manifest
from echolearn.survey.reader import read_described

LOOK = 0.05
"""Seconds between looks at the folder."""

TELL = 10.0
"""Seconds between lines on the state of things."""


def live_survey(
    *,
    survey: Path,
    bundle: Path,
    runs: Path,
    name: str | None = None,
    resolution: float = 0.05,
    until: int | None = None,
    lines: bool = False,
    viewing: Viewing | None = None,
    command: str | None = None,
    **asked: Any,
) -> Path:
    """Map a survey while it is recorded, then map it as a whole, and return the map's folder.

    Args:
        survey: folder in the recorded-survey format; its `poses.csv` and recordings may come later.
        bundle: folder of a bundle.
        runs: folder of everything generated; the live map goes to `runs/live`, the map to
            `runs/maps`.
        name: name of both folders; `<survey>-<bundle>` unless given.
        resolution: side of a cell of the occupancy grid, in m.
        until: number of poses, mapped or left out, after which it stops.
        lines: take rows from standard input, until that ends.
        viewing: who is shown the map; nobody unless given.
        command: what makes the map again; None says nothing about it.
        asked: keys of `map_survey` that make another map: `resample`, `direct`, `played`,
            `without`, `gains`, `localizer`.

    Raises:
        BadValue: survey and bundle that do not fit, or as `map_survey`.
    """
    if until is not None:
        check_whole("until", until, low=1)
    name = name or f"{Path(survey).resolve().name}-{Path(bundle).resolve().name}"
    check_name("name", name, hint="a path is no name")
    (Path(runs) / "live").mkdir(parents=True, exist_ok=True)
    folder = Path(runs) / "live" / name
    with claimed(folder) as free:
        hint = "another command writes it; name= gives another"
        check(free, "name", name, allowed="must be of no other live map", hint=hint)
        _follow(
            _session(Path(survey), bundle, folder=folder, resolution=resolution, asked=asked),
            viewing=viewing or Viewing(),
            lines=lines,
            until=until,
        )
    again: Any = {"resolution": resolution, "command": command, **asked}
    return map_survey(survey=survey, bundle=bundle, runs=runs, name=name, **again)


def _session(
    survey: Path, bundle: Path, *, folder: Path, resolution: float, asked: Mapping[str, Any]
) -> "LiveSession":
    """Return what maps a survey; the arguments are those of `live_survey`."""
    sign = (asked.get("localizer") or {}).get("sign")
    scorer = seeking(load(bundle), sign)
    hint = "this one judges walls of a whole walk, which echolearn map does when it has ended"
    single = scorer.bundle.hypotheses is None
    check(single, "bundle", bundle, allowed="must judge echoes one by one", hint=hint)
    described = read_described(survey)
    # What is finished does not grow: `map` would refuse it at the end, all poses later.
    if prove_manifest(survey):
        print(f"{survey}: finished, as its {MANIFEST} says: no pose will come", file=sys.stderr)
    played = asked.get("played")
    hint = "all recordings are needed to take the burst from a walk"
    check(played != "walk", "played", played, allowed="must be calibration or null", hint=hint)
    chosen = {key: asked.get(key) for key in ("direct", "played")}
    walk = suited(described, scorer.bundle, resample=bool(asked.get("resample")), **chosen)
    gains = {key: asked.get(key) for key in ("without", "gains")}
    walk = with_gains(walk, scorer.bundle, **gains)
    # Whoever asks for what is so anyway asks for no other rows.
    wanted = {"resample": asked.get("resample") or None, "sign": sign, **chosen, **gains}
    table = LiveFolder(folder, live_inputs(walk, scorer.bundle.about, asked=wanted))
    if table.replaced:
        print(f"{folder}: replaces the live map of something else", file=sys.stderr)
    if table.done:
        last = f"{len(table.done)} poses are mapped, the last is pose {max(table.done)}"
        print(f"{folder}: goes on where it stopped: {last}", file=sys.stderr)
    return LiveSession(scorer, walk, table, LiveMap(GrowingGrid(resolution)))


def _follow(session: LiveSession, *, viewing: Viewing, lines: bool, until: int | None) -> None:
    """Map what comes until it is told to stop.

    Args:
        session: what maps it.
        viewing: who is shown the map.
        lines: take rows from standard input.
        until: number of poses after which it stops.
    """
    with ExitStack() as stack:
        stack.callback(session.table.close)
        stopped = stack.enter_context(_until_told())
        viewers = stack.enter_context(Viewers(viewing, session.map, folder=session.table.folder))
        source = LineInput(session.rows.path, odometry=viewers.odometry) if lines else None
        following = _Following(session, viewers, source=source, until=until, stopped=stopped)
        while following.look():
            pass
        session.map.end()
        viewers.map()
        say_how_far(session.map)


class _Following:
    """A survey that is followed.

    Attributes:
        session: what maps it.
        viewers: who is shown the map.
        source: where rows come from besides the folder; None if from nowhere.
    """

    def __init__(
        self,
        session: LiveSession,
        viewers: Viewers,
        *,
        source: LineInput | None,
        until: int | None,
        stopped: Callable[[], bool],
    ) -> None:
        """Begin.

        Args:
            session: what maps it.
            viewers: who is shown the map.
            source: where rows come from besides the folder; None if from nowhere.
            until: number of poses after which it stops.
            stopped: tells whether it was told to stop.
        """
        self.session = session
        self.viewers = viewers
        self.source = source
        self._until = until
        self._stopped = stopped
        self._came = time.monotonic()
        self._told = self._came
        self._table_told = False

    def look(self) -> bool:
        """Map what has come, wait for more, and return whether there may be."""
        for new in self.session.step():
            self._came = time.monotonic()
            self.viewers.pose(new)
            if self._enough():
                return False
        if self._enough() or self._drained():
            return False
        self._tell_missing()
        self._wait()
        self.viewers.look()
        if time.monotonic() - self._told > TELL:
            self._told = time.monotonic()
            say_how_far(self.session.map)
        return True

    def _tell_missing(self) -> None:
        """Say once of each file that is not there that it is waited for."""
        rows = self.session.rows
        late = time.monotonic() - self._came > PATIENCE
        if late and not self._table_told and not rows.path.exists():
            self._table_told = True
            _say_waiting(str(rows.path), "a row of it")
        overdue = rows.overdue()
        if overdue:
            first = overdue[0].cells
            more = f" and {len(overdue) - 1} more" if overdue[1:] else ""
            _say_waiting(f"{first['file']} of pose {first['index']}{more}", "its pose")

    def _enough(self) -> bool:
        """Tell whether it was told to stop, or has all poses that were asked for."""
        known = self.session.map.poses + self.session.map.left_out
        return self._stopped() or (self._until is not None and known >= self._until)

    def _drained(self) -> bool:
        """Tell whether standard input has ended, and what it named was mapped or waited for."""
        if self.source is None or not self.source.ended:
            return False
        waiting = bool(self.session.rows.waiting) or self.session.rows.unread
        return not waiting or time.monotonic() - self._came > 2 * PATIENCE

    def _wait(self) -> None:
        """Wait for what comes next."""
        if self.source is None or self.source.ended:
            time.sleep(LOOK)
            return
        busy = self.session.rows.unread
        for error in self.source.wait(0.0 if busy else LOOK):
            self.session.leave_out(error)


@contextmanager
def _until_told() -> Iterator[Callable[[], bool]]:
    """Yield what tells whether SIGINT or SIGTERM came; a second one is as always."""
    told: list[int] = []
    if current_thread() is not main_thread():
        # Signals are the main thread's; a library that calls from another stops by `until`.
        yield lambda: False
        return
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def tell_of(number: int, _: object) -> None:
        """Remember a signal, and let the next one be as always."""
        told.append(number)
        for each, handler in before.items():
            signal.signal(each, handler)

    for number in before:
        signal.signal(number, tell_of)
    try:
        yield lambda: bool(told)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _say_waiting(what: str, mapped: str) -> None:
    """Print that something is not there yet, and for how long that may be."""
    until = f"{mapped} is mapped when it comes, however late, until live is told to stop"
    print(
        f"live: waits for {what}, not there for {PATIENCE:g} s; {until}",
        file=sys.stderr,
        flush=True,
    )


def say_how_far(live: LiveMap) -> None:
    """Print how far a map is."""
    left = f", {live.left_out} left out" if live.left_out else ""
    line = f"live: {live.poses} poses{left}, {live.shown} points, {len(live.walls)} walls"
    print(line, file=sys.stderr, flush=True)
