"""Sets of walks: paths before walls, records that depend on nothing else, bytes that stay."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.rooms import bounds, inside, outline
from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.streams import stream
from echolearn.acoustics.types import Pose, Room
from echolearn.cli.commands import verify_folder
from echolearn.dataset.drawn_rooms import CLEARANCE, OUTLINES, room_around
from echolearn.dataset.generate import generate
from echolearn.dataset.labelled_set import Dataset
from echolearn.dataset.walk_plan import SPIRAL, WalkPlan
from echolearn.dataset.walk_records import walk_records
from echolearn.dataset.walk_set import WalkSet
from echolearn.runtime.engines.processes import Processes
from echolearn.runtime.engines.serial import Serial
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.white import White
from echolearn.simulation.observe import observe
from echolearn.simulation.paths import PATHS
from echolearn.simulation.realism import Realism
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.storage import manifests
from echolearn.walls.hypotheses import hypotheses
from echolearn.walls.walk import lags_needed
from refusals import refused

SCENE = Scene(circular_array(), noise_probe(burst=500, length=4000), Images(), White())
WINDOW = SearchWindow(1.0, 2.0)


@pytest.fixture(scope="module")
def plan():
    """Return a plan of three short walks, two to a shard."""
    return WalkPlan(
        name="few",
        seed=5,
        rows=3,
        poses=6,
        paths=tuple(PATHS),
        rooms=("box", "l_shape"),
        odometry=("white",),
        odometry_error=(0.01, 0.05),
        extent=(1.0, 3.0),
        stride=(0.2, 0.5),
        margin=(0.8, 2.5),
        height=(2.5, 4.0),
        t60=(0.15, 0.25),
        wall_factor=(0.5, 1.0),
        snr_db=(-10.0, 0.0),
        window=WINDOW,
        scene=SCENE,
        shard_rows=2,
    )


@pytest.fixture(scope="module")
def finished(plan, tmp_path_factory):
    """Return the folder of the plan's set; not to be changed."""
    return generate(plan, runs=tmp_path_factory.mktemp("one"), engine=Serial())


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_record_is_what_the_robot_heard_there(plan):
    """Recorded anew with the walk's own generator, and correlated with the burst sum by sum."""
    record = walk_records(plan, range(1, 2))[0]
    rng = stream(5, "observation", 1)
    stroll = plan.stroll(rng)
    assert np.array_equal(stroll.poses, record["poses"])
    levels = {"scene": SCENE, "levels": NoiseLevels(stroll.snr_db), "rng": rng}
    first, last = lags_needed(WINDOW, SCENE.array, sample_rate=22050.0, speed_of_sound=343.0)
    burst = SCENE.probe.samples
    for found, (x, y, z, heading) in zip(record["outputs"], stroll.poses, strict=True):
        pose = Pose(np.array([x, y, z]), float(heading))
        heard, _ = observe(stroll.room, pose, **levels)
        wanted = heard.samples[:, first : last + len(burst)]
        outputs = np.array([np.correlate(each, burst, "valid") for each in wanted])
        outputs /= np.sqrt(np.mean(outputs**2))
        assert np.allclose(found, outputs, atol=4e-3)


def test_what_else_a_record_tells(plan):
    record = walk_records(plan, range(2, 3))[0]
    stroll = plan.stroll(stream(5, "observation", 2))
    sides = outline(stroll.room)
    assert np.array_equal(record["sides"][: len(sides)], sides)
    assert np.isnan(record["sides"][len(sides) :]).all()
    assert (record["group"], record["odometry"]) == (2, b"white")
    assert record["path"].decode() in PATHS and 0.01 <= record["odometry_error"] <= 0.05
    assert record["t60"] == stroll.room.t60 and -10 <= record["snr_db"] <= 0


@pytest.mark.parametrize("name", OUTLINES)
def test_rooms_leave_the_path_its_place(name):
    rng = np.random.default_rng(7)
    for _ in range(5):
        path = PATHS["wandering"](40, extent=np.array([3.0, 2.0]), stride=0.3, rng=rng)[:, :2]
        about = {"margin": (0.8, 3.0), "height": 3.0, "t60": 0.4, "wall_factor": (0.5, 1.0)}
        room, places = room_around(path, name, **about, rng=rng)
        # It is the same path, elsewhere.
        assert np.allclose(places - places[0], path - path[0])
        assert inside(room, np.column_stack([places, np.ones(40)])).all()
        assert (distance_to_outline(places, outline(room)) >= CLEARANCE).all()
        assert len(outline(room)) <= OUTLINES[name]
        if name in ("door", "pillars"):
            ((_, start, end),) = room.doors
            assert end - start == pytest.approx(0.9)
            assert len(room.pillars) == (2 if name == "pillars" else 0)


