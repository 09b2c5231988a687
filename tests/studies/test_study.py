"""What a study is: its poses and bursts, what it finds, what it refuses."""

from dataclasses import fields, replace

import numpy as np
import pytest

from echolearn.acoustics.polygon_room import PolygonRoom
from echolearn.acoustics.rooms import true_echoes
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Room
from echolearn.checks import BadValue
from echolearn.cli import config, own
from echolearn.cli.compose import compose
from echolearn.localization.methods.joint import Joint
from echolearn.studies.accuracy import METRICS
from echolearn.studies.estimates import estimate
from echolearn.studies.study import Study

EXPERIMENTS = sorted(path.stem for path in (own.folder() / "experiment").glob("*.yaml"))
ON_MAP = METRICS.index("on_map")
HALL = Room((8.0, 6.0, 5.0), 0.6)
TRIANGLE = PolygonRoom(((0.0, 0.0), (9.0, 0.0), (4.0, 8.0)), 5.0, 0.4)


@pytest.fixture
def walk(small):
    """Return a study along walks."""
    return replace(small, room=HALL, places="walk", positions=60, trials=60)


def test_corners_are_those_of_the_room_and_walls_in_either_order(small):
    poses = replace(small, positions=40, trials=40).poses()
    places = np.array([pose.position for pose in poses])
    walls = np.array([[x, 6.0 - x, y, 5.0 - y] for x, y, _ in places])
    assert np.allclose(np.sort(walls, axis=1)[:, :2], [1.0, 1.5])
    order = walls[:, :2].min(axis=1) < 1.2
    assert len(np.unique(np.column_stack([places[:, :2] > (3.0, 2.5), order]), axis=0)) == 8
    assert (places[:, 2] == 3.0).all()
    first, last = small.window.lags(small.scene.array, 22050.0)
    for pose in poses:
        nearest = np.sort(true_echoes(small.room, pose, array=small.scene.array).toa)[:2] * 22050
        assert first <= nearest.min() < nearest.max() <= last


def test_every_position_has_a_burst_of_its_own_or_all_have_the_scenes(small):
    [pose, *_] = small.poses()
    probes = [small.position(number, pose).scene.probe for number in range(4)]
    assert len({probe.samples.tobytes() for probe in probes}) == 4
    for probe in probes:
        assert abs(probe.samples.std() - 1) < 0.1
        assert (len(probe.samples), probe.length, probe.sample_rate) == (1500, 8000, 22050.0)
    again = small.position(2, pose).scene.probe.samples
    assert np.array_equal(again, probes[2].samples)
    one = replace(small, bursts="one")
    assert one.position(2, pose).scene is small.scene
    assert not np.array_equal(estimate(one, -10.0)["hit"], estimate(small, -10.0)["hit"])


@pytest.mark.parametrize("size", [(8.0, 6.0, 5.0), (13.0, 11.0, 5.0)])
def test_every_pose_of_a_walk_can_give_a_map_point(walk, size):
    poses = replace(walk, room=Room(size, 0.6)).poses()
    places = np.array([pose.position[:2] for pose in poses])
    walls = np.hstack([places, np.array(size[:2]) - places])
    nearest = walls.min(axis=1)
    assert 1.0 <= nearest.min() <= nearest.max() <= 2.0
    assert (walls < 2.0).any(axis=0).all()  # each of the four is walked along
    assert len(np.unique(places, axis=0)) == 60
    assert np.ptp(np.unwrap([pose.heading for pose in poses])) > np.pi


def test_another_seed_walks_elsewhere_and_both_come_back(walk):
    def headings(study):
        return [pose.heading for pose in study.poses()]

    assert not {*headings(walk)} & {*headings(replace(walk, seed=1))}
    assert headings(walk) == headings(walk)


def test_along_a_walk_quiet_recordings_give_every_attainable_point(walk):
    walk = replace(walk, localizers={"joint": Joint()}, positions=12, trials=12)
    assert estimate(walk, 20.0)["hit"][:, 0, ON_MAP].all()


@pytest.mark.parametrize(("snr_db", "pings"), [(-20.0, 10), (-30.0, 100)])
def test_ten_times_the_pings_are_worth_ten_decibels(small, snr_db, pings):
    """Joint keeps 90 % of the map where a single ping leaves little more than chance."""
    deep = replace(
        small,
        vary="pings",
        values=[1, pings],
        snr_db=snr_db,
        room=Room((10.0, 8.0, 5.0), 0.6),
        scene=replace(small.scene, probe=noise_probe()),
        localizers={"joint": Joint()},
        trials=24,
    )
    one, many = (estimate(deep, value)["hit"][:, 0, ON_MAP].mean() for value in deep.values)
    assert many >= 0.9
    assert one <= 0.5


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_can_be_built(name):
    [(_, about)] = compose("study", [f"experiment={name}"])
    keys = {field.name: about[field.name] for field in fields(Study)}
    built = Study(**config.build(keys, "study"))
    assert about["name"] == {"attainable": "attainable_8x6x5"}.get(name, name)
    assert built.trials >= 50
    assert len(built.values) >= 4


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"vary": "mood"}, "^vary=mood: must be one of snr_db, "),
        ({"values": []}, r"^values=\[\]: must be at least one"),
        ({"values": [0.0, 0.0]}, "must be each value once"),
        ({"values": [10.0, 0.0]}, r"^values=\[10.0, 0.0\]: must be in ascending order"),
        ({"vary": "pings", "values": [1, 10, 5]}, "^values=.* must be in ascending order"),
        ({"values": [400.0]}, "^snr_db=400.0 dB"),
        ({"vary": "t60", "values": [0.01]}, "^room.t60=0.01 s"),
        ({"vary": "fault", "values": ["rust"]}, "^values=rust: must be names of faults: none, "),
        ({"vary": "sdnr_db", "values": [0.0]}, "^sdnr_db"),
        ({"vary": "stretch", "values": [1, 2.5]}, "^values=2.5"),
        ({"vary": "stretch", "values": [-1]}, "^values=-1"),
        ({"vary": "pings", "values": [1, 2.5]}, "^pings=2.5"),
        ({"values": [[1.0]]}, r"^values=\[1.0\]: must be numbers"),
        ({"values": [None]}, "^values=None: must be numbers"),
        ({"localizers": {}}, "^localizers={}: must be at least one"),
        ({"localizers": {"chance": Joint()}}, "^localizers=chance: must have another name"),
        ({"positions": 1}, "^positions=1"),
        ({"trials": 3}, "^trials=3"),
        ({"pings": 0}, "^pings=0"),
        ({"bursts": "some"}, "^bursts=some: must be one of one, each"),
        ({"places": "roof"}, "^places=roof: must be one of corners, walk"),
        ({"walls": (1.0, 40.0)}, r"^walls=\[1.0, 40.0\] m: places=corners puts the robot outside"),
        ({"room": Room((6.0, 5.0, 6.0), 0.25, (0.0,) * 6)}, "^room.walls=.* at least one wall"),
        (
            {"places": "walk", "room": Room((2.5, 6.0, 6.0), 0.25)},
            "^room.size=2.5 x 6 x 6 m: must have two",
        ),
        (
            {"places": "walk", "room": HALL, "positions": 900, "trials": 900},
            "^positions=900: must be at most",
        ),
        ({"room": TRIANGLE}, "^places=corners: must be walk where the room is no box"),
    ],
)
def test_bad_input_is_refused(small, change, message):
    with pytest.raises(BadValue, match=message):
        replace(small, **change)
