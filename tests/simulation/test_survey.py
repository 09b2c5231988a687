"""Simulated walks: the recordings are those of the poses, the folder is whole, always the same, and
nobody else's."""

import math
import shutil
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar

import numpy as np
import pytest

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.rooms import outline
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Room
from echolearn.checks import BadValue
from echolearn.comparison.localized import localize_survey
from echolearn.localization.methods.gated import Gated
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.diffuse import Diffuse
from echolearn.simulation.noise.rotor import Rotor
from echolearn.simulation.noise.white import White
from echolearn.simulation.observe import observe
from echolearn.simulation.rir.pyroom import Pyroom
from echolearn.simulation.scene import Scene
from echolearn.simulation.survey import noise_length, survey
from echolearn.simulation.walk import trajectory
from echolearn.storage import journal, manifests
from echolearn.survey import reader
from refusals import refused

ROOM = Room((5.0, 4.5, 3.0), 0.2)
HUGE = Scene(circular_array(microphones=32), noise_probe(length=1 << 20), Pyroom(), White())
OTHERS = r"^name=few: .* was made with others, .*\Z"


@pytest.fixture(scope="module")
def walk(brief):
    """Return a function that surveys a small room at four poses."""

    def walked(runs, **changes):
        given = {"snr_db": 5.0, "sdnr_db": None, "pings": 1} | changes
        levels = NoiseLevels(given.pop("snr_db"), given.pop("sdnr_db"), given.pop("pings"))
        usual = {"name": "few", "room": ROOM, "scene": brief, "poses": 4, "runs": runs}
        return survey(levels=levels, **usual | given)

    return walked


@pytest.fixture(scope="module")
def finished(walk, tmp_path_factory):
    """Return the folder below which the survey lies; not to be changed."""
    return walk(tmp_path_factory.mktemp("survey"))


@pytest.fixture
def copy(finished, tmp_path):
    """Return a copy of the survey, below `tmp_path`."""
    return copied(finished, tmp_path)


def copied(folder, runs):
    """Copy a survey below another folder."""
    return shutil.copytree(folder, runs / "survey" / folder.name, dirs_exist_ok=True)


