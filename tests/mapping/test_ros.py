"""Bags for ROS 2, read back by packages that share nothing with the one that wrote them."""

import json
import os
import subprocess
import sys
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from charts import angled, lopsided, nav2
from echolearn.checks import BadValue
from echolearn.cli.main import main
from echolearn.mapping.files import grid, mcap
from echolearn.mapping.files.chart import Chart
from echolearn.robot.survey_map import draw
from world import World

NAMES = ["bag/bag.mcap", "bag/metadata.yaml"]


def messages(bag: bytes) -> dict[str, Any]:
    """Return the one message of each topic."""
    reader = make_reader(BytesIO(bag), validate_crcs=True, decoder_factories=[DecoderFactory()])
    found = list(reader.iter_decoded_messages())
    assert {message.log_time for _, _, message, _ in found} == {0}
    assert [(channel.topic, schema.name) for schema, channel, _, _ in found] == list(
        mcap.TOPICS.items()
    )
    return {channel.topic: message for _, channel, _, message in found}


def cloud(message: Any) -> np.ndarray:
    """Return a PointCloud2 as its own fields describe it, shape (K, 4)."""
    assert not message.is_bigendian and message.row_step == message.point_step * message.width
    assert [(field.datatype, field.count) for field in message.fields] == [(7, 1)] * 4  # FLOAT32
    kind = {
        "names": [field.name for field in message.fields],
        "formats": ["<f4"] * 4,
        "offsets": [field.offset for field in message.fields],
        "itemsize": message.point_step,
    }
    found = np.frombuffer(bytes(message.data), np.dtype(kind))  # type: ignore[call-overload]
    assert found.shape == (message.height * message.width,)
    return np.stack([found[name] for name in ("x", "y", "z", "confidence")], axis=1)


def turn(orientation: Any) -> float:
    """Return the yaw of a quaternion."""
    q = orientation
    return float(np.arctan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2)))


def place(pose: Any) -> list[float]:
    return [pose.position.x, pose.position.y, pose.position.z]


@pytest.mark.parametrize("chart", [lopsided(), angled()], ids=lambda chart: chart.name)
def test_a_bag_says_what_the_other_files_say(chart: Chart) -> None:
    said = messages(mcap.write(chart)["bag/bag.mcap"])
    headers = [message.header for message in said.values()] + [
        pose.header for pose in said["/path"].poses
    ]
    assert {(header.frame_id, header.stamp.sec, header.stamp.nanosec) for header in headers} == {
        ("map", 0, 0)
    }

    seen = chart.drawn
    heights = chart.path[np.arange(len(seen)) // 2, 2]
    points = np.column_stack([chart.map.points, heights, chart.map.confidence])[seen]
    assert (
        np.array_equal(cloud(said["/echoes"]), points.astype(np.float32))
        and said["/echoes"].is_dense
    )

    cells, (x, y, resolution) = nav2(grid.write(chart))
    about = said["/map"].info
    assert (about.height, about.width) == cells.shape and about.resolution == np.float32(resolution)
    assert np.array_equal(np.reshape(said["/map"].data, cells.shape), cells) and {-1, 100} <= {
        *cells.flat
    }
    assert place(about.origin) == [x, y, 0] and turn(about.origin.orientation) == 0

    walk = [stamped.pose for stamped in said["/path"].poses]
    assert np.array_equal([place(pose) for pose in walk], chart.path)
    headings = np.zeros(len(walk)) if chart.headings is None else chart.headings
    assert np.allclose([turn(pose.orientation) for pose in walk], headings)


def test_the_folder_describes_itself_as_ros2_bag_expects() -> None:
    files = mcap.write(angled())
    assert sorted(files) == NAMES
    about = yaml.safe_load(files["bag/metadata.yaml"])["rosbag2_bagfile_information"]
    assert (about["version"], about["storage_identifier"], about["message_count"]) == (8, "mcap", 3)
    assert about["relative_file_paths"] == ["bag.mcap"] and about["compression_mode"] == ""
    topics = [topic["topic_metadata"] for topic in about["topics_with_message_count"]]
    assert {topic["name"]: topic["type"] for topic in topics} == mcap.TOPICS
    for topic in topics:
        [offered] = yaml.safe_load(topic["offered_qos_profiles"])
        assert (offered["durability"], offered["reliability"], offered["depth"]) == (
            1,
            1,
            1,
        )  # rmw: transient local


def test_the_same_map_has_the_same_bytes_at_another_time(tmp_path: Path) -> None:
    code = "import sys; from charts import angled; from echolearn.mapping.files.chart import mcap; "
    code += "sys.stdout.buffer.write(b''.join(mcap.write(angled()).values()))"
    where = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), "PYTHONHASHSEED": "7"}
    run = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, check=True, cwd=tmp_path, env=where
    )
    assert run.stdout == b"".join(mcap.write(angled()).values())


def test_nothing_kept_is_a_bag_of_an_empty_cloud() -> None:
    chart = lopsided()
    chart.map.kept[:] = False
    said = messages(mcap.write(chart)["bag/bag.mcap"])
    assert (
        len(cloud(said["/echoes"])) == 0
        and {*said["/map"].data} == {-1}
        and len(said["/path"].poses) == 3
    )


def content(folder: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def test_a_finished_map_gets_its_bag_and_loses_it_again(
    world: World, packed: Path, tmp_path: Path
) -> None:
    survey = world.runs / "survey" / "hall_0dB"
    given: dict[str, Any] = {"survey": survey, "bundle": packed, "runs": tmp_path}
    plain = content(draw(**given))
    folder = draw(**given, ros=True)
    with_bag = content(folder)
    assert sorted(with_bag.keys() - plain.keys()) == NAMES
    assert {name for name in plain if plain[name] != with_bag[name]} == {"manifest.json"}
    about = json.loads(with_bag["manifest.json"])
    assert about["inputs"]["ros"] is True and {*NAMES} < about["files"].keys()
    said = messages(with_bag["bag/bag.mcap"])
    table_rows = [line.split(",") for line in with_bag["map.csv"].decode().splitlines()[1:]]
    shown = [row for row in table_rows if row[-1] == "1" and np.sin(float(row[5])) > 0.5]
    points = np.array(
        [[float(row[1]), float(row[2]), float(row[8])] for row in shown], dtype=np.float32
    )
    assert len(points) > 0 and np.array_equal(cloud(said["/echoes"])[:, [0, 1, 3]], points)
    assert np.array_equal(np.reshape(said["/map"].data, nav2(with_bag)[0].shape), nav2(with_bag)[0])
    walk = [
        [*place(stamped.pose), turn(stamped.pose.orientation)] for stamped in said["/path"].poses
    ]
    poses = np.loadtxt(survey / "poses.csv", delimiter=",", skiprows=1, usecols=(1, 2, 3, 4))
    assert np.array_equal([pose[:3] for pose in walk], poses[:, :3])
    assert np.allclose(np.exp(1j * np.array([pose[3] for pose in walk])), np.exp(1j * poses[:, 3]))
    (folder / "bag" / "bag.mcap").write_bytes(b"torn")
    assert content(draw(**given, ros=True)) == with_bag
    assert content(draw(**given)) == plain and not (folder / "bag").exists()


def test_without_the_library_one_line_and_nothing_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    monkeypatch.chdir(tmp_path)
    assert main(["map", "survey=nowhere", "bundle=nowhere", "ros=true"]) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "ros=true: needs rosbags; pip install 'echolearn[ros]'" in said
    assert [*tmp_path.iterdir()] == []
    with pytest.raises(BadValue, match="ros=yes: true or false"):
        draw(survey=tmp_path, bundle=tmp_path, runs=tmp_path, ros="yes")  # type: ignore[arg-type]
