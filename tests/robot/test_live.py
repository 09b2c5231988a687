"""A map that grows: what is whole is mapped, what is not is waited for, and the end is `map`'s."""

import csv
import io
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from echolearn.acoustics.types import Echoes, EchoMap, Pose
from echolearn.checks import BadValue
from echolearn.cli.compose import compose
from echolearn.cli.words import plain_config
from echolearn.mapping.files.grid import occupancy, shades
from echolearn.mapping.mapped_walk import MappedWalk
from echolearn.robot.live import following, live_map
from echolearn.robot.live.growing_grid import GrowingGrid
from echolearn.robot.live.line_input import LineInput
from echolearn.robot.live.live_map import PointSample
from echolearn.robot.live.viewers import Viewers, Viewing
from echolearn.robot.shipped import find_bundle
from echolearn.robot.survey_map import map_survey
from echolearn.survey import growing

ROOT = Path(__file__).parents[2]
SHORT = ROOT / "examples" / "survey" / "short"


@pytest.fixture
def bundle(tmp_path):
    return find_bundle("point", tmp_path)


@pytest.fixture
def started(tmp_path):
    """Return a survey that was described, of which no pose is there yet."""
    folder = tmp_path / "walk"
    (folder / "observations").mkdir(parents=True)
    for name in ("survey.yaml", "probe.wav"):
        shutil.copy(SHORT / name, folder)
    return folder


@pytest.fixture
def mapping(started, bundle, tmp_path):
    """Return a session on it, and what it maps in one look."""
    about = {"folder": tmp_path / "runs" / "live" / "walk-point", "resolution": 0.05, "asked": {}}
    session = following._session(started, bundle, **about)
    return session, lambda: [new.number for new in session.step()]


def rows():
    """Return the lines of the walk's `poses.csv`, the names of its columns first."""
    return (SHORT / "poses.csv").read_text().splitlines(keepends=True)


def record(folder, *, poses):
    """Record some poses, file and row."""
    lines = rows()
    table = folder / "poses.csv"
    for pose in poses:
        if not table.exists():
            table.write_text(lines[0])
        name = lines[1 + pose].strip().split(",")[5]
        shutil.copy(SHORT / name, folder / name)
        with table.open("a") as file:
            file.write(lines[1 + pose])


def numbers(folder):
    """Return the poses of a live map's table, in its order."""
    with (folder / "map.csv").open(newline="") as file:
        return [int(row["index"]) for row in csv.DictReader(file)]


def test_half_a_row_and_half_a_recording_are_waited_for(started, mapping):
    session, look = mapping
    assert look() == []  # no poses.csv yet
    heading, first, second = rows()[:3]
    recording = (SHORT / "observations" / "0000.wav").read_bytes()
    table, file = started / "poses.csv", started / "observations" / "0000.wav"
    table.write_text(heading + first[:30])
    assert look() == []
    table.write_text(heading + first + second)
    assert look() == []  # the row is whole, its file is not there
    for part in (20, 700, len(recording) - 1):
        file.write_bytes(recording[:part])
        assert look() == []
    file.write_bytes(recording)
    assert look() == [0] and session.map.left_out == 0
    assert look() == []


def test_what_stays_broken_is_left_out_in_a_line(started, mapping, monkeypatch, capsys):
    session, look = mapping
    record(started, poses=range(3))
    (started / "observations" / "0001.wav").write_bytes(b"RIFF")
    with (started / "poses.csv").open("a") as file:
        file.write("7,1.0,north,1.0,0.0,observations/0002.wav\n8,1,1,1,0,../walk.wav\n")
    assert look() == [0, 2]
    monkeypatch.setattr(growing, "PATIENCE", 0.0)
    time.sleep(0.01)
    assert look() == []
    said = capsys.readouterr().err.splitlines()
    assert session.map.left_out == len(said) == 3
    assert any("poses.csv row 5 y_m='north'" in line for line in said)
    assert any("0001.wav: cannot be read as WAV" in line for line in said)
    assert any("must be a path inside the survey's folder" in line for line in said)


def test_what_is_not_there_is_waited_for_and_told_once(
    started, bundle, tmp_path, monkeypatch, capsys
):
    """First the table is missing, then two recordings; a third look says nothing again."""
    monkeypatch.setattr(growing, "PATIENCE", 0.0)
    monkeypatch.setattr(following, "PATIENCE", 0.0)
    about = {"folder": tmp_path / "live", "resolution": 0.05, "asked": {}}
    session = following._session(started, bundle, **about)
    viewers = Viewers(Viewing(port=None), session.map, folder=tmp_path)
    follow = following._Following(session, viewers, source=None, until=None, stopped=lambda: False)
    said = []
    for poses in ((), (0, 1, 2), ()):
        record(started, poses=poses)
        for pose in {*poses} - {0}:
            (started / "observations" / f"000{pose}.wav").unlink()
        assert follow.look() and follow.look()
        said.append(capsys.readouterr().err)
    begun = "live: waits for "
    assert said[0].startswith(
        f"{begun}{started}/poses.csv, not there for 0 s; a row of it is mapped"
    )
    assert said[1].startswith(
        f"{begun}observations/0001.wav of pose 1 and 1 more, not there for 0 s"
    )
    assert said[0].count("\n") == said[1].count("\n") == 1 and said[2] == ""


