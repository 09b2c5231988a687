"""`bag/bag.mcap` and `bag/metadata.yaml`: the map as a ROS 2 bag, by rosbags in pure Python.

    /echoes   sensor_msgs/PointCloud2   the points of `map.ply`: x, y, z, confidence
    /map      nav_msgs/OccupancyGrid    the cells of `map.pgm` as map_server reads them: 100 is
                                        occupied, 0 free, -1 unknown
    /path     nav_msgs/Path             the poses, headings as quaternions

Everything is in frame `map` (REP 105), in m, x ahead, y left, z up (REP 103). A survey tells no
times, so all stamps are 0, by which tf means the latest there is, and the same map gives the same
bytes. Whoever subscribes late gets the messages still: durability is transient local, as
map_server's. A folder with `metadata.yaml` is what `ros2 bag` of any version opens; its format 8 is
the last that Humble reads, and all later ones do.
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rosbags import interfaces
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.stores import ros2_humble as ros

from echolearn.acoustics.types import Array
from echolearn.mapping.files.grid import cells
from echolearn.mapping.files.ply import FIELDS, cloud
from echolearn.mapping.mapped_walk import BAG, Files, MappedWalk

FLOAT32 = 7
"""`FLOAT32` of sensor_msgs/PointField."""

EPOCH = ros.builtin_interfaces__msg__Time(sec=0, nanosec=0)
HEADER = ros.std_msgs__msg__Header(stamp=EPOCH, frame_id="map")

FOREVER = interfaces.QosTime(0, 0)
LATCHED = interfaces.Qos(
    history=interfaces.QosHistory.KEEP_LAST,
    depth=1,
    reliability=interfaces.QosReliability.RELIABLE,
    durability=interfaces.QosDurability.TRANSIENT_LOCAL,
    deadline=FOREVER,
    lifespan=FOREVER,
    liveliness=interfaces.QosLiveliness.AUTOMATIC,
    liveliness_lease_duration=FOREVER,
    avoid_ros_namespace_conventions=False,
)
"""Quality of service of a topic that keeps its last message."""


def write(walk: MappedWalk) -> Files:
    """Return the bag."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    # rosbags writes folders only.
    with TemporaryDirectory() as scratch:
        folder = (Path(scratch) / BAG[0]).parent
        with Writer(folder, version=8, storage_plugin=StoragePlugin.MCAP) as writer:
            for topic, message in messages(walk).items():
                kind = message.__msgtype__
                connection = writer.add_connection(
                    topic, kind, typestore=store, offered_qos_profiles=[LATCHED]
                )
                writer.write(connection, 0, store.serialize_cdr(message, kind, little_endian=True))
        return {name: (Path(scratch) / name).read_bytes() for name in BAG}


def messages(walk: MappedWalk) -> dict[str, Any]:
    """Return the message of each topic."""
    return {"/echoes": _echoes(walk), "/map": _map(walk), "/path": _path(walk)}


def _echoes(walk: MappedWalk) -> ros.sensor_msgs__msg__PointCloud2:
    points = cloud(walk)
    size = points.itemsize
    return ros.sensor_msgs__msg__PointCloud2(
        header=HEADER,
        height=1,
        width=len(points),
        fields=[
            ros.sensor_msgs__msg__PointField(name, offset=size * k, datatype=FLOAT32, count=1)
            for k, name in enumerate(FIELDS)
        ],
        is_bigendian=False,
        point_step=size * len(FIELDS),
        row_step=points.nbytes,
        data=np.frombuffer(points.tobytes(), np.uint8),
        is_dense=True,
    )


def _map(walk: MappedWalk) -> ros.nav_msgs__msg__OccupancyGrid:
    found, origin = cells(walk)
    height, width = found.shape
    about = ros.nav_msgs__msg__MapMetaData(
        map_load_time=EPOCH,
        resolution=walk.resolution,
        width=width,
        height=height,
        origin=_pose(np.array([*origin, 0.0])),
    )
    return ros.nav_msgs__msg__OccupancyGrid(HEADER, about, found.reshape(-1))


def _path(walk: MappedWalk) -> ros.nav_msgs__msg__Path:
    poses = [_pose(pose.position, pose.heading) for pose in walk.poses]
    return ros.nav_msgs__msg__Path(
        HEADER, [ros.geometry_msgs__msg__PoseStamped(HEADER, pose) for pose in poses]
    )


def _pose(position: Array, heading: float = 0.0) -> ros.geometry_msgs__msg__Pose:
    """Return a pose that is turned by `heading` rad about the z axis."""
    x, y, z = position.tolist()
    sine = float(np.sin(heading / 2))
    cosine = float(np.cos(heading / 2))
    return ros.geometry_msgs__msg__Pose(
        position=ros.geometry_msgs__msg__Point(x, y, z),
        orientation=ros.geometry_msgs__msg__Quaternion(0.0, 0.0, sine, cosine),
    )