def contents(folder):
    """Return every file's bytes by name."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def expected_at(pose, scene, index, levels):
    """Return what pose p records, whose noise is from `SeedSequence(seed, spawn_key=(p,))`."""
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(index,)))
    return observe(ROOM, pose, scene=scene, levels=levels, rng=rng)[0].samples


@contextmanager
def writes_nothing(runs, message):
    """Expect a refusal before anything is written."""
    with refused(message):
        yield
    assert not any(path.is_file() for path in runs.rglob("*"))


def test_a_survey_reads_back_as_it_was_walked(finished, brief):
    read, poses = reader.read_survey(finished), trajectory(ROOM, poses=4, start=0.6)
    assert finished.name == "few"
    assert np.array_equal(read.probe.samples, brief.probe.samples)
    assert read.probe.length == brief.probe.length
    assert np.array_equal(read.array.positions, brief.array.positions)
    assert np.array_equal(read.walls, outline(ROOM))
    assert read.conditions["snr_db"] == 5.0
    assert read.conditions["noise"] == "white"
    for found, pose in zip(read.poses, poses, strict=True):
        assert (*found.position, found.heading) == (*pose.position, pose.heading)


def test_every_recording_is_that_of_its_pose(finished, brief):
    """Whatever the other poses did."""
    read = reader.read_survey(finished)
    for samples, index in zip(read.observe([0, 3]).samples, (0, 3), strict=True):
        expected = expected_at(read.poses[index], brief, index, NoiseLevels(5.0))
        assert np.array_equal(samples, expected.astype(np.float32))


def test_walking_again_gives_the_same_bytes(finished, walk, tmp_path):
    """Whatever a walk that was killed at its first file has left."""
    left = tmp_path / "survey" / "few" / ".simulated.json.0123456789ab.tmp"
    left.parent.mkdir(parents=True)
    left.write_bytes(b"{")
    assert contents(walk(tmp_path)) == contents(finished)


def test_a_finished_survey_is_left_alone(copy, walk, tmp_path):
    """However its settings are worded."""
    before = {path: path.stat().st_mtime_ns for path in copy.rglob("*")}
    assert walk(tmp_path, command="echolearn survey name=few poses=4", snr_db=5) == copy
    assert {path: path.stat().st_mtime_ns for path in copy.rglob("*")} == before
    walked = manifests.load_manifest(copy)["made_from"]["walk"]
    assert [set(pose) for pose in walked] == [{"kind", "position", "heading"}] * 4


@pytest.mark.parametrize(
    "name", ["observations/0002.wav", "poses.csv", "manifest.json", "simulated.json"]
)
def test_a_damaged_survey_is_named_and_made_again(finished, copy, walk, tmp_path, name):
    content = bytearray((copy / name).read_bytes())
    content[len(content) // 2] ^= 1
    (copy / name).write_bytes(bytes(content))
    with pytest.raises(BadValue, match=f"{name}: (damaged|cannot be read)"):
        manifests.verify(copy)
    walk(tmp_path)
    assert contents(copy) == contents(finished)


@dataclass(frozen=True)
class Mortal(Pyroom):
    """Responses of a room until a budget is used up; then whoever asks for more is killed."""

    budget: ClassVar[float] = math.inf

    def __call__(self, *arguments, **more):
        type(self).budget -= 1
        if self.budget < 0:
            raise KeyboardInterrupt
        return super().__call__(*arguments, **more)


def test_a_walk_that_was_killed_goes_on_at_its_pose(walk, brief, tmp_path, monkeypatch):
    """Wherever that was, whatever it has left, and whatever has been damaged since."""
    walk = partial(walk, scene=replace(brief, rir=Mortal()))
    whole = contents(walk(tmp_path / "whole"))
    runs, folder = tmp_path / "killed", tmp_path / "killed/survey/few"
    for survived in range(4):
        monkeypatch.setattr(Mortal, "budget", int(survived > 0))
        with pytest.raises(KeyboardInterrupt):
            walk(runs)
        assert len(list(folder.glob("observations/*.wav"))) == survived
        if survived:
            with (folder / journal.JOURNAL).open("a") as torn:
                torn.write('{"observations/0003.wav": {"by')
            (folder / "observations/.0003.wav.0123456789ab.tmp").write_bytes(b"torn")
    (folder / "simulated.json").unlink()
    damaged = folder / "observations/0001.wav"
    damaged.write_bytes(damaged.read_bytes()[:-1] + b"?")
    monkeypatch.setattr(Mortal, "budget", 2)
    assert contents(walk(runs)) == whole


def test_of_a_damaged_survey_only_what_is_damaged_is_made_again(walk, brief, tmp_path, monkeypatch):
    walk = partial(walk, scene=replace(brief, rir=Mortal()))
    folder = walk(tmp_path)
    whole = contents(folder)
    for name, budget in (("simulated.json", 0), ("poses.csv", 0), ("observations/0002.wav", 1)):
        (folder / name).unlink()
        monkeypatch.setattr(Mortal, "budget", budget)
        walk(tmp_path)
        assert contents(folder) == whole


def test_an_unfinished_survey_is_finished(finished, copy, walk, tmp_path):
    for name in ("manifest.json", "survey.yaml", "observations/0003.wav"):
        (copy / name).unlink()
    (copy / "observations/0001.wav").write_bytes(b"half")
    walk(tmp_path)
    assert contents(copy) == contents(finished)


def test_other_settings_under_the_same_name_are_refused(copy, walk, brief, tmp_path):
    """Though it is damaged."""
    (copy / "observations/0001.wav").write_bytes(b"half")
    before = contents(copy)
    for change in (
        {"snr_db": 6.0},
        {"pings": 2},
        {"poses": 5},
        {"start": 0.7},
        {"seed": 1},
        {"noise_seconds": 1.0},
        {"room": replace(ROOM, t60=0.21)},
        {"scene": replace(brief, speed_of_sound=340.0)},
    ):
        with pytest.raises(BadValue, match=OTHERS):
            walk(tmp_path, **change)
    assert contents(copy) == before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"snr_db": None}, "snr_db=None: must be a level in dB"),
        ({"sdnr_db": -10.0}, "sdnr_db=-10.0 dB: must be null in a scene without diffuse noise"),
        ({"seed": -1}, "seed=-1"),
        ({"poses": 0}, "poses=0"),
        ({"start": 11.0}, "start=11.0 rad"),
        ({"noise_seconds": -1}, "noise_seconds=-1 s"),
        ({"noise_seconds": "long"}, "noise_seconds=long s"),
        ({"noise_seconds": 127.0}, "noise_seconds=127 s: must be 0 (none), or from "),
        (
            {"scene": HUGE},
            "scene.probe.length=1048576: must be a whole number from 1 to 524256; of",
        ),
    ],
)
def test_bad_walks_are_refused_before_anything_is_written(walk, tmp_path, change, message):
    with writes_nothing(tmp_path, message):
        walk(tmp_path, **change)


def test_recordings_of_another_origin_are_never_overwritten(walk, tmp_path):
    folder = tmp_path / "runs" / "survey" / "robot"
    (folder / "observations").mkdir(parents=True)
    (folder / "observations" / "0000.wav").write_bytes(b"a real robot")
    with pytest.raises(BadValue, match="another origin"):
        walk(tmp_path / "runs", name="robot")
    assert (folder / "observations" / "0000.wav").read_bytes() == b"a real robot"


# ---------------------------------------------------------------- several pings


def test_recordings_are_the_mean_of_several_pings_and_the_conditions_say_so(
    walk, finished, brief, tmp_path
):
    read = reader.read_survey(walk(tmp_path, pings=16, poses=2, noise_seconds=1.0))
    assert (read.conditions["pings"], read.conditions["snr_db"]) == (16, 5.0)
    assert "pings" not in reader.read_survey(finished).conditions
    expected = expected_at(read.poses[0], brief, 0, NoiseLevels(5.0, pings=16))
    assert np.allclose(read.observe([0]).samples[0], expected, atol=1e-6)
    power = np.mean(brief.received(ROOM, read.poses[0]) ** 2, axis=-1)
    [noise] = read.noise()
    assert np.allclose(np.mean(noise**2, axis=-1), power * 10**-0.5 / 16, rtol=0.1)


# ---------------------------------------------------------------- noise


@pytest.fixture(scope="module")
def hovered(walk, brief, tmp_path_factory):
    """Return a survey under rotor noise; not to be changed."""
    scene = replace(brief, diffuse=Diffuse(Rotor()))
    return walk(tmp_path_factory.mktemp("hovered"), scene=scene, snr_db=40.0, sdnr_db=-10.0)


def test_noise_that_is_not_white_is_recorded_alone_too(hovered, finished, brief):
    read = reader.read_survey(hovered)
    [noise] = read.noise()
    assert noise.shape == (6, 5 * 22050)
    assert set(manifests.verify(hovered)["files"]) == set(contents(hovered)) - {manifests.MANIFEST}
    power = np.mean(brief.received(ROOM, read.poses[0])[0] ** 2)
    assert np.mean(noise[0] ** 2) == pytest.approx(power * (10 + 1e-4), rel=0.001)
    assert list(reader.read_survey(finished).noise()) == []


def test_conditions_tell_both_levels_and_both_noises(hovered):
    known = reader.read_survey(hovered).conditions
    assert (known["snr_db"], known["sdnr_db"], known["noise"]) == (40.0, -10.0, "white+rotor")
    heard = localize_survey(hovered, Gated(), name="gated", resamples=2)
    assert (heard.labelled.joint_snr_db == -10.0).all()
    assert heard.labelled.source.noise == "white+rotor"


def test_rotors_alone_may_be_simulated(walk, brief, tmp_path):
    scene = replace(brief, diffuse=Diffuse(Rotor()))
    folder = walk(tmp_path, scene=scene, snr_db=None, sdnr_db=3.0, poses=2)
    known = reader.read_survey(folder).conditions
    assert "snr_db" not in known
    assert known["noise"] == "rotor"


def test_white_noise_is_recorded_alone_where_it_is_asked_for(walk, finished, tmp_path):
    """It changes no recording."""
    folder = walk(tmp_path, noise_seconds=1.0)
    [noise] = reader.read_survey(folder).noise()
    assert noise.shape == (6, 22050)
    name = "observations/0000.wav"
    assert contents(folder)[name] == contents(finished)[name]
    assert contents(walk(tmp_path / "again", noise_seconds=1.0)) == contents(folder)
    with pytest.raises(BadValue, match=OTHERS):
        walk(tmp_path)


def test_noise_may_be_as_long_as_its_reader_takes_it(brief):
    """Six microphones of 4 bytes at 22 050 Hz fill 64 MiB in 126.8 s."""
    assert noise_length(brief, 126.8) == 126.8
    longer = replace(brief, probe=replace(brief.probe, length=6 * 22050), diffuse=Diffuse(Rotor()))
    assert noise_length(longer, 6.0) == 6.0
    with refused("noise_seconds=5 s: must be 0 (none), or from 6 to 126.8 s of 6 microphones; no"):
        noise_length(longer, None)
