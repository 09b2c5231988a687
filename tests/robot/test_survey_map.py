"""From a survey and a bundle to map files: made once, and what does not fit refused."""

import csv
import json
import re
import shutil
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.io import wavfile

from by_hand import edit
from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.rooms import outline, true_echoes
from echolearn.acoustics.sides import distance_to_outline
from echolearn.acoustics.types import Pose
from echolearn.checks import BadValue
from echolearn.cli.main import main
from echolearn.evaluation.labelling import MAP_TOLERANCE
from echolearn.mapping.mapped_walk import BAG
from echolearn.robot.scorer import load
from echolearn.robot.survey_map import map_survey, score_survey
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.survey import audio, reader
from echolearn.survey.poses import poses_csv
from echolearn.survey.truth import truth_csv
from world import HALL, POSES, coming_second

UNASKED = "domain: no reference, not checked\n"
FILES = ["manifest.json", "map.csv", "map.pgm", "map.ply", "map.svg", "map.yaml", "walls.csv"]


@pytest.fixture
def walk(world, tmp_path):
    """Return a copy of the walk at 0 dB, without its manifest, as a robot leaves it."""
    folder = shutil.copytree(world.runs / "survey" / "hall_0dB", tmp_path / "walk")
    (folder / "manifest.json").unlink()
    return folder


@pytest.fixture
def few(walk):
    """Let the walk have six poses, for what is true of the files of any map."""
    rows = (walk / "poses.csv").read_text().splitlines(keepends=True)
    (walk / "poses.csv").write_text("".join(rows[:7]))


@pytest.fixture
def made(packed, walk, tmp_path):
    """Return `map_survey` of the walk."""
    return partial(map_survey, survey=walk, bundle=packed, runs=tmp_path / "runs")


def content(folder):
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): path.read_bytes() for path in paths}


def about(folder):
    return dict(json.loads((folder / "manifest.json").read_text()))


