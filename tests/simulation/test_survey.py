"""Simulated walks: the recordings are those of the poses, the folder is whole, always the same, and
nobody else's."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from echolearn.acoustics.geometry import outline
from echolearn.acoustics.types import Room
from echolearn.checks import BadValue
from echolearn.comparison.localized import localize_survey
from echolearn.localization.methods.gated import Gated
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.diffuse import Diffuse
from echolearn.simulation.noise.recorded import Recorded
from echolearn.simulation.noise.rotor import Rotor
from echolearn.simulation.observe import observe
from echolearn.simulation.survey import noise_length, survey
from echolearn.simulation.walk import trajectory
from echolearn.storage import manifests
from echolearn.survey import audio, reader
from world import coming_second

ROOM = Room((5.0, 4.5, 3.0), 0.2)
Walk = Callable[..., Path]


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


def contents(folder):
    """Return every file's bytes by name."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def copied(folder, runs):
    """Copy a survey below another folder."""
    copy = runs / "survey" / folder.name
    for name, content in contents(folder).items():
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        (copy / name).write_bytes(content)
    return copy


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
    """Pose p draws its noise from `SeedSequence(seed, spawn_key=(p,))`, whatever the other poses
    did."""
    read = reader.read_survey(finished)
    heard = read.observe([0, 3])
    for row, index in enumerate((0, 3)):
        rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(index,)))
        expected, _ = observe(
            ROOM, read.poses[index], scene=brief, levels=NoiseLevels(5.0), rng=rng
        )
        assert np.array_equal(heard.samples[row], expected.samples.astype(np.float32))


def test_the_folder_is_whole(finished):
    manifest = manifests.verify(finished)
    files = {name for name in contents(finished) if name != manifests.MANIFEST}
    assert manifest["kind"] == "survey"
    assert set(manifest["files"]) == files
    assert {f"observations/{index:04d}.wav" for index in range(4)} < files


def test_walking_again_gives_the_same_bytes(finished, walk, tmp_path):
    assert contents(walk(tmp_path)) == contents(finished)


def test_a_finished_survey_is_left_alone(finished, walk, tmp_path):
    folder = copied(finished, tmp_path)
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    assert walk(tmp_path) == folder
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before


@pytest.mark.parametrize("name", ["observations/0002.wav", "poses.csv", "manifest.json"])
def test_a_damaged_survey_is_named_and_made_again(finished, walk, tmp_path, name):
    folder = copied(finished, tmp_path)
    content = bytearray((folder / name).read_bytes())
    content[len(content) // 2] ^= 1
    (folder / name).write_bytes(bytes(content))
    with pytest.raises(BadValue, match=f"{name}: (damaged|cannot be read)"):
        manifests.verify(folder)
    walk(tmp_path)
    assert contents(folder) == contents(finished)


def test_damage_is_named_with_the_command_that_was_given(finished, walk, tmp_path):
    folder = copied(finished, tmp_path)
    (folder / "observations/0002.wav").unlink()
    with pytest.raises(BadValue, match="; make it again as it was made$"):
        manifests.verify(folder)
    walk(tmp_path, command="echolearn survey name=few poses=4")
    (folder / "observations/0002.wav").unlink()
    with pytest.raises(BadValue, match="; run again: echolearn survey name=few poses=4$"):
        manifests.verify(folder)


def test_another_wording_of_the_same_settings_is_the_same_survey(finished, walk, tmp_path):
    folder = copied(finished, tmp_path)
    walk(tmp_path, command="echolearn survey name=few poses=4", snr_db=5)
    assert contents(folder) == contents(finished)


def test_an_unfinished_survey_is_finished(finished, walk, tmp_path):
    folder = copied(finished, tmp_path)
    for name in ("manifest.json", "survey.yaml", "observations/0003.wav"):
        (folder / name).unlink()
    (folder / "observations/0001.wav").write_bytes(b"half")
    walk(tmp_path)
    assert contents(folder) == contents(finished)


@pytest.mark.parametrize("damaged", [False, True])
def test_other_settings_under_the_same_name_are_refused(finished, walk, brief, tmp_path, damaged):
    folder = copied(finished, tmp_path)
    if damaged:
        (folder / "observations/0001.wav").write_bytes(b"half")
    before = contents(folder)
    changes = (
        {"snr_db": 6.0},
        {"poses": 5},
        {"start": 0.7},
        {"seed": 1},
        {"room": replace(ROOM, t60=0.21)},
        {"scene": replace(brief, speed_of_sound=340.0)},
    )
    for change in changes:
        with pytest.raises(BadValue, match=r"^name=few: .* was made with others") as refused:
            walk(tmp_path, **change)
        assert "\n" not in str(refused.value)
    assert contents(folder) == before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"snr_db": "loud"}, "snr_db=loud dB"),
        ({"snr_db": float("nan")}, "snr_db=nan dB"),
        ({"seed": -1}, "seed=-1"),
        ({"pings": 0}, "pings=0"),
        ({"poses": 0}, "poses=0"),
        ({"start": 11.0}, "start=11.0 rad"),
        (
            {"room": Room((9.0, 3.0, 2.5), 0.2)},
            "room.size=9 x 3 x 2.5 m: must have two sides of at least 3.1 m, for a walk 1.05 to 1.45 m from the walls",
        ),
    ],
)
def test_bad_walks_are_refused_before_anything_is_written(walk, tmp_path, change, message):
    with pytest.raises(BadValue) as refused:
        walk(tmp_path, **change)
    assert str(refused.value).startswith(message)
    assert "\n" not in str(refused.value)
    assert not any(path.is_file() for path in tmp_path.rglob("*"))