def test_a_finished_survey_is_proved_before_the_first_pose(bundle, tmp_path, capsys):
    """With its manifest, but without its last recordings, it would be refused after all others."""
    copied = tmp_path / "copied"
    shutil.copytree(SHORT, copied)
    about = {"folder": tmp_path / "live", "resolution": 0.05, "asked": {}}
    following._session(copied, bundle, **about)
    assert f"{copied}: finished, as its manifest.json says" in capsys.readouterr().err
    (copied / "poses.csv").write_text("".join(rows()[:5]))
    with pytest.raises(BadValue, match=r"poses\.csv.*remove its manifest\.json"):
        following._session(copied, bundle, **about)


def test_it_goes_on_after_a_kill_and_ends_as_map_does(started, bundle, tmp_path, capsys):
    """A process of its own is killed; half a row is left, and half a pose recorded meanwhile."""
    runs = tmp_path / "runs"
    words = ["live", f"survey={started}", f"runs={runs}", "port=null"]
    child = subprocess.Popen([sys.executable, "-m", "echolearn", *words], cwd=tmp_path)
    live = runs / "live" / "walk-point"
    record(started, poses=range(8))
    while not (live / "map.csv").exists() or len(numbers(live)) < 8:
        assert child.poll() is None
        time.sleep(0.01)
    child.send_signal(signal.SIGKILL)
    child.wait()
    with (live / "map.csv").open("a") as file:
        file.write("7,1.25,0.")
    record(started, poses=range(8, 30))

    about = {"survey": started, "bundle": bundle}
    capsys.readouterr()
    made = following.live_survey(**about, runs=runs, until=30)
    said = capsys.readouterr().err
    assert f"{live}: goes on where it stopped: 8 poses are mapped, the last is pose 7\n" in said
    assert numbers(live) == [*range(30)]
    alone = map_survey(**about, runs=tmp_path / "alone")
    names = sorted(path.name for path in alone.iterdir())
    assert sorted(path.name for path in made.iterdir()) == names
    assert all((made / name).read_bytes() == (alone / name).read_bytes() for name in names)
    # What was shown is what is written, but for rounding: recordings are scored one by one, and a
    # column that lies on a threshold of the trees moves a confidence.
    shown, written = (
        np.loadtxt(each / "map.csv", delimiter=",", skiprows=1) for each in (live, made)
    )
    assert np.abs(shown[:, 8] - written[:, 8]).max() < 0.02
    assert np.allclose(np.delete(shown, 8, 1), np.delete(written, 8, 1), rtol=1e-4, atol=1e-6)


def test_a_robot_without_hydra_types_its_keys_alike():
    config = plain_config("live", ["survey=walk", "port=0", "dds=0", "until=5", "lines=true"])
    assert [config[key] for key in ("port", "dds", "until", "lines")] == [0, 0, 5, True]
    assert plain_config("live", ["port=null"])["port"] is None
    [(_, other)] = compose("live", ["survey=walk", "port=0", "dds=0", "until=5", "lines=true"])
    names = ("port", "dds", "until", "lines", "host", "foxglove", "mcap", "localizer")
    assert {key: config[key] for key in names} == {key: other[key] for key in names}


def test_rows_of_something_else_are_thrown_away(started, bundle, tmp_path, capsys):
    record(started, poses=range(2))
    about = {"survey": started, "bundle": bundle, "runs": tmp_path}
    following.live_survey(**about, until=2)
    following.live_survey(**about, until=2)
    assert "replaces the live map" not in capsys.readouterr().err
    following.live_survey(**about, until=2, localizer={"sign": "either"})
    assert "replaces the live map of something else" in capsys.readouterr().err
    assert numbers(tmp_path / "live" / "walk-point") == [0, 1]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_the_map(number, started, bundle, tmp_path):
    record(started, poses=range(2))
    before = signal.getsignal(number)

    class Shown:
        def pose(self, *_):
            if self.live.poses == 2:
                os.kill(os.getpid(), number)

    session_made = following.Viewers
    viewer = Shown()

    class Watching(session_made):
        def __init__(self, viewing, live, *, folder):
            super().__init__(viewing, live, folder=folder)
            viewer.live, viewer.map, viewer.close = live, lambda _: None, lambda: None
            self._all.append(viewer)

    following.Viewers = Watching
    try:
        made = following.live_survey(survey=started, bundle=bundle, runs=tmp_path)
    finally:
        following.Viewers = session_made
    assert len(numbers(made)) == 2 and signal.getsignal(number) == before