def points(folder):
    """Return x, y, confidence, kept, and whether from floor or ceiling, of all points, (P, 5)."""
    with (folder / "map.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    names = ("x_m", "y_m", "confidence", "kept", "floor_or_ceiling")
    return np.array([[float(row[name]) for name in names] for row in rows])


def on_walls(places, walls):
    return distance_to_outline(places[:, :2], walls) <= MAP_TOLERANCE


def test_the_map_is_what_the_scorer_finds(packed, walk, made, capsys):
    folder = made()
    assert sorted(content(folder)) == FILES
    found = score_survey(load(packed), reader.read_survey(walk)).map
    table = points(folder)
    said = capsys.readouterr().out
    counts = re.match(
        f"{UNASKED}36 poses, " r"(\d+) echoes kept: (\d+) points in the map, (\d+) from", said
    )
    kept, shown, upright = map(int, counts.groups())
    assert kept == found.kept.sum() == shown + upright
    svg = (folder / "map.svg").read_text()
    assert [svg.count(f'class="{kind}"') for kind in ("kept", "upright")] == [shown, upright]
    assert len(table) == POSES and np.array_equal(table[:, :2], found.points)
    assert np.array_equal(table[:, 2], found.confidence)
    assert np.array_equal(table[:, 3] == 1, found.kept)
    true = on_walls(table, outline(HALL))
    scores = about(folder)["scores"]
    drawn = (table[:, 3] == 1) & (table[:, 4] == 0)
    assert scores["precision"] == pytest.approx(true[drawn].mean())
    assert scores["true_retention"] == pytest.approx(drawn[true].mean())


def test_a_finished_map_is_shown_again_and_another_survey_makes_another(
    few, made, walk, tmp_path, capsys
):
    def inodes():
        return {path.name: path.stat().st_ino for path in folder.iterdir()}

    folder = made()
    before, said, kept = content(folder), capsys.readouterr().out, inodes()
    made()
    assert capsys.readouterr().out == said and "  precision " in said and inodes() == kept
    (folder / "map.ply").write_bytes(b"torn")
    assert content(made()) == before == content(made(runs=tmp_path / "again"))
    edit(walk, walls=None)
    made()
    assert "precision" not in capsys.readouterr().out.split("fitted")[-1]
    assert about(folder)["scores"] is None


def test_times_and_directions_alone_make_no_map_but_are_judged_by_their_truth(made, walk, capsys):
    folder = made()
    poses = reader.read_survey(walk).poses
    truths = [true_echoes(HALL, pose, array=circular_array()) for pose in poses]
    (walk / "truth.csv").write_bytes(truth_csv(truths))
    capsys.readouterr()
    made()
    both_told = capsys.readouterr().out.split("of echoes, by truth.csv")
    assert [each.count("  precision  ") for each in both_told] == [1, 1]
    edit(walk, map=False)
    assert made() == folder
    assert sorted(content(folder)) == ["manifest.json", "map.csv"]
    said = capsys.readouterr().out
    assert "times and directions only, no points, no walls (map: false)" in said
    with (folder / "map.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["x_m"] + row["y_m"] for row in rows} == {""}
    kept = np.array([row["kept"] == "1" for row in rows])
    timed = []
    both = []
    for row, truth in zip(rows, truths, strict=True):
        late = np.abs(truth.toa - float(row["toa_s"])) * 22050 < 10
        turn = np.abs(np.angle(np.exp(1j * (truth.azimuth - float(row["azimuth_rad"])))))
        upright = np.abs(truth.elevation - np.pi / 2) > np.pi / 4
        tilt = np.abs(truth.elevation - float(row["elevation_rad"]))
        timed.append(late.any())
        both.append((late & (np.where(upright, tilt, turn) <= np.deg2rad(10))).any())
    scores = about(folder)["echo_scores"]
    for prefix, labels in (("", both), ("time_", timed)):
        true = np.array(labels)
        assert scores[f"{prefix}precision"] == pytest.approx(true[kept].mean())
        assert scores[f"{prefix}true_retention"] == pytest.approx(kept[true].mean())
        assert scores[f"{prefix}spurious_removal"] == pytest.approx((~kept[~true]).mean())
        assert f"  {prefix}precision" in said
    assert about(folder)["points"] == about(folder)["lines"] == 0


def test_a_map_killed_at_its_first_file_is_made_again(few, made, tmp_path):
    left = tmp_path / "runs" / "maps" / "walk-small" / ".map.csv.0123456789ab.tmp"
    left.parent.mkdir(parents=True)
    left.write_bytes(b"index")
    assert sorted(content(made())) == FILES


def test_of_two_maps_at_once_the_second_waits_and_replaces_the_first(
    few, made, world, tmp_path, capfd
):
    """None is a mixture; that the map was another's is told, whoever asks."""
    other = made(survey=world.runs / "survey" / "hall_-10dB", runs=tmp_path / "o", name="one")
    expected = content(made(runs=tmp_path / "same", name="one"))
    folder, told = tmp_path / "runs" / "maps" / "one", "replaces the map of another survey or bund"
    assert told not in capfd.readouterr().err

    def second(first):
        coming_second(
            partial(made, name="one"),
            folder,
            lambda: shutil.copytree(first, folder),
            lambda: capfd.readouterr().err,
        )
        assert content(folder) == expected

    second(other)
    assert capfd.readouterr().err.count(told) == 1
    shutil.rmtree(folder)
    second(tmp_path / "same" / "maps" / "one")
    assert told not in capfd.readouterr().err


@pytest.mark.parametrize(
    ("name", "put", "message"),
    [
        ("bag", lambda path: path.write_bytes(b""), "bag=a file: must be a folder, or none"),
        ("map.svg", Path.mkdir, "map.svg=no plain file: must be a file of a map, or none"),
    ],
)
def test_nothing_is_rewritten_before_it_is_known_that_all_can_be(few, name, put, message, made):
    folder = made()
    (folder / name).unlink(missing_ok=True)
    put(folder / name)
    before = content(folder)
    with pytest.raises(BadValue, match=message):
        made(resolution=0.1, ros=name == "bag")
    assert content(folder) == before


def test_what_is_no_map_is_left_alone(made, tmp_path):
    maps = tmp_path / "runs" / "maps"
    (maps / "thesis").mkdir(parents=True)
    (maps / "thesis" / "all.txt").write_text("of it")
    (maps / "file").write_bytes(b"")
    for name, said in (("thesis", "holds"), ("file", "is")):
        with pytest.raises(BadValue, match=f"name={name}: must be a new name.*{said} something el"):
            made(name=name)
    with pytest.raises(BadValue, match="cannot be written"):
        made(runs=Path("/dev/null"))


def test_a_finished_map_gets_its_bag_and_loses_it_again(few, made):
    plain = content(made())
    folder = made(ros=True)
    with_bag = content(folder)
    assert sorted(with_bag.keys() - plain.keys()) == sorted(BAG)
    assert {name for name in plain if plain[name] != with_bag[name]} == {"manifest.json"}
    assert about(folder)["inputs"]["ros"] is True
    (folder / BAG[0]).write_bytes(b"torn")
    assert content(made(ros=True)) == with_bag
    assert content(made()) == plain and not (folder / "bag").exists()


def test_without_the_library_of_bags_nothing_is_done(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    monkeypatch.delitem(sys.modules, "echolearn.mapping.files.mcap", raising=False)
    monkeypatch.chdir(tmp_path)
    assert main(["map", "survey=nowhere", "bundle=runs/nowhere", "ros=true"]) == 1
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "ros=true: needs rosbags; pip install 'echolearn[ros]'" in said
    assert [*tmp_path.iterdir()] == []


# ---------------------------------------------------------------- the direct path


def with_direct(walk, gain, *, pcm):
    """Let a walk be recorded as microphones would, the loudspeaker's burst first; return that."""
    survey = reader.read_survey(walk)
    direct = Scene(survey.array, survey.probe, Images(), None).direct
    for name in survey.files:
        samples = gain * (audio.read_wav(walk / name, 22050.0) + direct)
        kind = np.rint(samples.T * 32767).astype(np.int16) if pcm else samples.T.astype(np.float32)
        wavfile.write(walk / name, 22050, kind)
    edit(walk, direct_path="present")
    return np.asarray(direct)


def test_a_direct_path_that_is_present_is_removed(made, walk, tmp_path):
    removed = points(made(runs=tmp_path / "removed"))
    with_direct(walk, 0.02, pcm=True)
    for way, least in (("fitted", 0.95), ("fir", 0.85)):
        # What is fitted to a recording is fitted to its noise, too: one echo or two may change.
        present = points(made(direct=way, runs=tmp_path / way))
        same = np.linalg.norm(removed[:, :2] - present[:, :2], axis=1) < 0.02
        assert same[on_walls(removed, outline(HALL))].mean() > least
        assert np.abs(removed[:, 2] - present[:, 2])[same].mean() < 0.03


def test_the_way_to_remove_the_direct_path_is_chosen(made, walk, tmp_path):
    """A loudspeaker of gain 0.5: fitted and recorded agree, the free field is too loud."""
    removed = points(made(runs=tmp_path / "removed"))
    with pytest.raises(BadValue, match="direct=fitted: must be null; .* has direct_path: removed"):
        made(direct="fitted")
    direct = with_direct(walk, 0.5, pcm=False)
    with pytest.raises(BadValue, match="direct=calibration: must be fir, fitted or .* has no"):
        made(direct="calibration")
    with pytest.raises(BadValue, match="direct=by hand: must be one of calibration, fir, fitted"):
        made(direct="by hand")
    default = points(made(runs=tmp_path / "0"))
    (walk / "calibration.wav").write_bytes(audio.wav_bytes(direct, 22050.0))
    first = points(made())
    chosen = {way: points(made(direct=way)) for way in ("calibration", "analytic", "fitted", "fir")}
    assert np.array_equal(first, chosen["calibration"])
    assert np.array_equal(default, chosen["fir"])

    def true(places):
        return float(on_walls(places, outline(HALL)).mean())

    assert min(true(first), true(chosen["fitted"]), true(default)) > true(removed) - 0.05
    assert true(chosen["analytic"]) < true(first) / 2


def test_echoes_are_sought_by_the_burst_as_played_where_that_is_asked_for(made, walk):
    with pytest.raises(BadValue, match="played=walk: must be null; .* has direct_path: removed"):
        made(played="walk")
    with_direct(walk, 0.5, pcm=False)
    with pytest.raises(BadValue, match="played=calibration: must be walk or null; .* has no cal"):
        made(played="calibration")
    with pytest.raises(BadValue, match="played=by hand: must be calibration or walk"):
        made(played="by hand")
    plain = made()
    usual = points(plain)
    assert "played" not in about(plain)["inputs"]
    filtered = made(played="walk")
    assert about(filtered)["inputs"]["played"] == "walk"
    assert "burst as the loudspeaker plays it" in "".join(about(filtered)["health"]["mended"])
    # The simulated loudspeaker is perfect: nothing is gained, nothing lost.
    same = np.linalg.norm(points(filtered)[:, :2] - usual[:, :2], axis=1) < 0.03
    assert same[on_walls(usual, outline(HALL))].mean() > 0.8


# ---------------------------------------------------------------- what does not fit


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        (lambda x: np.clip(x, -0.2 * x.std(), 0.2 * x.std()), "clipped=.* at all 6 microphones"),
        (lambda x: x * (np.arange(6) > 0), "dead channels=microphone 1"),
    ],
)
def test_what_is_wrong_with_a_recording_is_said_of_it(fault, message, made, walk, tmp_path):
    path = walk / "observations" / "0033.wav"
    wavfile.write(path, 22050, fault(wavfile.read(path)[1]).astype(np.float32))
    with pytest.raises(BadValue, match=f"^{walk}: {message} in recording 33"):
        made()
    assert content(tmp_path / "runs") == {}


def test_where_nothing_is_kept_there_is_advice(made, walk, capsys):
    """Noise has no echoes; of 36 poses with it one might be believed, of 4 none."""
    made()
    assert "no point is drawn" not in capsys.readouterr().out
    rows = (walk / "poses.csv").read_text().splitlines(keepends=True)
    (walk / "poses.csv").write_text("".join(rows[:5]))
    for seed, name in enumerate(reader.read_survey(walk).files):
        noise = np.random.default_rng(seed).standard_normal((6, 6000))
        (walk / name).write_bytes(audio.wav_bytes(noise, 22050.0))
    assert about(made())["kept"] == 0
    said = capsys.readouterr().out
    assert said.startswith(UNASKED)
    _, first, second, *causes = said.partition("  precision")[0].splitlines()
    assert first.startswith("4 poses, 0 echoes kept: 0 points in the map, 0 from floor or ceiling")
    assert second == "no point is drawn; the most likely cause first:"
    assert causes[0].startswith("  1. ") and "on trust" in "".join(causes)
    assert causes == [f"  {n}. {c}" for n, c in enumerate(about(made())["causes"], start=1)]


# ---------------------------------------------------------------- what the user knows better


def changed(walk, change):
    """Let every recording of a walk be changed, samples (M, N)."""
    for name in reader.read_survey(walk).files:
        samples = change(audio.read_wav(walk / name, 22050.0))
        wavfile.write(walk / name, 22050, samples.T.astype(np.float32))


def test_a_dead_microphone_is_left_out(made, walk, tmp_path, recwarn):
    """The map with the others is as true; with none left out the walk is refused, by the number."""
    whole = points(made(runs=tmp_path / "whole"))
    changed(walk, lambda x: x * (np.arange(6) != 2)[:, None])
    with pytest.raises(BadValue, match=r"dead channels=microphone 3 .* without=\[3\] maps with"):
        made()
    folder = made(without=[3])
    assert about(folder)["inputs"]["gains"] == [1, 1, 0, 1, 1, 1]
    # Whoever leaves it out knows that it is silent.
    assert not [each for each in recwarn if "silent" in str(each.message)]
    few, many = (each[(each[:, 3] == 1) & (each[:, 4] == 0)] for each in (points(folder), whole))
    assert len(few) > len(many) / 2 and on_walls(few, outline(HALL)).mean() > 0.8
    for wrong in ([7], [0], [1, 2, 3, 4, 5], 3):
        with pytest.raises(BadValue, match="^without="):
            made(without=wrong)


def test_gains_mend_a_soft_microphone(made, walk, tmp_path):
    whole = points(made(runs=tmp_path / "whole"))
    changed(walk, lambda x: x / np.array([1, 1, 64, 1, 1, 1])[:, None])
    soft = made(runs=tmp_path / "soft")
    assert "gains=[1,1,6" in "".join(about(soft)["health"]["noticed"])
    mended = made(gains=[1, 1, 64, 1, 1, 1])
    assert np.array_equal(points(mended), whole) and not np.array_equal(points(soft), whole)
    assert "health" not in about(mended)
    for wrong in ([1, 1], [1, 1, 0, 1, 1, 1]):
        with pytest.raises(BadValue, match="^gains="):
            made(gains=wrong)


def test_echoes_of_either_sign_are_sought(made, walk, tmp_path):
    """A loudspeaker wired the other way gives the same map then; unless asked, it gives another."""
    either = {"sign": "either"}
    upright = points(made(runs=tmp_path / "upright", localizer=either))
    changed(walk, lambda x: -x)
    turned = made(runs=tmp_path / "turned")
    assert "localizer.sign=either" in "".join(about(turned)["health"]["noticed"])
    sought = made(localizer=either)
    assert about(sought)["inputs"]["sign"] == "either"
    assert np.allclose(points(sought)[:, :2], upright[:, :2])
    assert not np.allclose(points(turned)[:, :2], upright[:, :2])
    with pytest.raises(BadValue, match="sign=both"):
        made(localizer={"sign": "both"})


def at_rate(walk, rate):
    """Let all files of a walk say that they have another sample rate."""
    for name in ("probe.wav", *reader.read_survey(walk).files):
        wavfile.write(walk / name, rate, wavfile.read(walk / name)[1])
    edit(walk, sample_rate=float(rate))


def burst(walk, change):
    """Change the samples of the probe, (N,)."""
    rate, samples = wavfile.read(walk / "probe.wav")
    wavfile.write(walk / "probe.wav", rate, np.ascontiguousarray(change(samples)))


def far(walk):
    """Take the first pose 9 km away, for which 60 000 million cells were needed."""
    survey = reader.read_survey(walk)
    poses = [Pose(np.array([9000.0, 9000.0, 2.0])), *survey.poses[1:]]
    (walk / "poses.csv").write_bytes(poses_csv(poses, survey.files))


@pytest.mark.parametrize(
    ("change", "given", "message"),
    [
        (None, {"bundle": Path("nowhere")}, "echolearn export wrote; there is no such folder"),
        (None, {"survey": Path("nowhere")}, "in the recorded-survey format; there is no such fol"),
        (None, {"survey": Path(__file__)}, "it is a file"),
        (None, {"survey": Path("bundle")}, "it is a bundle; did you swap survey and bundle?"),
        (
            None,
            {"bundle": Path("survey")},
            "a recorded survey; did you swap survey and bundle?",
        ),
        (None, {"name": "../up"}, "name=../up: must be a name without /"),
        (None, {"resolution": 0}, "resolution=0 m: must be a number from 0.005 to 1 m"),
        (None, {"resample": "maybe"}, "resample=maybe: must be true or false"),
        (None, {"ros": "yes"}, "ros=yes: must be true or false"),
        (partial(at_rate, rate=44100), {}, "expects sample_rate=22050 Hz, survey has 44100 Hz; re"),
        (partial(at_rate, rate=16000), {}, "16000 Hz: must be at least 22050 Hz; the rate is too"),
        (partial(at_rate, rate=16000), {"resample": True}, "16000 Hz: must be at least 22050 Hz"),
        (
            partial(burst, change=lambda x: np.roll(x, 99)),
            {},
            "it begins 99 samples late: cut these",
        ),
        (partial(burst, change=lambda x: np.roll(x, -30)), {}, "its first 30 samples are m"),
        (partial(burst, change=np.negative), {}, "its sign is turned: take the bundle's probe.wav"),
        (
            partial(burst, change=lambda x: x[::-1]),
            {},
            "play the bundle's probe.wav, or train with",
        ),
        (
            None,
            {"without": (1,)},
            "must not hold 1, from which the bundle's localizer, gated, takes",
        ),
        (far, {}, "^resolution=0.05 m: must leave at most 16000000 cells; choose a larger one"),
    ],
)
def test_what_does_not_fit_is_refused_and_nothing_is_left(
    change, given, message, made, packed, walk, tmp_path
):
    if change:
        change(walk)
    named = {Path("bundle"): packed, Path("survey"): walk}
    with pytest.raises(BadValue, match=message):
        made(**{key: named.get(value, value) for key, value in given.items()})
    assert content(tmp_path / "runs") == {}


def test_a_survey_that_changes_while_it_is_mapped_is_no_map(few, made, walk, tmp_path, monkeypatch):
    def meanwhile(*given, **named):
        found = score_survey(*given, **named)
        with (walk / "poses.csv").open("a") as file:
            file.write("\n")
        return found

    monkeypatch.setattr("echolearn.robot.survey_map.score_survey", meanwhile)
    with pytest.raises(BadValue, match="must not change while it is mapped; is it still being"):
        made()
    assert content(tmp_path / "runs") == {}


# ---------------------------------------------------------------- the command


def test_the_command_maps_and_verifies(packed, walk, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["map", f"survey={walk}", f"bundle={packed}", "resolution=0.1"]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"{UNASKED}{POSES} poses, ") and said.endswith("runs/maps/walk-small\n")
    described = yaml.safe_load(Path("runs/maps/walk-small/map.yaml").read_text())
    assert described["resolution"] == 0.1 and -0.7 <= described["origin"][0] < HALL.size[0]
    assert main(["verify", "runs/maps/walk-small"]) == 0
    assert main(["map", f"bundle={packed}"]) == 1
    assert "name it: echolearn map survey=" in capsys.readouterr().err


HIDDEN = """
import importlib.util, sys
there = importlib.util.find_spec
hidden = "torch sklearn hydra omegaconf lightning pyroomacoustics numba onnx matplotlib rich "
hidden = {*hidden.split(), "soundfile", "rosbags"}
def find(name, package=None):
    return None if name.split(".")[0] in hidden else there(name, package)
importlib.util.find_spec = find
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in hidden:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Hidden())
from echolearn.cli.main import main
print(*[main(line.split()) for line in sys.argv[1:]])
"""


def test_a_robot_without_hydra_maps_by_the_same_command(packed, walk, made, tmp_path):
    """The laboratory's libraries cannot be found; the map is the same, byte for byte."""

    mapped = f"map survey={walk} bundle={packed}"
    lines = [
        f"{mapped} runs=alone",
        f"{mapped} runs=options without=[3] gains=[1,1,1,1,1,2] localizer.sign=either",
        "map without=[3",
        "map localizer.sigh=either",
        "map bundel=x",
        "train",
        "map survey=x bundle=point ros=true",
    ]
    # One process for all, since each has to load numpy.
    done = subprocess.run(
        [sys.executable, "-c", HIDDEN, *lines], capture_output=True, text=True, cwd=tmp_path
    )
    statuses = done.stdout.splitlines()[-1].split()
    assert statuses[:2] == ["0", "0"] and "0" not in statuses[2:], done.stderr
    alone, whole = content(tmp_path / "alone" / "maps" / "walk-small"), content(made())
    assert {name: alone[name] for name in FILES[1:]} == {name: whole[name] for name in FILES[1:]}
    inputs = about(tmp_path / "options" / "maps" / "walk-small")["inputs"]
    assert (inputs["gains"], inputs["sign"]) == ([1, 1, 0, 1, 1, 2], "either")
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    for told, said in zip(
        errors,
        (
            "without=[3: must be a list",
            "there is no key localizer.sigh",
            "no key bundel; did you mean bundle?",
            "pip install 'echolearn[lab]'",
            "pip install 'echolearn[ros]'",
        ),
        strict=True,
    ):
        assert said in told