def test_the_walls_of_a_box_are_at_distances_of_their_own():
    """Each uniform over the margin, and none tells of another or of the path."""
    rng = np.random.default_rng(0)
    rows = []
    for _ in range(400):
        path = rng.uniform(0.0, rng.uniform(1.0, 6.0, 2), (9, 2))
        about = {"margin": (1.0, 3.0), "height": 3.0, "t60": 0.4, "wall_factor": (1.0, 1.0)}
        room, places = room_around(path, "box", **about, rng=rng)
        low, high = bounds(room)
        before, after = places.min(axis=0) - low[:2], high[:2] - places.max(axis=0)
        rows.append([*before, *after, *np.ptp(path, axis=0)])
    table = np.array(rows)
    margins = table[:, :4]
    assert margins.min() >= 1.0 - 1e-9 and margins.max() <= 3.0 + 1e-9
    assert margins.mean(axis=0) == pytest.approx([2.0] * 4, abs=0.12)
    correlation = np.corrcoef(table.T) - np.eye(6)
    assert np.abs(correlation[:4]).max() < 0.2


def test_a_room_that_is_given_is_wandered_through_at_the_margin(plan):
    room = Room((5.0, 4.0, 3.0), 0.25)
    given = replace(plan, room=room, margin=(1.2, 2.0), poses=40)
    stroll = given.stroll(np.random.default_rng(0))
    assert stroll.room == room
    assert (stroll.poses[:, :2] >= 1.2 - 1e-9).all()
    assert (stroll.poses[:, :2] <= np.array([3.8, 2.8]) + 1e-9).all()
    narrow = replace(given, margin=(2.0, 2.0))
    with refused("plan.margin=2 m: must leave a place"):
        narrow.stroll(np.random.default_rng(0))


def test_the_spiral_is_the_walk_along_the_walls(plan):
    along = replace(plan, paths=(SPIRAL,), poses=60)
    stroll = along.stroll(np.random.default_rng(0))
    away = distance_to_outline(stroll.poses[:20, :2], outline(stroll.room))
    assert away.min() > 1.0 and away.max() < 1.6


def test_odometry_has_a_frame_of_its_own(plan):
    """Exact poses in it are the true ones, turned and shifted."""
    stroll = replace(plan, odometry=("exact",), poses=30).stroll(np.random.default_rng(0))
    turn = stroll.told[:, 2] - stroll.poses[:, 3]
    assert np.ptp(turn) < 1e-9 and abs(turn[0]) > 0.1
    places = [each[:, 0] + 1j * each[:, 1] for each in (stroll.poses, stroll.told)]
    true, told = (each - each[0] for each in places)
    assert np.allclose(told, true * np.exp(1j * turn[0]))


@pytest.mark.parametrize("engine", [Serial(), Processes(workers=2)])
def test_bytes_are_the_same_for_any_engine_and_interruption(plan, finished, engine, tmp_path):
    place = tmp_path / "data" / finished.name
    if isinstance(engine, Serial):
        # As if it had been killed: a shard, half of another, no manifest.
        shutil.copytree(finished, place)
        (place / manifests.MANIFEST).unlink()
        second = place / manifests.shard_name(1)
        second.write_bytes(second.read_bytes()[:1000])
        manifests.write_shard(place, 0, array=np.load(place / manifests.shard_name(0)))
    assert generate(plan, runs=tmp_path, engine=engine) == place
    assert contents(place) == contents(finished)


def test_a_set_of_walks_is_verified_and_read_as_a_robot_knows_it(plan, finished, tmp_path):
    manifest = verify_folder(finished)
    walks = WalkSet(finished)
    assert (len(walks), walks.manifest["rows"], manifest is not None) == (3, 3, True)
    record = walk_records(plan, range(2, 3))[0]
    assert walks[2].tobytes() == record.tobytes()
    heard = walks.heard(2)
    assert np.array_equal(heard.poses, record["told"])
    assert np.array_equal(heard.outputs, record["outputs"])
    assert len(hypotheses(heard, count=3)) <= 3
    with refused("row=3: must be from 0 to 2"):
        walks[3]

    copy = shutil.copytree(finished, tmp_path / finished.name)
    damaged = copy / manifests.shard_name(0)
    content = bytearray(damaged.read_bytes())
    content[-9] ^= 4
    damaged.write_bytes(content)
    with refused(str(damaged)):
        WalkSet(copy)
    with refused("folder="):
        WalkSet(shutil.move(copy, tmp_path / "few-0123456789ab"))


def test_sets_of_walks_and_of_echoes_are_not_taken_for_each_other(finished):
    with refused(f"set={finished}: must be a folder that echolearn generate wrote"):
        Dataset(finished)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("rows", 0),
        ("poses", 1),
        ("paths", ("circle",)),
        ("rooms", ()),
        ("odometry", ("white", "white")),
        ("margin", (0.1, 2.0)),
        ("snr_db", (5.0, -5.0)),
        ("role", "play"),
    ],
)
def test_plans_that_cannot_be_are_refused(plan, field, value):
    with refused(f"plan.{field}="):
        replace(plan, **{field: value})


def test_a_realistic_walk_goes_the_same_way_and_hears_otherwise(plan):
    """What is not ideal changes what is heard, always alike, and not where the robot goes."""
    ranges = Realism(microphone_db=(1.0, 1.0))
    real = replace(plan, realism=ranges, poses=2)
    first, again = walk_records(real, range(1)), walk_records(real, range(1))
    clean = walk_records(replace(plan, poses=2), range(1))
    assert first.tobytes() == again.tobytes()
    assert not np.allclose(first["outputs"], clean["outputs"], atol=0.01)
    assert np.array_equal(first["poses"], clean["poses"])