def test_lines_become_rows_and_their_end_ends_it(started, bundle, tmp_path, monkeypatch, capsys):
    for name in ("0000.wav", "0001.wav"):
        shutil.copy(SHORT / "observations" / name, started / "observations")
    (started / "poses.csv").write_text(rows()[0] + "5,0.5,0")  # torn by a kill
    reader, writer = os.pipe()
    os.write(writer, f"# two poses\n{rows()[1]}{rows()[1]}hello\n{rows()[2].strip()}".encode())
    os.close(writer)
    monkeypatch.setattr(
        following, "LineInput", lambda *at, **by: LineInput(*at, **by, descriptor=reader)
    )
    made = following.live_survey(survey=started, bundle=bundle, runs=tmp_path, lines=True)
    assert (started / "poses.csv").read_text() == "".join(rows()[:3])
    assert len(numbers(made)) == 2
    said = capsys.readouterr().err
    assert "line index=0: must be more than the last, 0; was the line sent twice?" in said
    assert "line='hello': must tell where it was recorded" in said


def test_a_name_alone_takes_the_last_pose_of_odometry(tmp_path):
    reader, writer = os.pipe()
    os.write(writer, b"observations/a.wav\n")
    pose = Pose(np.array([1.0, -2.5, 0.5]), 0.25)
    source = LineInput(tmp_path / "poses.csv", descriptor=reader, odometry=lambda: pose)
    assert source.wait(0.0) == []
    [row] = csv.DictReader(io.StringIO((tmp_path / "poses.csv").read_text()))
    assert [float(cell) for cell in list(row.values())[:5]] == [0.0, 1.0, -2.5, 0.5, 0.25]


@pytest.mark.parametrize("key", ["until", "played", "name"])
def test_what_cannot_be_is_refused(key, started, bundle, tmp_path):
    wrong = {"until": 0, "played": "walk", "name": "a/b"}
    with pytest.raises(BadValue, match=f"^{key}="):
        following.live_survey(survey=started, bundle=bundle, runs=tmp_path, **{key: wrong[key]})


def test_a_second_command_for_the_same_map_is_refused(started, bundle, tmp_path):
    (tmp_path / "live").mkdir()
    with following.claimed(tmp_path / "live" / "walk-point"), pytest.raises(BadValue, match="name"):
        following.live_survey(survey=started, bundle=bundle, runs=tmp_path, until=1)


def test_a_grid_that_grows_is_the_grid_of_the_whole():
    rng = np.random.default_rng(0)
    places, points = rng.uniform(-9, 9, (2, 40, 2))
    belief = rng.uniform(0.5, 1.0, 40)
    growing_grid = GrowingGrid(0.1)
    for place, point, sure in zip(places, points, belief, strict=True):
        growing_grid.add(place, point, belief=float(sure))
    column = np.full((40, 1), np.pi / 2)
    whole = MappedWalk(
        Echoes(*[column] * 6),
        EchoMap(points, belief, np.ones(40, bool), places),
        [Pose(np.append(place, 1.0)) for place in places],
        range(40),
        resolution=0.1,
    )
    odds, touched, (x, y) = occupancy(whole)
    pixels, corner = growing_grid.pixels()
    column, row = np.rint((np.array([x, y]) - corner) / 0.1).astype(int)
    height, width = odds.shape
    inner = pixels[row : row + height, column : column + width].astype(int)
    assert np.abs(inner - shades(odds, touched)).max() <= 1
    assert (pixels == 205).sum() - (inner == 205).sum() == pixels.size - inner.size


def test_a_grid_does_not_grow_beyond_all_bounds():
    grid = GrowingGrid(0.05)
    grid.add(np.zeros(2), np.ones(2), belief=0.9)
    grid.add(np.zeros(2), np.array([9e4, 9e4]), belief=0.9)
    assert grid.beyond == 1 and np.prod(grid.size) < 10_000


def test_the_sample_of_points_is_fair_and_bounded(monkeypatch):
    """Of 400 points 40 are kept: early and late ones alike, 20 each, within 4 sd of 3."""
    monkeypatch.setattr(live_map, "POINTS", 40)
    kept = []
    for seed in range(20):
        sample = PointSample()
        sample._rng = np.random.default_rng(seed)
        for number in range(400):
            sample.add(np.array([float(number), 1.0]), np.zeros(2), belief=0.5)
        assert sample.rows.shape == (40, 5)
        kept += sample.rows[:, 0].tolist()
    early = np.mean(np.array(kept) < 200)
    assert abs(early - 0.5) < 4 * 0.5 / np.sqrt(len(kept))
