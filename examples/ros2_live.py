"""A thin ROS 2 node: recordings and odometry in, believed points out. Not tried where ROS is.

    ros2 run ... or:  python ros2_live.py --ros-args -p bundle:=best -p survey:=recorded

    /odom        nav_msgs/Odometry          in: where the robot is
    /recording   std_msgs/String            in: name of a WAV file in the survey's folder, recorded
                                            at the last pose; it must be whole
    /echoes      sensor_msgs/PointCloud2    out: x, y, z, confidence of the echoes that are believed

The survey needs `survey.yaml` and `probe.wav`. Nothing is mended: `echolearn check` tells whether
anything has to be.
"""

import math
from pathlib import Path

import numpy as np
import rclpy
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import String

from echolearn.acoustics.types import Pose
from echolearn.checks import BadValue
from echolearn.robot.choices import suited
from echolearn.robot.scorer import load
from echolearn.survey.growing import survey_at
from echolearn.survey.reader import read_described


class Echoes(Node):
    """Scores a recording when its name comes."""

    def __init__(self) -> None:
        super().__init__("echolearn")
        bundle = self.declare_parameter("bundle", "best").value
        folder = self.declare_parameter("survey", "recorded").value
        self.scorer = load(bundle)
        about = read_described(Path(folder))
        self.survey = suited(about, self.scorer.bundle, resample=False, direct=None)
        self.number = 0
        self.pose: Pose | None = None
        self.points = self.create_publisher(PointCloud2, "echoes", 10)
        self.create_subscription(Odometry, "odom", self.moved, 10)
        self.create_subscription(String, "recording", self.recorded, 10)

    def moved(self, said: Odometry) -> None:
        """Keep where the robot is."""
        place, turn = said.pose.pose.position, said.pose.pose.orientation
        yaw = 2 * (turn.w * turn.z + turn.x * turn.y), 1 - 2 * (turn.y**2 + turn.z**2)
        self.pose = Pose(np.array([place.x, place.y, place.z]), math.atan2(*yaw))

    def recorded(self, said: String) -> None:
        """Score a recording, and publish its points."""
        if self.pose is None:
            self.get_logger().warning("a recording before any odometry")
            return
        x, y, z = self.pose.position.tolist()
        cells = {"index": self.number, "x_m": x, "y_m": y, "z_m": z}
        cells |= {"heading_rad": self.pose.heading, "file": said.data}
        self.number += 1
        try:
            observation = survey_at(self.survey, cells).observe([0])
            found = self.scorer.score(observation, [self.pose]).map
        except BadValue as error:
            self.get_logger().warning(str(error))
            return
        kept = found.points[np.asarray(found.kept)]
        believed = found.confidence[np.asarray(found.kept)]
        rows = np.column_stack([kept, np.full(len(kept), z), believed]).astype("<f4")
        cloud = PointCloud2(height=1, width=len(rows), point_step=16, row_step=rows.nbytes)
        cloud.header.stamp = self.get_clock().now().to_msg()
        cloud.header.frame_id = "map"
        for place, name in enumerate(("x", "y", "z", "confidence")):
            kind = PointField.FLOAT32
            cloud.fields.append(PointField(name=name, offset=4 * place, datatype=kind, count=1))
        cloud.data = rows.tobytes()
        cloud.is_dense = True
        self.points.publish(cloud)


if __name__ == "__main__":
    rclpy.init()
    rclpy.spin(Echoes())
