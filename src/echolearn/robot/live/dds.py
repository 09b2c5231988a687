"""The growing map for ROS 2 without ROS: its messages by DDS, under the names that ROS gives them.

    rt/echoes  PointCloud2    out: points of a pose that are drawn
    rt/map     OccupancyGrid  out: once a second at most; whoever comes late gets the last one
    rt/odom    Odometry       in: the last pose, for lines that name a recording alone

ROS 2 sends CDR of version 1, and so does this. Unless the host is another than 127.0.0.1, only this
machine takes part; a configuration in CYCLONEDDS_URI overrules that.
"""

import math
import os
import time

import numpy as np
from cyclonedds.core import DDSException, Qos
from cyclonedds.core import Policy as Rule
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from echolearn.acoustics.types import Pose
from echolearn.checks import BadValue
from echolearn.mapping.files.grid import known_cells
from echolearn.mapping.files.ply import FIELDS
from echolearn.robot.live import ros_types as ros
from echolearn.robot.live.live_map import LiveMap, LivePose
from echolearn.storage.files import one_line

FLOAT32 = 7
"""`FLOAT32` of sensor_msgs/PointField."""

SPEAK = Rule.DataRepresentation(use_cdrv0_representation=True, use_xcdrv2_representation=False)
RELIABLE = Rule.Reliability.Reliable(duration(seconds=1))
OUT = Qos(SPEAK, RELIABLE, Rule.History.KeepLast(10))
LATCHED = Qos(SPEAK, RELIABLE, Rule.Durability.TransientLocal, Rule.History.KeepLast(1))
IN = Qos(SPEAK, Rule.Reliability.BestEffort, Rule.History.KeepLast(1))

ALONE = """<CycloneDDS><Domain Id="any"><General><Interfaces>
<NetworkInterface name="lo" multicast="false"/></Interfaces><AllowMulticast>false</AllowMulticast>
</General><Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer Address="127.0.0.1"/>
</Peers></Discovery></Domain></CycloneDDS>"""
"""Configuration of a domain that does not leave this machine."""


class RosViewer:
    """A participant of a DDS domain."""

    def __init__(self, domain: int, *, local: bool) -> None:
        """Join.

        Args:
            domain: its number.
            local: whether it shall not leave this machine.

        Raises:
            BadValue: DDS cannot be started here.
        """
        try:
            # Kept, since a domain ends with its last holder.
            own = local and "CYCLONEDDS_URI" not in os.environ
            self._domain = Domain(domain, ALONE) if own else None
            taking = DomainParticipant(domain)
            clouds = Topic(taking, "rt/echoes", ros.PointCloud2)
            grids = Topic(taking, "rt/map", ros.OccupancyGrid)
            self._echoes = DataWriter(taking, clouds, qos=OUT)
            self._map = DataWriter(taking, grids, qos=LATCHED)
            self._odometry = DataReader(taking, Topic(taking, "rt/odom", ros.Odometry), qos=IN)
        except DDSException as error:
            raise BadValue(f"dds={domain}: cannot be joined ({one_line(error)})") from None
        self._last: Pose | None = None
        reach = "on this machine" if own else "as far as CycloneDDS reaches"
        print(f"dds: domain {domain} {reach}; rt/echoes, rt/map; rt/odom is heard", flush=True)

    def odometry(self) -> Pose | None:
        """Return the last pose that odometry told, None before the first."""
        for said in self._odometry.take(N=64):
            found = _pose_of(said)
            # What is not finite is no pose; a reader also tells that a writer has gone.
            self._last = found or self._last
        return self._last

    def pose(self, live: LiveMap, new: LivePose) -> None:
        """Publish the points of a new pose."""
        height = np.full(len(new.points), float(new.pose.position[2]))
        points = np.column_stack([new.points, height, new.confidence])[new.shown].astype("<f4")
        fields = [
            ros.PointField(name=name, offset=4 * place, datatype=FLOAT32, count=1)
            for place, name in enumerate(FIELDS)
        ]
        message = ros.PointCloud2(
            header=_header(),
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=4 * len(FIELDS),
            row_step=points.nbytes,
            data=list(points.tobytes()),
            is_dense=True,
        )
        self._echoes.write(message)

    def map(self, live: LiveMap) -> None:
        """Publish the occupancy grid."""
        pixels, (x, y) = live.grid.pixels()
        height, width = pixels.shape
        header = _header()
        origin = ros.RosPose(ros.Point(x, y, 0.0), ros.Quaternion(0.0, 0.0, 0.0, 1.0))
        about = ros.MapMetaData(
            map_load_time=header.stamp,
            resolution=live.grid.resolution,
            width=width,
            height=height,
            origin=origin,
        )
        cells = known_cells(pixels).reshape(-1).tolist()
        self._map.write(ros.OccupancyGrid(header, about, cells))

    def close(self) -> None:
        """Leave."""
        # Whoever has not got the last messages yet gets them.
        time.sleep(0.2)
        del self._echoes, self._map, self._odometry


def _header() -> ros.Header:
    """Return a header of now, in frame `map`."""
    seconds, nanoseconds = divmod(time.time_ns(), 1_000_000_000)
    return ros.Header(stamp=ros.Time(sec=seconds, nanosec=nanoseconds), frame_id="map")


def _pose_of(said: object) -> Pose | None:
    """Return the pose of an odometry, None if it has none."""
    if not isinstance(said, ros.Odometry):
        return None
    pose = said.pose.pose
    place = np.array([pose.position.x, pose.position.y, pose.position.z])
    turn = pose.orientation
    # The heading of a robot that may be tilted a little: yaw of the quaternion.
    heading = math.atan2(2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y**2 + turn.z**2))
    return Pose(place, heading) if np.isfinite([*place, heading]).all() else None