def test_a_survey_killed_at_its_first_file_is_walked_again(finished, walk, tmp_path):
    left = tmp_path / "survey" / "few" / ".simulated.json.0123456789ab.tmp"
    left.parent.mkdir(parents=True)
    left.write_bytes(b"{")
    assert contents(walk(tmp_path)) == contents(finished)


def test_of_two_walks_at_once_the_second_is_refused_or_finds_the_first(
    finished, walk, tmp_path, capfd
):
    for seed, runs in ((0, tmp_path / "same"), (1, tmp_path / "other")):
        folder = runs / "survey" / "few"

        def work(seed=seed, runs=runs):
            return walk(runs, seed=seed)

        with pytest.raises(BadValue, match="was made with others") if seed else nullcontext():
            coming_second(
                work,
                folder,
                lambda runs=runs: copied(finished, runs),
                lambda: capfd.readouterr().err,
            )
        assert contents(folder) == contents(finished)
        assert [path.name for path in folder.parent.glob("[!.]*")] == ["few"]


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
    folder = walk(tmp_path, pings=16, poses=2, noise_seconds=1.0)
    read, single = reader.read_survey(folder), reader.read_survey(finished)
    assert (read.conditions["pings"], read.conditions["snr_db"]) == (16, 5.0)
    assert "pings" not in single.conditions
    heard = read.observe([0]).samples[0]
    rng = np.random.default_rng(np.random.SeedSequence(0, spawn_key=(0,)))
    expected, _ = observe(
        ROOM, read.poses[0], scene=brief, levels=NoiseLevels(5.0, pings=16), rng=rng
    )
    assert np.allclose(heard, expected.samples, atol=1e-6)
    noise, power = read.noise(), np.mean(brief.received(ROOM, read.poses[0]) ** 2, axis=-1)
    assert noise is not None
    assert np.allclose(np.mean(noise**2, axis=-1), power * 10**-0.5 / 16, rtol=0.1)
    with pytest.raises(BadValue, match=r"^name=few: .* was made with others"):
        walk(tmp_path, pings=15, poses=2, noise_seconds=1.0)
    assert contents(walk(tmp_path / "one", pings=1)) == contents(finished)


# ---------------------------------------------------------------- noise


@pytest.fixture(scope="module")
def hovered(walk, brief, tmp_path_factory):
    """Return a survey under rotor noise; not to be changed."""
    scene = replace(brief, diffuse=Diffuse(Rotor()))
    return walk(tmp_path_factory.mktemp("hovered"), scene=scene, snr_db=40.0, sdnr_db=-10.0)


def test_noise_that_is_not_white_is_recorded_alone_too(hovered, finished, brief):
    read = reader.read_survey(hovered)
    noise = read.noise()
    assert noise is not None
    assert noise.shape == (6, 5 * 22050)
    assert set(manifests.verify(hovered)["files"]) == set(contents(hovered)) - {manifests.MANIFEST}
    power = np.mean(brief.received(ROOM, read.poses[0])[0] ** 2)
    assert np.mean(noise[0] ** 2) == pytest.approx(power * (10 + 1e-4), rel=0.001)
    assert reader.read_survey(finished).noise() is None


def test_conditions_tell_both_levels_and_both_noises(hovered):
    known = reader.read_survey(hovered).conditions
    assert (known["snr_db"], known["sdnr_db"], known["noise"]) == (40.0, -10.0, "white+rotor")
    heard = localize_survey(hovered, Gated(), name="gated", resamples=2)
    assert (heard.labelled.joint_snr_db == -10.0).all()
    assert heard.labelled.source.noise == "white+rotor"


