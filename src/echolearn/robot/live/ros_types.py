"""Messages of ROS 2 as DDS sees them: type names of rosidl, fields in the order of the .msg files.

`sensor_msgs/PointCloud2` is `sensor_msgs::msg::dds_::PointCloud2_` there, topic `/echoes` is
`rt/echoes`. Sources: ros2/common_interfaces and ros2/rcl_interfaces, unchanged since Foxy.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int8, int32, sequence, uint8, uint32

if TYPE_CHECKING:
    Fields = Sequence["PointField"]
    Octets = Sequence[int]
    Cells = Sequence[int]
    Covariance = Sequence[float]
else:
    Fields = sequence["echolearn.robot.live.ros_types.PointField"]
    Octets = sequence[uint8]
    Cells = sequence[int8]
    Covariance = array[float64, 36]


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    """A time since 1970."""

    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    """When, and in which frame."""

    stamp: Time
    frame_id: str


@dataclass
class PointField(IdlStruct, typename="sensor_msgs::msg::dds_::PointField_"):
    """A field of each point."""

    name: str
    offset: uint32
    datatype: uint8
    count: uint32


@dataclass
class PointCloud2(IdlStruct, typename="sensor_msgs::msg::dds_::PointCloud2_"):
    """Points, packed as bytes."""

    header: Header
    height: uint32
    width: uint32
    fields: Fields
    is_bigendian: bool
    point_step: uint32
    row_step: uint32
    data: Octets
    is_dense: bool


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    """A place in m."""

    x: float64
    y: float64
    z: float64


@dataclass
class Quaternion(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    """A turn."""

    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class RosPose(IdlStruct, typename="geometry_msgs::msg::dds_::Pose_"):
    """A place and a turn."""

    position: Point
    orientation: Quaternion


@dataclass
class MapMetaData(IdlStruct, typename="nav_msgs::msg::dds_::MapMetaData_"):
    """What describes a grid."""

    map_load_time: Time
    resolution: float32
    width: uint32
    height: uint32
    origin: RosPose


@dataclass
class OccupancyGrid(IdlStruct, typename="nav_msgs::msg::dds_::OccupancyGrid_"):
    """A grid: 100 is occupied, 0 free, -1 unknown."""

    header: Header
    info: MapMetaData
    data: Cells


@dataclass
class PoseWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::PoseWithCovariance_"):
    """A pose, and how far it may be off."""

    pose: RosPose
    covariance: Covariance


@dataclass
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    """A vector."""

    x: float64
    y: float64
    z: float64


@dataclass
class Twist(IdlStruct, typename="geometry_msgs::msg::dds_::Twist_"):
    """Velocities."""

    linear: Vector3
    angular: Vector3


@dataclass
class TwistWithCovariance(IdlStruct, typename="geometry_msgs::msg::dds_::TwistWithCovariance_"):
    """Velocities, and how far they may be off."""

    twist: Twist
    covariance: Covariance


@dataclass
class Odometry(IdlStruct, typename="nav_msgs::msg::dds_::Odometry_"):
    """Where a robot believes to be, and how it moves."""

    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance
