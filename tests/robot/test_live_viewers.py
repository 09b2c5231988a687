"""What is shown of a growing map, read by others: HTTP, WebSocket, the mcap library, DDS."""

import base64
import http.client
import json
import socket
import struct
import subprocess
import sys
import time
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.reader import make_reader
from PIL import Image

from echolearn.acoustics.types import Pose
from echolearn.checks import BadValue
from echolearn.robot.live.growing_grid import GrowingGrid
from echolearn.robot.live.live_map import LiveMap, LivePose
from echolearn.robot.live.viewers import Viewers, Viewing

CHILD = Path(__file__).with_name("ros_participant.py")


@pytest.fixture
def live():
    """Return a map of five poses before a wall at y = 2, of which one echo is not believed."""
    found = LiveMap(GrowingGrid(0.1))
    for number in range(5):
        found.add(pose(number))
    found.fit()
    return found


def pose(number):
    place = np.array([0.5 * number, 0.0, 1.25])
    points = np.array([[place[0], 2.0], [9.0, 9.0]])
    sure = np.array([0.9, 0.1])
    heard = np.full(20, 7 * number, dtype=np.uint8)
    return LivePose(number, Pose(place, 0.5), points, sure, sure > 0.5, heard)


def asked(address, path, **headers):
    host = address.removeprefix("http://").rstrip("/")
    connection = http.client.HTTPConnection(host, timeout=5)
    connection.request("GET", path, headers=headers)
    answer = connection.getresponse()
    return answer.status, answer.read()


def test_the_page_tells_what_is_known_and_nothing_else(live, tmp_path, capsys):
    with Viewers(Viewing(port=0), live, folder=tmp_path):
        address = capsys.readouterr().out.removeprefix("page: ").strip()
        status, text = asked(address, "/state.json")
        about = json.loads(text)
        assert status == 200 and about["poses"] == 5 and about["path"][-1] == [2.0, 0.0]
        assert about["points"] == [[0.5 * number, 2.0, 0.9] for number in range(5)]
        [[*start], [*end]] = np.reshape(about["walls"], (2, 2)).round(6).tolist()
        assert sorted([start, end]) == [[0.0, 2.0], [2.0, 2.0]]
        image = np.asarray(Image.open(BytesIO(asked(address, "/grid.png")[1])).convert("L"))
        x, y, columns, rows, side = about["grid"]
        assert image.shape == (rows, columns)
        row, column = rows - 1 - int((2.0 - y) / side + 0.5), int((1.0 - x) / side + 0.5)
        assert image[row, column] < 100 < 205 < image[row + 10, column]  # wall, free, above unknown
        heard = Image.open(BytesIO(asked(address, "/waterfall.png?5")[1]))
        assert np.asarray(heard)[:, 0].tolist() == [0, 7, 14, 21, 28]
        page = asked(address, "/")[1].decode()
        assert "state.json" in page and "http" not in page  # nothing from elsewhere
        assert asked(address, "/../state.json")[0] == 404
        assert asked(address, "/state.json", Host="elsewhere.example:80")[0] == 403
    with pytest.raises(OSError):
        asked(address, "/")


def test_a_port_that_is_taken_is_told(live, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(BadValue, match=f"^port={port} at 127.0.0.1: .*port=0 takes"):
            Viewers(Viewing(port=port), live, folder=tmp_path)


def test_viewers_that_are_not_installed_are_told(live, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(BadValue, match=r"needs foxglove; pip install 'echolearn\[live\]'"):
        Viewers(Viewing(mcap=True), live, folder=tmp_path)


def test_the_recording_is_read_by_others(live, tmp_path):
    for _ in range(2):  # a command that goes on records into the next file
        with Viewers(Viewing(mcap=True), live, folder=tmp_path) as viewers:
            viewers.pose(pose(5))
            viewers.map()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["live-1.mcap", "live-2.mcap"]
    found = {}
    with (tmp_path / "live-2.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            found[channel.topic] = decoded(schema, message.data)
    assert {*found} == {"/pose", "/echoes", "/cloud", "/map", "/walls", "/waterfall"}
    [point] = np.frombuffer(found["/echoes"].data, "<f4").reshape(-1, 4)
    assert np.allclose(point, [2.5, 2.0, 1.25, 0.9])
    assert found["/pose"].pose.position.x == 2.5 and found["/pose"].frame_id == "map"
    assert len(np.frombuffer(found["/cloud"].data, "<f4")) == 4 * 5
    grid = found["/map"]
    cells = np.frombuffer(grid.data, np.int8).reshape(-1, grid.column_count)
    assert cells.shape == live.grid.size[::-1] and {*np.unique(cells)} == {-1, 0, 100}
    [line] = found["/walls"].entities[0].lines
    assert {(round(end.x, 6), round(end.y, 6)) for end in line.points} == {(0.0, 2.0), (2.0, 2.0)}


def decoded(schema, data):
    """Decode a message by the schema that the file carries."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    return kind.FromString(data)


def test_foxglove_is_served_on_this_machine(live, tmp_path, capsys):
    """A handshake by hand (RFC 6455); the first frame says who serves, the next what there is."""
    with Viewers(Viewing(foxglove=0), live, folder=tmp_path):
        said = capsys.readouterr().out
        host, port = said.removeprefix("foxglove: ws://").strip().split(":")
        assert host == "127.0.0.1"
        with socket.create_connection((host, int(port)), timeout=5) as connection:
            key = base64.b64encode(bytes(16)).decode()
            connection.sendall(
                f"GET / HTTP/1.1\r\nHost: {host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
                f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n"
                "Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n".encode()
            )
            file = connection.makefile("rb")
            assert file.readline().split()[1] == b"101"
            while file.readline() != b"\r\n":
                pass
            server, topics = json.loads(frame(file)), json.loads(frame(file))
    assert server["op"] == "serverInfo" and server["name"] == "echolearn live"
    names = {channel["topic"] for channel in topics["channels"]}
    assert {"/pose", "/echoes", "/map", "/walls", "/waterfall", "/health"} <= names


def frame(file):
    """Return the text of an unmasked frame."""
    length = file.read(2)[1]
    if length == 126:
        [length] = struct.unpack(">H", file.read(2))
    elif length == 127:
        [length] = struct.unpack(">Q", file.read(8))
    return file.read(length)


def test_ros_is_spoken_to_another_process(live, tmp_path):
    """Another participant, with types of its own, gets cloud and grid, and tells odometry."""
    with Viewers(Viewing(dds=91), live, folder=tmp_path) as viewers:
        viewers.map()
        child = subprocess.Popen(
            [sys.executable, CHILD, "91"], stdout=subprocess.PIPE, text=True, encoding="utf-8"
        )
        known = None
        for _ in range(600):
            viewers.pose(pose(5))
            known = viewers.odometry() or known
            if child.poll() is not None:
                break
            time.sleep(0.05)
        child.kill()
        heard = json.loads(child.communicate()[0])
    assert known is not None and known.position.tolist() == [3.0, -4.0, 0.5]
    assert abs(known.heading - 0.75) < 1e-12
    assert heard["frame"] == "map" and heard["fields"] == ["x", "y", "z", "confidence"]
    assert np.allclose(heard["points"], [[2.5, 2.0, 1.25, 0.9]])
    width, height = live.grid.size
    assert heard["size"] == [width, height] and heard["resolution"] == pytest.approx(0.1)
    assert heard["origin"] == pytest.approx(live.grid.corner)
    assert heard["cells"].count(100) == 5 and len(heard["cells"]) == width * height


@pytest.mark.parametrize("wrong", [{"port": 65536}, {"foxglove": -1}, {"dds": 233}, {"mcap": 1}])
def test_viewers_that_cannot_be_are_refused(wrong):
    [key] = wrong
    with pytest.raises(BadValue, match=f"^{key}="):
        Viewing(**wrong)