def test_rotors_alone_may_be_heard(walk, brief, tmp_path):
    folder = walk(
        tmp_path, scene=replace(brief, diffuse=Diffuse(Rotor())), snr_db=None, sdnr_db=3.0, poses=2
    )
    known = reader.read_survey(folder).conditions
    assert "snr_db" not in known
    assert known["noise"] == "rotor"


def test_white_noise_is_recorded_alone_where_it_is_asked_for(walk, finished, tmp_path):
    folder = walk(tmp_path, noise_seconds=1.0)
    noise = reader.read_survey(folder).noise()
    assert noise is not None
    assert noise.shape == (6, 22050)
    first = reader.read_survey(folder).observe([0]).samples[0]
    assert np.array_equal(first, reader.read_survey(finished).observe([0]).samples[0])
    again = walk(tmp_path / "again", noise_seconds=1.0)
    assert contents(again) == contents(folder)
    with pytest.raises(BadValue, match=r"^name=few: .* was made with others"):
        walk(tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"sdnr_db": -10.0},
            "sdnr_db=-10.0 dB: must be null in a scene without diffuse noise; choose diffuse=rotor",
        ),
        ({"snr_db": None}, "snr_db=None: must be a level in dB"),
        ({"sdnr_db": "loud"}, "sdnr_db=loud dB"),
        ({"noise_seconds": -1}, "noise_seconds=-1 s"),
        ({"noise_seconds": "long"}, "noise_seconds=long s"),
        ({"noise_seconds": 0.05}, "noise_seconds=0.05 s: must be 0 (none), or from "),
        ({"noise_seconds": 127.0}, "noise_seconds=127 s: must be 0 (none), or from "),
    ],
)
def test_bad_noises_are_refused_before_anything_is_written(walk, tmp_path, change, message):
    with pytest.raises(BadValue) as refused:
        walk(tmp_path, **change)
    assert str(refused.value).startswith(message)
    assert not any(path.is_file() for path in tmp_path.rglob("*"))


@pytest.mark.parametrize(("seconds", "least"), [(0, "2.46"), (5, "30.28")])
def test_noise_of_a_recording_too_short_is_refused_before_anything_is_written(
    walk, brief, tmp_path, seconds, least
):
    """Six microphones take stretches one after the other, of 8 000 samples or 5 s, each with a
    frame of 1 024."""
    assert (round(6 * (8000 + 1024) / 22050, 2), round(6 * (5 * 22050 + 1024) / 22050, 2)) == (
        2.46,
        30.28,
    )
    second = Recorded(np.sin(np.arange(22050)).astype(np.float32), 22050.0)
    scene = replace(brief, diffuse=Diffuse(second))
    with pytest.raises(
        BadValue, match=rf"^diffuse.source.path=1.00 s of sound: must be at least {least} s;"
    ):
        walk(tmp_path, scene=scene, sdnr_db=0.0, noise_seconds=seconds)
    assert not any(path.is_file() for path in tmp_path.rglob("*"))


def test_noise_may_be_as_long_as_its_reader_takes_it(brief):
    """Six microphones of 4 bytes at 22 050 Hz fill 64 MiB in 126.8 s; a recording of this probe
    takes 0.3 s."""
    channels, rate, seconds = 6, 22050, 64 * 2**20 / (4 * 6 * 22050)
    assert audio.longest(channels) == pytest.approx(seconds * rate, rel=1e-4)
    assert len(audio.wav_bytes(np.zeros((256, audio.longest(256))), 22050.0)) <= audio.LARGEST
    assert noise_length(brief, 126.8) == 126.8 < seconds
    long = replace(brief, probe=replace(brief.probe, length=3 * rate))
    assert noise_length(long, 3.0) == 3.0
    with pytest.raises(
        BadValue,
        match="^noise_seconds=2.9 s: must be 0 .none., or from 3 to 126.8 s of 6 microphones; noise",
    ):
        noise_length(long, 2.9)
    with pytest.raises(
        BadValue, match="^noise_seconds=5 s: must be 0 .none., or from 6 to 126.8 s"
    ):
        noise_length(
            replace(long, diffuse=Diffuse(Rotor()), probe=replace(brief.probe, length=6 * rate)),
            None,
        )


def test_a_field_without_a_level_is_refused(walk, brief, tmp_path):
    with pytest.raises(
        BadValue, match="^sdnr_db=None: must be a level in dB, as the scene has diffuse noise$"
    ):
        walk(tmp_path, scene=replace(brief, diffuse=Diffuse(Rotor())))
