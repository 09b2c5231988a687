"""The growing map for Foxglove: a WebSocket server, and the same messages recorded as MCAP.

    /echoes      foxglove.PointCloud        points of a pose that are drawn: x, y, z, confidence
    /cloud       foxglove.PointCloud        a sample of all of them
    /pose        foxglove.PoseInFrame       where the robot stands
    /walls       foxglove.SceneUpdate       walls fitted so far
    /map         foxglove.Grid              100 occupied, 0 free, -1 unknown, as of map_server
    /waterfall   foxglove.CompressedImage   what the array hears, a row a pose, the newest below
    /health      foxglove.Log               what recordings say of themselves, when that changes

Everything is in frame `map`, in m. A command that goes on after a kill records into the next file;
the file of the killed one lacks its index, which `mcap recover` adds.
"""

import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import foxglove
import numpy as np
from foxglove import channels, messages

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue
from echolearn.mapping.files.grid import known_cells
from echolearn.mapping.files.ply import FIELDS
from echolearn.robot.live.live_map import LiveMap, LivePose
from echolearn.robot.live.page import waterfall_png
from echolearn.storage.files import one_line

FRAME = "map"
FLOAT32 = messages.PackedElementFieldNumericType.Float32
INT8 = messages.PackedElementFieldNumericType.Int8

GREEN = messages.Color(r=0.0, g=0.62, b=0.45, a=1.0)


class FoxgloveViewer:
    """A server, a recording, or both."""

    def __init__(self, *, host: str, port: int | None, folder: Path | None) -> None:
        """Start them.

        Args:
            host: address that the server is bound to.
            port: its port, 0 takes any that is free; None starts none.
            folder: where recordings go; None records nothing.

        Raises:
            BadValue: the port is taken.
        """
        # Its own, so that two maps in one process do not mix; channels end with it.
        self._context = context = foxglove.Context()
        self._closed: list[Any] = []
        if folder is not None:
            file = _next_file(folder)
            self._closed.append(foxglove.open_mcap(file, context=context).close)
            print(f"mcap: {file}", flush=True)
        if port is not None:
            try:
                server = foxglove.start_server(
                    name="echolearn live", host=host, port=port, context=context
                )
            except (OSError, RuntimeError) as error:
                raise BadValue(f"foxglove={port} at {host}: {one_line(error)}") from None
            self._closed.append(server.stop)
            print(f"foxglove: ws://{host}:{server.port}", flush=True)
        self._echoes = channels.PointCloudChannel("/echoes", context=context)
        self._cloud = channels.PointCloudChannel("/cloud", context=context)
        self._pose = channels.PoseInFrameChannel("/pose", context=context)
        self._walls = channels.SceneUpdateChannel("/walls", context=context)
        self._map = channels.GridChannel("/map", context=context)
        self._waterfall = channels.CompressedImageChannel("/waterfall", context=context)
        self._health = channels.LogChannel("/health", context=context)
        self._told: list[str] = []

    def pose(self, live: LiveMap, new: LivePose) -> None:
        """Show a new pose, and its health where that has changed."""
        now = _now()
        x, y, z = (float(each) for each in new.pose.position)
        turned = _turned(new.pose.heading)
        stands = messages.Pose(position=messages.Vector3(x=x, y=y, z=z), orientation=turned)
        self._pose.log(messages.PoseInFrame(timestamp=now, frame_id=FRAME, pose=stands))
        points = np.column_stack([new.points, np.full(len(new.points), z), new.confidence])
        self._echoes.log(_cloud(points[new.shown], now))
        lines = [*live.lines]
        for line in lines:
            if line not in self._told:
                level = messages.LogLevel.Warning
                self._health.log(messages.Log(timestamp=now, level=level, message=line))
        self._told = lines

    def map(self, live: LiveMap) -> None:
        """Show grid, cloud, walls and waterfall."""
        now = _now()
        rows = live.sample.rows
        height = 0.0 if live.last is None else float(live.last.pose.position[2])
        places = np.column_stack([rows[:, :2], np.full(len(rows), height), rows[:, 4]])
        self._cloud.log(_cloud(places, now))
        self._map.log(_grid(live, now))
        walls = [
            messages.LinePrimitive(
                type=messages.LinePrimitiveLineType.LineStrip,
                thickness=0.05,
                points=[_point(end, height) for end in (line.start, line.end)],
                color=GREEN,
            )
            for line in live.walls
        ]
        entity = messages.SceneEntity(timestamp=now, frame_id=FRAME, id="walls", lines=walls)
        self._walls.log(messages.SceneUpdate(entities=[entity]))
        image = waterfall_png(live)
        self._waterfall.log(
            messages.CompressedImage(timestamp=now, frame_id=FRAME, data=image, format="png")
        )

    def close(self) -> None:
        """Stop the server, and end the recording."""
        for close in self._closed:
            with suppress(RuntimeError):
                close()


def _next_file(folder: Path) -> Path:
    """Return the first `live-<number>.mcap` that is not there yet."""
    taken = {path.name for path in folder.glob("live-*.mcap")}
    number = 1
    while f"live-{number}.mcap" in taken:
        number += 1
    return folder / f"live-{number}.mcap"


def _now() -> messages.Timestamp:
    return messages.Timestamp.from_epoch_secs(time.time())


def _turned(heading: float) -> messages.Quaternion:
    """Return a turn by `heading` rad about the z axis."""
    sine, cosine = float(np.sin(heading / 2)), float(np.cos(heading / 2))
    return messages.Quaternion(x=0.0, y=0.0, z=sine, w=cosine)


def _point(place: Array, height: float) -> messages.Point3:
    x, y = place.tolist()
    return messages.Point3(x=x, y=y, z=height)


def _cloud(points: Array, now: messages.Timestamp) -> messages.PointCloud:
    """Return points (K, 4), columns `FIELDS`, as a message."""
    fields = [
        messages.PackedElementField(name=name, offset=4 * place, type=FLOAT32)
        for place, name in enumerate(FIELDS)
    ]
    return messages.PointCloud(
        timestamp=now,
        frame_id=FRAME,
        pose=_origin(0.0, 0.0),
        point_stride=4 * len(FIELDS),
        fields=fields,
        data=points.astype("<f4").tobytes(),
    )


def _grid(live: LiveMap, now: messages.Timestamp) -> messages.Grid:
    """Return the occupancy grid as a message."""
    pixels, corner = live.grid.pixels()
    side = live.grid.resolution
    return messages.Grid(
        timestamp=now,
        frame_id=FRAME,
        pose=_origin(*corner),
        column_count=pixels.shape[1],
        cell_size=messages.Vector2(x=side, y=side),
        row_stride=pixels.shape[1],
        cell_stride=1,
        fields=[messages.PackedElementField(name="occupancy", offset=0, type=INT8)],
        data=known_cells(pixels).tobytes(),
    )


def _origin(x: float, y: float) -> messages.Pose:
    return messages.Pose(
        position=messages.Vector3(x=x, y=y, z=0.0),
        orientation=messages.Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
    )
