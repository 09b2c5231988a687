"""A DDS participant that knows nothing of echolearn: types written from the .msg files of ROS 2.

    python ros_participant.py <domain>

It tells odometry, waits for a cloud and a grid, prints both as JSON, and ends.
"""

import json
import struct
import sys
import time

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

LOCAL = """<CycloneDDS><Domain Id="any"><General><Interfaces><NetworkInterface name="lo"
multicast="false"/></Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery>
<ParticipantIndex>auto</ParticipantIndex><Peers><Peer Address="127.0.0.1"/></Peers></Discovery>
</Domain></CycloneDDS>"""


def struct_of(package, name, /, **fields):
    """Return a type under the name that ROS 2 gives it."""
    return make_idl_struct(name, f"{package}::msg::dds_::{name}_", fields)


Time = struct_of("builtin_interfaces", "Time", sec=types.int32, nanosec=types.uint32)
Header = struct_of("std_msgs", "Header", stamp=Time, frame_id=str)
PointField = struct_of(
    "sensor_msgs",
    "PointField",
    name=str,
    offset=types.uint32,
    datatype=types.uint8,
    count=types.uint32,
)
PointCloud2 = struct_of(
    "sensor_msgs",
    "PointCloud2",
    header=Header,
    height=types.uint32,
    width=types.uint32,
    fields=types.sequence[PointField],
    is_bigendian=bool,
    point_step=types.uint32,
    row_step=types.uint32,
    data=types.sequence[types.uint8],
    is_dense=bool,
)
THREE = dict.fromkeys("xyz", types.float64)
Point = struct_of("geometry_msgs", "Point", **THREE)
Vector3 = struct_of("geometry_msgs", "Vector3", **THREE)
Quaternion = struct_of("geometry_msgs", "Quaternion", **THREE, w=types.float64)
Pose = struct_of("geometry_msgs", "Pose", position=Point, orientation=Quaternion)
Twist = struct_of("geometry_msgs", "Twist", linear=Vector3, angular=Vector3)
COVARIANCE = types.array[types.float64, 36]
PoseWithCovariance = struct_of(
    "geometry_msgs", "PoseWithCovariance", pose=Pose, covariance=COVARIANCE
)
TwistWithCovariance = struct_of(
    "geometry_msgs", "TwistWithCovariance", twist=Twist, covariance=COVARIANCE
)
Odometry = struct_of(
    "nav_msgs",
    "Odometry",
    header=Header,
    child_frame_id=str,
    pose=PoseWithCovariance,
    twist=TwistWithCovariance,
)
MapMetaData = struct_of(
    "nav_msgs",
    "MapMetaData",
    map_load_time=Time,
    resolution=types.float32,
    width=types.uint32,
    height=types.uint32,
    origin=Pose,
)
OccupancyGrid = struct_of(
    "nav_msgs", "OccupancyGrid", header=Header, info=MapMetaData, data=types.sequence[types.int8]
)


def main(number):
    """Take part until a cloud and a grid have come."""
    domain = Domain(number, LOCAL)
    taking = DomainParticipant(number)
    old = Policy.DataRepresentation(use_cdrv0_representation=True)
    qos = Qos(old, Policy.Reliability.Reliable(duration(seconds=1)))
    late = Qos(
        old, Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.TransientLocal
    )
    clouds = DataReader(taking, Topic(taking, "rt/echoes", PointCloud2), qos=qos)
    grids = DataReader(taking, Topic(taking, "rt/map", OccupancyGrid), qos=late)
    odometry = DataWriter(taking, Topic(taking, "rt/odom", Odometry), qos=qos)
    turned = Quaternion(0.0, 0.0, 0.36627252908604757, 0.9305076219123143)  # 0.75 rad about z
    place = PoseWithCovariance(Pose(Point(3.0, -4.0, 0.5), turned), [0.0] * 36)
    still = TwistWithCovariance(Twist(Vector3(0.0, 0.0, 0.0), Vector3(0.0, 0.0, 0.0)), [0.0] * 36)
    told = Odometry(Header(Time(1, 2), "odom"), "base_link", place, still)
    found = {}
    until = time.monotonic() + 20
    while len(found) < 2 and time.monotonic() < until:
        odometry.write(told)
        for name, reader, kind in (("cloud", clouds, PointCloud2), ("grid", grids, OccupancyGrid)):
            # A reader also tells that a writer has gone.
            for each in reader.take(N=10):
                if isinstance(each, kind):
                    found[name] = each
        time.sleep(0.05)
    # Who hears clouds may not be heard yet: participants find each other one way at a time.
    for _ in range(20):
        odometry.write(told)
        time.sleep(0.05)
    del domain
    return found


def described(cloud, grid):
    """Return what came, as plain values."""
    corner = grid.info.origin.position
    return {
        "frame": cloud.header.frame_id,
        "fields": [field.name for field in cloud.fields],
        "points": list(struct.iter_unpack("<4f", bytes(cloud.data))),
        "size": [grid.info.width, grid.info.height],
        "resolution": grid.info.resolution,
        "origin": [corner.x, corner.y],
        "cells": list(grid.data),
    }


if __name__ == "__main__":
    print(json.dumps(described(**main(int(sys.argv[1])))))
