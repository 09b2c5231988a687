"""Bags for ROS 2, read back by packages that share nothing with the one that wrote them."""

from io import BytesIO

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from echolearn.mapping.files import grid, mcap, ply
from mapped_walks import angled, lopsided, nav2

TOPICS = {
    "/echoes": "sensor_msgs/msg/PointCloud2",
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/path": "nav_msgs/msg/Path",
}


def decoded(bag):
    """Return the one message of each topic."""
    reader = make_reader(BytesIO(bag), validate_crcs=True, decoder_factories=[DecoderFactory()])
    found = list(reader.iter_decoded_messages())
    assert {message.log_time for _, _, message, _ in found} == {0}
    assert {channel.topic: schema.name for schema, channel, _, _ in found} == TOPICS
    return {channel.topic: message for _, channel, _, message in found}


def points(message):
    """Return a PointCloud2 as its own fields describe it, shape (K, 4)."""
    assert not message.is_bigendian and message.row_step == message.point_step * message.width
    assert [(field.datatype, field.count) for field in message.fields] == [(7, 1)] * 4  # FLOAT32
    kind = {
        "names": [field.name for field in message.fields],
        "formats": ["<f4"] * 4,
        "offsets": [field.offset for field in message.fields],
        "itemsize": message.point_step,
    }
    found = np.frombuffer(bytes(message.data), np.dtype(kind))
    return np.stack([found[name] for name in ("x", "y", "z", "confidence")], axis=1)


def turn(orientation):
    """Return the yaw of a quaternion."""
    q = orientation
    return float(np.arctan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2)))


def place(pose):
    return [pose.position.x, pose.position.y, pose.position.z]


@pytest.mark.parametrize("walk", [lopsided(), angled()])
def test_a_bag_says_what_the_other_files_say(walk):
    found = decoded(mcap.write(walk)["bag/bag.mcap"])
    headers = [message.header for message in [*found.values(), *found["/path"].poses]]
    stamps = {(header.frame_id, header.stamp.sec, header.stamp.nanosec) for header in headers}
    assert stamps == {("map", 0, 0)}

    assert np.array_equal(points(found["/echoes"]), ply.cloud(walk))
    assert found["/echoes"].is_dense

    cells, (x, y, resolution) = nav2(grid.write(walk))
    about = found["/map"].info
    assert (about.height, about.width) == cells.shape and about.resolution == np.float32(resolution)
    assert np.array_equal(np.reshape(found["/map"].data, cells.shape), cells)
    assert place(about.origin) == [x, y, 0] and turn(about.origin.orientation) == 0

    poses = [stamped.pose for stamped in found["/path"].poses]
    assert np.array_equal([place(pose) for pose in poses], walk.path)
    headings = [pose.heading for pose in walk.poses]
    assert np.allclose([turn(pose.orientation) for pose in poses], headings)


def test_the_folder_describes_itself_as_ros2_bag_expects():
    files = mcap.write(angled())
    about = yaml.safe_load(files["bag/metadata.yaml"])["rosbag2_bagfile_information"]
    assert (about["version"], about["storage_identifier"], about["message_count"]) == (8, "mcap", 3)
    assert about["relative_file_paths"] == ["bag.mcap"] and about["compression_mode"] == ""
    topics = [topic["topic_metadata"] for topic in about["topics_with_message_count"]]
    assert {topic["name"]: topic["type"] for topic in topics} == TOPICS
    for topic in topics:
        [offered] = yaml.safe_load(topic["offered_qos_profiles"])
        # In rmw's numbers: transient local, reliable.
        assert (offered["durability"], offered["reliability"], offered["depth"]) == (1, 1, 1)


def test_nothing_kept_is_a_bag_of_an_empty_cloud():
    walk = lopsided()
    walk.map.kept[:] = False
    found = decoded(mcap.write(walk)["bag/bag.mcap"])
    assert len(points(found["/echoes"])) == 0 and {*found["/map"].data} == {-1}
    assert len(found["/path"].poses) == 3
