"""A study from end to end: its figures, its resumption, its refusals."""

import csv
import os
import shutil
import time
from contextlib import nullcontext
from dataclasses import replace

import numpy as np
import pytest

from echolearn.acoustics.geometry import circular_array, true_echoes
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Room
from echolearn.checks import BadValue
from echolearn.cli import config
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.joint import Joint
from echolearn.simulation.noise.white import White
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.storage import manifests
from echolearn.storage.identity import plain
from echolearn.studies import curves, study
from echolearn.studies.study import Study
from echolearn.studies.trials import METRICS

EXPERIMENTS = sorted(path.stem for path in (config.folder() / "experiment").glob("*.yaml"))
SMALL = Study(
    "snr_db",
    [-30.0, 10.0],
    Room((6.0, 5.0, 6.0), 0.25),
    Scene(circular_array(), noise_probe(length=8000), Images(), White()),
    {"gated": Gated(azimuths=36), "joint": Joint(azimuths=36)},
    positions=4,
    trials=12,
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return study.run(SMALL, name="small", runs=tmp_path_factory.mktemp("runs"), resamples=50)


def rows(folder):
    with (folder / "study.csv").open() as file:
        return list(csv.DictReader(file))


def share(folder, **where):
    [row] = [row for row in rows(folder) if all(row[key] == value for key, value in where.items())]
    return float(row["value"]), float(row["ci_low"]), float(row["ci_high"])


def content(folder):
    return {
        path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()
    }


def test_estimators_are_perfect_in_quiet_and_guess_in_noise(folder):
    for localizer in ("gated", "joint"):
        value, low, high = share(folder, localizer=localizer, snr_db="10.0", metric="on_map")
        assert value == high == 1.0
        assert 0.7 < low < 0.8  # Wilson's for 12 of 12
        assert share(folder, localizer=localizer, snr_db="-30.0", metric="toa")[0] < 0.7
    chance = share(folder, localizer="chance", snr_db="10.0", metric="toa")
    assert chance == share(folder, localizer="chance", snr_db="-30.0", metric="toa")
    assert 0.03 < chance[1] < chance[0] < chance[2] < 0.3


def test_table_figures_and_csv_are_there(folder):
    assert len(rows(folder)) == 2 * 3 * 4
    assert {"study.csv", "study.md", "figures/toa_doa.svg", "figures/map.svg"} <= {
        str(name) for name in content(folder)
    }
    assert "| joint | " in (folder / "study.md").read_text()
    assert manifests.verify(folder)["kind"] == "study"


def test_an_interrupted_study_goes_on_and_ends_the_same(folder, tmp_path):
    whole = content(folder)
    again = study.run(SMALL, name="small", runs=tmp_path, resamples=50, workers=2)
    assert content(again) == whole
    [estimates] = again.glob("estimates-*")
    kept = estimates / manifests.shard_name(0)
    before = kept.stat().st_mtime_ns
    (again / manifests.MANIFEST).unlink()
    (estimates / manifests.shard_name(1)).unlink()
    study.run(SMALL, name="small", runs=tmp_path, resamples=50)
    assert content(again) == whole
    assert kept.stat().st_mtime_ns == before


OTHERS = [
    {"values": [20.0]},
    {"values": [10.0, 20.0]},
    {"trials": 5},
    {"seed": 1},
    {"localizers": {"joint": Joint()}},
]


@pytest.mark.parametrize("left", ["finished", "damaged", "no manifest", "no estimates"])
def test_a_study_of_that_name_with_other_settings_is_refused(tmp_path, left):
    one = replace(SMALL, values=[10.0], positions=2, trials=4)
    folder = study.run(one, name="small", runs=tmp_path, resamples=20)
    if left == "damaged":
        (folder / "study.csv").write_bytes(b"half")
    if left == "no manifest":
        (folder / manifests.MANIFEST).unlink()
    if left == "no estimates":
        shutil.rmtree(next(folder.glob("estimates-*")))
    before = content(tmp_path)
    said = f"name=small: a study made with the same settings, or a new name; remove {folder} to make it anew"
    for change in OTHERS:
        with pytest.raises(BadValue) as refused:
            study.run(replace(one, **change), name="small", runs=tmp_path, resamples=20)
        assert str(refused.value) == said
    assert content(tmp_path) == before
    study.run(one, name="small", runs=tmp_path, resamples=20)
    assert manifests.verify(folder)["study"] == plain(one)


def test_other_intervals_and_an_older_format_are_made_from_the_same_estimates(tmp_path):
    one = replace(SMALL, values=[10.0], positions=2, trials=4)
    folder = study.run(one, name="small", runs=tmp_path, resamples=20)
    [estimates] = folder.glob("estimates-*/*.npy")
    whole, before = content(folder), estimates.stat().st_mtime_ns
    about = {
        key: value
        for key, value in manifests.verify(folder).items()
        if key not in ("files", "sha256")
    }
    (folder / "study.md").write_text("as it was")
    manifests.finish(folder, about | {"format": 0}, ["study.csv", "study.md"])
    study.run(one, name="small", runs=tmp_path, resamples=20)
    assert content(folder) == whole
    study.run(one, name="small", runs=tmp_path, resamples=30)
    assert manifests.verify(folder)["resamples"] == 30
    assert estimates.stat().st_mtime_ns == before


@pytest.mark.parametrize("seed", [0, 1])
def test_of_two_at_once_the_second_finds_it_finished_or_is_refused(tmp_path, seed):
    one = replace(SMALL, values=[0.0, 10.0])
    child = os.fork()
    if child == 0:
        study.run(one, name="small", runs=tmp_path, resamples=20)
        os._exit(0)
    while not (tmp_path / "study").exists():
        time.sleep(0.001)
    second = replace(one, seed=seed)
    with (
        nullcontext()
        if seed == 0
        else pytest.raises(BadValue, match="^name=small: a study made with the same")
    ):
        study.run(second, name="small", runs=tmp_path, resamples=20)
    assert os.waitpid(child, 0)[1] == 0
    assert manifests.verify(tmp_path / "study" / "small")["study"] == plain(one)
    assert [path.name for path in (tmp_path / "study").iterdir()] == ["small"]


def test_both_walls_of_a_corner_can_be_found():
    poses = replace(SMALL, positions=30, trials=30).poses()
    window = SMALL.window.lags(SMALL.scene.array, 22050.0, 343.0)
    for pose in poses:
        near = np.sort(true_echoes(SMALL.room, pose, SMALL.scene.array).toa)[:2] * 22050
        assert window[0] <= near.min() < near.max() <= window[1]


def test_corners_are_those_of_the_room_and_walls_in_either_order():
    poses = replace(SMALL, positions=40, trials=40).poses()
    places = np.array([pose.position for pose in poses])
    walls = np.array([[x, 6.0 - x, y, 5.0 - y] for x, y, _ in places])
    assert np.allclose(np.sort(walls, axis=1)[:, :2], [1.0, 1.5])
    order = np.minimum(walls[:, 0], walls[:, 1]) < 1.2
    corners = {
        (bool(x > 3), bool(y > 2.5), bool(first))
        for (x, y, _), first in zip(places, order, strict=True)
    }
    assert len(corners) == 8 and (places[:, 2] == 3.0).all()


def test_every_position_has_a_burst_of_its_own_or_all_have_the_scenes():
    bursts = [SMALL.heard(position).probe for position in range(4)]
    assert len({probe.samples.tobytes() for probe in bursts}) == 4
    assert all(
        abs(probe.samples.std() - 1) < 0.1 and len(probe.samples) == 1500 for probe in bursts
    )
    assert {(probe.length, probe.sample_rate) for probe in bursts} == {(8000, 22050.0)}
    assert np.array_equal(SMALL.heard(2).probe.samples, bursts[2].samples)
    assert replace(SMALL, bursts="one").heard(2) is SMALL.scene
    other = study.listen(replace(SMALL, bursts="one"), -10.0)["hit"]
    assert not np.array_equal(other, study.listen(SMALL, -10.0)["hit"])


def test_low_places_have_two_walls_and_the_floor_within_the_authors_window():
    """By the images' paths: both walls at all heights, the floor up to 1.9 m, where the window
    ends, nothing else."""
    low = replace(SMALL, room=Room((10.0, 8.0, 5.0), 0.6), places="low", positions=20, trials=20)
    poses, ring = low.poses(), circular_array()
    assert {(*pose.position[:2], pose.heading) for pose in poses} == {(1.0, 1.5, np.pi / 2)}
    heights = sorted(pose.position[2] for pose in poses)
    assert np.allclose(heights, np.arange(1.025, 2.0, 0.05))
    for pose in poses:
        mirrored = [
            np.where(np.arange(3) == axis, -pose.position, pose.position) for axis in range(3)
        ]
        paths = np.linalg.norm(mirrored - (pose.position + [0.0, 0.2, 0.0]), axis=1)
        near = np.sort(paths * 22050 / 343)[: 3 if pose.position[2] < 1.89 else 2]
        assert 116 < near[0] < near[-1] < 244
        toa = np.sort(true_echoes(low.room, pose, ring).toa * 22050)
        assert np.allclose(toa[: len(near)], near)
        assert toa[len(near)] > 244


WALK = replace(SMALL, room=Room((8.0, 6.0, 5.0), 0.6), places="walk", positions=60, trials=60)


@pytest.mark.parametrize("size", [(8.0, 6.0, 5.0), (13.0, 11.0, 5.0)])
def test_every_pose_of_a_walk_can_give_a_map_point(size):
    poses = replace(WALK, room=Room(size, 0.6)).poses()
    places = np.array([pose.position[:2] for pose in poses])
    walls = np.hstack([places, np.array(size[:2]) - places])
    nearest = walls.min(axis=1)
    assert nearest.min() >= 1.0
    assert nearest.max() <= 2.0
    assert (walls < 2.0).any(axis=0).all()  # each of the four is walked along
    assert len(np.unique(places, axis=0)) == 60
    assert np.ptp(np.unwrap([pose.heading for pose in poses])) > np.pi


def test_another_seed_walks_elsewhere_and_both_come_back():
    here, there = WALK.poses(), replace(WALK, seed=1).poses()
    assert not np.isin([pose.heading for pose in here], [pose.heading for pose in there]).any()
    assert [pose.heading for pose in WALK.poses()] == [pose.heading for pose in here]


def test_along_a_walk_quiet_recordings_give_every_attainable_point():
    walk = replace(WALK, localizers={"joint": Joint()}, positions=12, trials=12)
    assert study.listen(walk, 20.0)["hit"][:, 0, METRICS.index("on_map")].tolist() == [1.0] * 12


@pytest.mark.parametrize(("snr_db", "pings"), [(-20.0, 10), (-30.0, 100)])
def test_ten_times_the_pings_hear_ten_decibels_deeper(snr_db, pings):
    """Joint keeps 90 % of the map near two walls where a single ping leaves little more than
    chance."""
    papers = {
        "room": Room((10.0, 8.0, 5.0), 0.6),
        "scene": replace(SMALL.scene, probe=noise_probe()),
    }
    varied = {
        "vary": "pings",
        "values": [1, pings],
        "snr_db": snr_db,
        "localizers": {"joint": Joint()},
    }
    deep = replace(SMALL, trials=24, **papers, **varied)
    one, many = (
        study.listen(deep, value)["hit"][:, 0].mean(axis=0)[METRICS.index("on_map")]
        for value in (1, pings)
    )
    assert many >= 0.9
    assert one <= 0.5


def test_faults_stand_in_the_order_in_which_they_are_given():
    faults = ["positions_5mm", "none", "one_dead"]
    assert replace(SMALL, vary="fault", values=faults).values == faults


def test_keys_that_came_later_leave_older_studies_their_identity():
    assert not {"pings", "places"} & plain(replace(SMALL, places="".join("corners"))).keys()
    assert plain(replace(SMALL, pings=2))["pings"] == 2
    assert plain(WALK)["places"] == "walk"


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_can_be_built(name):
    [(_, about)] = config.compose("study", [f"experiment={name}"])
    keys = config.without(
        about, "choice rir noise diffuse page name runs workers resamples command"
    )
    built = Study(**config.build(keys, "study"))
    assert about["name"] == {"attainable": "attainable_8x6x5"}.get(name, name)
    assert built.trials >= 50
    assert len(built.values) >= 4


@pytest.mark.parametrize(
    ("vary", "values"),
    [
        ("snr_db", [-10, -7.5, 0, 40]),
        ("pings", [1, 2, 8, 10]),
        ("fault", ["none", "one_dead"]),
        ("stretch", [1, 2, 3]),
    ],
)
def test_equal_shares_stand_side_by_side_near_their_value(vary, values):
    stands = np.array(
        [curves.dodged(vary, values, number=number, count=11) for number in range(11)]
    )
    exact = curves.dodged(vary, values, number=None, count=11)
    assert np.allclose(exact, range(len(values)) if vary == "fault" else values)
    assert (np.diff(stands, axis=0) > 0).all()
    assert (stands[-1, :-1] < stands[0, 1:]).all()
    assert np.allclose(stands[5], exact)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"vary": "mood"}, "vary=mood"),
        ({"values": []}, "values="),
        ({"values": [0.0, 0.0]}, "each value once"),
        ({"values": [10.0, 0.0]}, r"^values=\[10.0, 0.0\]: in ascending order"),
        ({"vary": "pings", "values": [1, 10, 5]}, "^values=.* in ascending order"),
        ({"localizers": {"chance": Joint()}}, "^localizers=chance: another name"),
        ({"values": [400.0]}, "snr_db=400.0 dB"),
        ({"vary": "t60", "values": [0.01]}, "room.t60=0.01 s"),
        ({"vary": "fault", "values": ["rust"]}, "values=rust"),
        ({"vary": "sdnr_db", "values": [0.0]}, "sdnr_db"),
        ({"vary": "stretch", "values": [1, 2.5]}, "values=2.5"),
        ({"vary": "stretch", "values": [-1]}, "values=-1"),
        ({"positions": 1}, "positions=1"),
        ({"trials": 3}, "trials=3"),
        ({"pings": 0}, "pings=0"),
        ({"vary": "pings", "values": [1, 2.5]}, "values=2.5"),
        ({"values": [[1.0]]}, r"^values=\[1.0\]: numbers"),
        ({"values": [None]}, "^values=None: numbers"),
        (
            {"walls": (1.0, 40.0)},
            r"^walls=\[1.0, 40.0\] m: the whole array inside the room of 6 x 5 x 6 m; with",
        ),
        (
            {"places": "low", "room": Room((6.0, 5.0, 1.8), 0.25)},
            r"^walls=\[1.0, 1.5\] m: .*places=low",
        ),
        ({"room": replace(SMALL.room, walls=(0.0,) * 6)}, "^room.walls=.*: one that reflects"),
        ({"bursts": "some"}, "bursts=some: one or each"),
        ({"places": "roof"}, "places=roof: corners, low, walk"),
        (
            {"places": "walk", "room": Room((2.5, 6.0, 6.0), 0.25)},
            "^room.size=2.5 x 6 x 6 m: two sides",
        ),
        (
            {"places": "walk", "room": Room((8.0, 6.0, 5.0), 0.6), "positions": 900, "trials": 900},
            "positions=900",
        ),
        ({"localizers": {}}, "localizers"),
    ],
)
def test_bad_input_is_refused(change, message):
    with pytest.raises(BadValue, match=message):
        replace(SMALL, **change)
