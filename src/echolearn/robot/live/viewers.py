"""Who is shown a growing map: a local page, Foxglove, a recording, ROS 2.

Each viewer is a module with a class: `pose` shows a new pose, `map` grid and walls, at most once in
`EVERY`, `close` ends it. Libraries are loaded for those that were asked for alone. Everything is
bound to this machine unless told otherwise.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, Self

from echolearn.acoustics.types import Pose
from echolearn.checks import BadValue, check, check_text, check_whole
from echolearn.robot.live.live_map import LiveMap, LivePose

EVERY = 1.0
"""Seconds between grids, which are large."""

LOCAL = "127.0.0.1"

NEEDS = "pip install 'echolearn[live]'"


@dataclass(frozen=True)
class Viewing:
    """Who is shown the map.

    Attributes:
        host: address that all are bound to; 127.0.0.1 is this machine alone.
        port: port of the local page, 0 takes any that is free; None shows none.
        foxglove: port of Foxglove's WebSocket server; None starts none.
        mcap: whether the live map is recorded as MCAP.
        dds: number of the DDS domain that is published to, 0 is ROS 2's own; None publishes
            nothing.
    """

    host: str = LOCAL
    port: int | None = None
    foxglove: int | None = None
    mcap: bool = False
    dds: int | None = None

    def __post_init__(self) -> None:
        check_text("host", self.host)
        for name in ("port", "foxglove"):
            if getattr(self, name) is not None:
                check_whole(name, getattr(self, name), low=0, high=65535)
        if self.dds is not None:
            # Beyond, the ports of a domain do not exist.
            check_whole("dds", self.dds, low=0, high=232)
        check(isinstance(self.mcap, bool), "mcap", self.mcap, allowed="must be true or false")


class Viewers:
    """The viewers that were asked for, opened.

    Attributes:
        odometry: returns the last pose that ROS 2 told; None where nothing tells it.
    """

    def __init__(self, viewing: Viewing, live: LiveMap, *, folder: Path) -> None:
        """Open them.

        Args:
            viewing: who they are.
            live: what they are shown.
            folder: of the live map, where recordings go.

        Raises:
            BadValue: a library that is not installed, or a port that is taken.
        """
        self._live = live
        self._shown = 0.0
        self._poses = 0
        self._all: list[Any] = []
        self.odometry: Callable[[], Pose | None] | None = None
        try:
            if viewing.port is not None:
                page = import_module("echolearn.robot.live.page")
                self._all.append(page.Page(live, host=viewing.host, port=viewing.port))
            if viewing.foxglove is not None or viewing.mcap:
                shown = _needed("foxglove_viewer", "foxglove", key="foxglove or mcap")
                recorded = folder if viewing.mcap else None
                about = {"host": viewing.host, "port": viewing.foxglove, "folder": recorded}
                self._all.append(shown.FoxgloveViewer(**about))
            if viewing.dds is not None:
                published = _needed("dds", "cyclonedds", key="dds")
                ros = published.RosViewer(viewing.dds, local=viewing.host == LOCAL)
                self.odometry = ros.odometry
                self._all.append(ros)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        """Return them."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close them."""
        self.close()

    def pose(self, new: LivePose) -> None:
        """Show a new pose."""
        for viewer in self._all:
            viewer.pose(self._live, new)
        self.look()

    def look(self) -> None:
        """Show grid and walls again if it is time."""
        new = self._live.poses != self._poses
        if new and time.monotonic() - self._shown >= EVERY:
            self.map()

    def map(self) -> None:
        """Show grid and walls."""
        self._shown = time.monotonic()
        self._poses = self._live.poses
        if self._live.poses:
            for viewer in self._all:
                viewer.map(self._live)

    def close(self) -> None:
        """Close them all."""
        for viewer in self._all:
            viewer.close()
        self._all.clear()


def _needed(module: str, library: str, *, key: str) -> Any:
    """Return a viewer's module.

    Args:
        module: its name.
        library: what it needs.
        key: what was asked for.

    Raises:
        BadValue: the library is not installed.
    """
    try:
        import_module(library)
    except ImportError:
        raise BadValue(f"{key}: needs {library}; {NEEDS}") from None
    return import_module(f"echolearn.robot.live.{module}")
