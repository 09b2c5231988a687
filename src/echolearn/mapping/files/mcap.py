"""`bag/bag.mcap` and `bag/metadata.yaml`: the map as a ROS 2 bag, written in pure Python by
rosbags.

    /echoes   sensor_msgs/PointCloud2   the points of `map.ply`: x, y, z, confidence
    /map      nav_msgs/OccupancyGrid    the cells of `map.pgm` as map_server reads them: 100, 0, or -1 for unknown
    /path     nav_msgs/Path             the poses, headings as quaternions

Everything is in frame `map` (REP 105), in m, x ahead, y left, z up (REP 103). A survey tells no
times, so all stamps are 0, by which tf means the latest there is, and the same map gives the same
bytes. Whoever subscribes late gets the
messages still: durability is transient local, as map_server's. A folder with `metadata.yaml` is
    what `ros2 bag` of any
version opens; its format 8 is the last that Humble reads, and all later ones do.
"""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check
from echolearn.mapping.files.chart import Chart, Files
from echolearn.mapping.files.grid import cells
from echolearn.mapping.files.ply import FIELDS, cloud

TOPICS = {
    "/echoes": "sensor_msgs/msg/PointCloud2",
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/path": "nav_msgs/msg/Path",
}

FOLDER = "bag"
FILES = (f"{FOLDER}/bag.mcap", f"{FOLDER}/metadata.yaml")

FRAME = "map"
FLOAT32 = 7
"""`FLOAT32` of sensor_msgs/PointField."""

Types = Mapping[str, Any]
"""The classes of ROS messages, by name."""


def check_wanted(ros: object) -> None:
    """Raise `BadValue` unless `ros` is true or false, and if true, unless bags can be written here."""
    check(isinstance(ros, bool), "ros", ros, allowed="true or false")
    if ros:
        try:
            import rosbags.rosbag2  # noqa: F401
        except ImportError:
            raise BadValue("ros=true: needs rosbags; pip install 'echolearn[ros]'") from None


def write(chart: Chart) -> Files:
    """Return the bag."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    with TemporaryDirectory() as scratch:
        bag = Path(scratch) / FOLDER
        with Writer(bag, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
            for (topic, kind), message in zip(
                TOPICS.items(), messages(chart, store.types), strict=True
            ):
                connection = writer.add_connection(
                    topic, kind, typestore=store, offered_qos_profiles=[_latched()]
                )
                writer.write(connection, 0, store.serialize_cdr(message, kind, little_endian=True))
        return {name: (bag.parent / name).read_bytes() for name in FILES}


def remove(folder: Path) -> None:
    """Remove the bag of an earlier map from its folder."""
    for name in FILES:
        (folder / name).unlink(missing_ok=True)
    with suppress(OSError):  # there is none, or something else is in it
        (folder / FOLDER).rmdir()


def messages(chart: Chart, types: Types) -> list[Any]:
    """Return the message of each topic."""
    header = types["std_msgs/msg/Header"](
        stamp=types["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id=FRAME
    )
    return [_echoes(chart, types, header), _map(chart, types, header), _path(chart, types, header)]


def _echoes(chart: Chart, types: Types, header: Any) -> Any:
    points, field = cloud(chart), types["sensor_msgs/msg/PointField"]
    size = points.itemsize
    return types["sensor_msgs/msg/PointCloud2"](
        header=header,
        height=1,
        width=len(points),
        fields=[
            field(name=name, offset=size * k, datatype=FLOAT32, count=1)
            for k, name in enumerate(FIELDS)
        ],
        is_bigendian=False,
        point_step=size * len(FIELDS),
        row_step=points.nbytes,
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=True,
    )


def _map(chart: Chart, types: Types, header: Any) -> Any:
    found, origin = cells(chart)
    about = types["nav_msgs/msg/MapMetaData"](
        map_load_time=header.stamp,
        resolution=chart.resolution,
        width=found.shape[1],
        height=found.shape[0],
        origin=_pose(np.array([*origin, 0.0]), 0.0, types),
    )
    return types["nav_msgs/msg/OccupancyGrid"](header=header, info=about, data=found.reshape(-1))


def _path(chart: Chart, types: Types, header: Any) -> Any:
    stamped = types["geometry_msgs/msg/PoseStamped"]
    headings = np.zeros(len(chart.path)) if chart.headings is None else chart.headings
    poses = [
        _pose(place, turn, types) for place, turn in zip(chart.path, headings.tolist(), strict=True)
    ]
    return types["nav_msgs/msg/Path"](
        header=header, poses=[stamped(header=header, pose=pose) for pose in poses]
    )


def _pose(position: Array, heading: float, types: Types) -> Any:
    """Return a pose that is turned by `heading` rad about the z axis."""
    x, y, z = position.tolist()
    sine, cosine = float(np.sin(heading / 2)), float(np.cos(heading / 2))
    turn = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=sine, w=cosine)
    return types["geometry_msgs/msg/Pose"](
        position=types["geometry_msgs/msg/Point"](x=x, y=y, z=z), orientation=turn
    )


def _latched() -> Any:
    """Return the quality of service of a topic that keeps its last message; times of 0 are not
    limited.
    """
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    never = QosTime(0, 0)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=1,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL,
        deadline=never,
        lifespan=never,
        liveliness=QosLiveliness.AUTOMATIC,
        liveliness_lease_duration=never,
        avoid_ros_namespace_conventions=False,
    )
