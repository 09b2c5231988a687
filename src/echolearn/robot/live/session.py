"""A survey that grows, mapped pose by pose.

    row, recording --health--> mended --localize, score--> echoes --> map.csv, grid, points, walls

What was mapped before a kill is read from `map.csv`, but for the waterfall, which begins anew.
"""

import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np

from echolearn.acoustics.types import Array, Observation, Pose
from echolearn.checks import BadValue
from echolearn.localization.silence import SilentMicrophone
from echolearn.mapping.files.table import echo_table
from echolearn.robot.live.live_folder import LiveFolder, MappedEcho
from echolearn.robot.live.live_health import LiveHealth
from echolearn.robot.live.live_map import LiveMap, LivePose
from echolearn.robot.map_folder import told
from echolearn.robot.scorer import Scorer
from echolearn.robot.walk_map import mapped_walk
from echolearn.robot.waterfall import BEYOND, SIZE, colours_of, outputs
from echolearn.survey.growing import GrowingSurvey, Waiting, survey_at
from echolearn.survey.poses import poses_of
from echolearn.survey.survey import Survey


@dataclass
class LiveSession:
    """A walk that is being mapped.

    Attributes:
        scorer: a bundle at work.
        walk: the survey, without poses.
        table: rows of its echoes.
        map: what is known of it.
        health: of its last recordings.
        before: the last pose's, of which others take what was read beside its recording.
    """

    scorer: Scorer
    walk: Survey
    table: LiveFolder
    map: LiveMap
    health: LiveHealth = field(default_factory=LiveHealth)
    before: Survey | None = None

    def __post_init__(self) -> None:
        self.rows = GrowingSurvey(self.walk)
        window = self.scorer.bundle.localizer.window
        probe = self.scorer.bundle.probe
        first, last = window.lags(
            self.walk.array, probe.sample_rate, speed_of_sound=self.walk.speed_of_sound
        )
        self._lags = (first, min(int(np.ceil(last * BEYOND)), probe.length))

    def step(self) -> Iterator[LivePose]:
        """Yield the poses that have become whole, each after it was mapped."""
        for cells in self.rows.read():
            if isinstance(cells, BadValue):
                self.leave_out(cells)
            elif cells["index"] in self.table.done:
                yield self._again(cells)
            else:
                self.rows.waiting.append(Waiting(cells))
        for row in self.rows.ready():
            try:
                found = self.pose(row.cells)
            except BadValue as error:
                row.error = error
                continue
            self.rows.waiting.remove(row)
            yield found
        for row in self.rows.given_up():
            self.leave_out(row.error)

    def pose(self, cells: Mapping[str, Any]) -> LivePose:
        """Map the pose of a row, and return it.

        Raises:
            BadValue: its recording cannot be read or analysed.
        """
        survey = self.health.take(survey_at(self.walk, cells, like=self.before))
        observation = survey.observe([0])
        # A microphone that is silent is told by the health.
        with catch_warnings():
            simplefilter("ignore", SilentMicrophone)
            found = self.scorer.score(observation, survey.poses)
        self.before = survey
        mapped = mapped_walk(
            survey,
            found.echoes,
            found=found.map,
            azimuths=self.scorer.bundle.localizer.azimuths,
            resolution=self.map.grid.resolution,
        )
        self.table.append(echo_table(mapped).split(b"\n", 1)[1])
        new = LivePose(
            survey.numbers[0],
            survey.poses[0],
            points=found.map.points,
            confidence=found.map.confidence,
            shown=mapped.shown,
            heard=self._heard(observation),
        )
        self._add(new)
        return new

    def leave_out(self, error: BadValue) -> None:
        """Tell of a row that cannot be mapped."""
        line = f"left out: {error}"
        print(line, file=sys.stderr, flush=True)
        with self.map.lock:
            self.map.left_out += 1
            self.map.complaints.append(line)

    def _add(self, new: LivePose) -> None:
        """Add a pose to the map, and tell what has changed about its health."""
        self.map.add(new)
        health = self.health.health
        if health is None or health is self.map.health:
            return
        lines = [f"refused: {line}" for line in health.refused]
        for kind, said in told(health).get("health", {}).items():
            lines += [f"{kind}: {line}" for line in said]
        known = {_gist(line) for line in self.map.lines}
        for line in lines:
            if _gist(line) not in known:
                print(line, flush=True)
        with self.map.lock:
            self.map.health = health
            self.map.lines = lines

    def _again(self, cells: Mapping[str, Any]) -> LivePose:
        """Add a pose that was mapped by a command before."""
        echoes = self.table.done.pop(cells["index"])
        new = again(poses_of([cells]).poses[0], cells["index"], echoes=echoes)
        self.map.add(new)
        return new

    def _heard(self, observation: Observation) -> Array:
        """Return the row of a recording in the waterfall, levels (L,)."""
        first, lags = self._lags
        heard = outputs(observation, lags=lags, near=False)[0, 0, first:]
        colours = colours_of(heard)
        columns = min(len(colours), SIZE[1])
        starts = np.arange(columns) * len(colours) // columns
        return np.maximum.reduceat(colours, starts)


def again(pose: Pose, number: int, *, echoes: Sequence[MappedEcho]) -> LivePose:
    """Return a pose of which only the rows of `map.csv` are known.

    Args:
        pose: where the robot stood.
        number: its `index`.
        echoes: of its rows.
    """
    points = np.array([each.point for each in echoes]).reshape(-1, 2)
    shown = [each.kept and not each.upright and each.point[0] == each.point[0] for each in echoes]
    return LivePose(
        number,
        pose,
        points=points,
        confidence=np.array([each.confidence for each in echoes]),
        shown=np.array(shown, dtype=bool),
    )


def _gist(line: str) -> str:
    """Return a line without its numbers, which change with every recording."""
    return re.sub(r"[-+\d.]+", "", line)
