"""From a survey and a bundle to map files: the laboratory's points, made once, and what does not
fit refused."""

import csv
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.io import wavfile

from echolearn.acoustics.geometry import circular_array, distance_to_outline, outline
from echolearn.acoustics.types import Array, Probe, Room
from echolearn.checks import BadValue
from echolearn.cli.main import main
from echolearn.comparison.localized import localize_survey
from echolearn.evaluation import metrics
from echolearn.robot.survey_map import map_survey
from echolearn.simulation.noise.white import White
from echolearn.simulation.rir.images import Images
from echolearn.simulation.rir.pyroom import Pyroom
from echolearn.simulation.scene import Scene
from echolearn.simulation.walk import trajectory
from echolearn.survey import audio, reader
from echolearn.survey.description import description_bytes
from echolearn.survey.poses import poses_csv, read_poses
from echolearn.training.predictions import predict
from echolearn.training.runs import load_runs
from world import HALL, POSES, World, coming_second, plans

FILES = ["manifest.json", "map.csv", "map.pgm", "map.ply", "map.svg", "map.yaml", "walls.csv"]


@pytest.fixture
def walk(world: World, tmp_path: Path) -> Path:
    """Return a copy of the walk at 0 dB, without its manifest, as a robot leaves it."""
    folder = shutil.copytree(world.runs / "survey" / "hall_0dB", tmp_path / "walk")
    (folder / "manifest.json").unlink()
    return folder


def content(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "map.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def edit(folder: Path, **changes: object) -> None:
    path = folder / "survey.yaml"
    path.write_text(yaml.safe_dump({**yaml.safe_load(path.read_text()), **changes}))


def test_the_map_is_what_the_laboratory_hears(
    world: World, packed: Path, walk: Path, tmp_path: Path
) -> None:
    folder = map_survey(survey=walk, bundle=packed, runs=tmp_path)
    assert sorted(content(folder)) == FILES
    gated = world.arguments["localizers"]["gated"]
    heard = localize_survey(walk, gated, name="gated", resamples=9)
    [run] = [run for run in load_runs(world.runs) if run.classifier == "trees_features"]
    confidence = predict(run, heard.columns)
    found = rows(folder)
    points = np.array([[float(row["x_m"]), float(row["y_m"])] for row in found])
    assert len(found) == POSES and np.abs(points - heard.points).max() <= 1e-5
    assert np.abs([float(row["confidence"]) for row in found] - confidence).max() <= 1e-5
    assert [row["kept"] == "1" for row in found] == (confidence >= run.threshold).tolist()
    scores = json.loads((folder / "manifest.json").read_text())["scores"]
    kept = confidence >= run.threshold
    assert scores["precision"] == pytest.approx(heard.labelled.reference[kept].mean())
    assert scores["true_retention"] == pytest.approx(kept[heard.labelled.reference].mean())


def test_a_finished_map_is_shown_again_and_another_survey_makes_another(
    packed: Path, walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = map_survey(survey=walk, bundle=packed, runs=tmp_path)
    before, said = content(folder), capsys.readouterr().out
    kept = {path.name: path.stat().st_ino for path in folder.iterdir()}
    map_survey(survey=walk, bundle=packed, runs=tmp_path)
    assert capsys.readouterr().out == said and "  precision " in said
    assert {path.name: path.stat().st_ino for path in folder.iterdir()} == kept
    (folder / "map.ply").write_bytes(b"torn")
    map_survey(survey=walk, bundle=packed, runs=tmp_path)
    assert content(folder) == before
    assert content(map_survey(survey=walk, bundle=packed, runs=tmp_path / "again")) == before
    edit(walk, walls=None)
    map_survey(survey=walk, bundle=packed, runs=tmp_path)
    assert "precision" not in capsys.readouterr().out.split("fitted")[-1]
    assert json.loads((folder / "manifest.json").read_text())["scores"] is None


def test_a_map_killed_at_its_first_file_is_made_again(
    packed: Path, walk: Path, tmp_path: Path
) -> None:
    left = tmp_path / "maps" / "walk-small" / ".map.csv.0123456789ab.tmp"
    left.parent.mkdir(parents=True)
    left.write_bytes(b"index")
    assert sorted(content(map_survey(survey=walk, bundle=packed, runs=tmp_path))) == FILES


def test_of_two_maps_at_once_the_second_waits_and_replaces_the_first(
    world: World, packed: Path, walk: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """None is a mixture; that the map was another's is told, once, whoever asks."""
    other = map_survey(
        survey=world.runs / "survey" / "hall_-10dB",
        bundle=packed,
        runs=tmp_path / "other",
        name="one",
    )
    expected = content(map_survey(survey=walk, bundle=packed, runs=tmp_path / "same", name="one"))
    folder, told = tmp_path / "maps" / "one", "replaces the map of another survey or bundle"
    assert told not in capfd.readouterr().err

    def work() -> Path:
        return map_survey(survey=walk, bundle=packed, runs=tmp_path, name="one")

    coming_second(
        work, folder, lambda: shutil.copytree(other, folder), lambda: capfd.readouterr().err
    )
    assert content(folder) == expected
    assert capfd.readouterr().err.splitlines() == [f"{folder}: {told}"]
    map_survey(survey=walk, bundle=packed, runs=tmp_path, name="one", resolution=0.1)
    shutil.rmtree(folder)
    coming_second(
        work,
        folder,
        lambda: shutil.copytree(tmp_path / "same" / "maps" / "one", folder),
        lambda: capfd.readouterr().err,
    )
    assert content(folder) == expected and told not in capfd.readouterr().err


def test_nothing_is_rewritten_before_it_is_known_that_all_can_be(
    packed: Path, walk: Path, tmp_path: Path
) -> None:
    folder = map_survey(survey=walk, bundle=packed, runs=tmp_path, name="one")
    before = content(folder)
    for name, put, said in (
        ("bag", lambda path: path.write_bytes(b""), "bag=a file: a folder, or none"),
        (
            "map.svg",
            lambda path: (path.unlink(), path.mkdir()),
            "map.svg=no plain file: a file of a map, or none",
        ),
    ):
        put(folder / name)
        left = {path: path.read_bytes() for path in folder.iterdir() if path.is_file()}
        with pytest.raises(BadValue, match=said):
            map_survey(
                survey=walk,
                bundle=packed,
                runs=tmp_path,
                name="one",
                resolution=0.1,
                ros=name == "bag",
            )
        assert {path: path.read_bytes() for path in folder.iterdir() if path.is_file()} == left
        (folder / name).unlink() if name == "bag" else (folder / name).rmdir()
    assert content(map_survey(survey=walk, bundle=packed, runs=tmp_path, name="one")) == before
    (tmp_path / "maps" / "two").write_bytes(b"")
    with pytest.raises(
        BadValue, match="name=two: a new name, or that of a map; .* is something else"
    ):
        map_survey(survey=walk, bundle=packed, runs=tmp_path, name="two")
    with pytest.raises(BadValue, match="cannot be written"):
        map_survey(survey=walk, bundle=packed, runs=Path("/dev/null"), name="one")


def test_a_direct_path_that_is_present_is_removed(
    world: World, packed: Path, walk: Path, tmp_path: Path
) -> None:
    """The same walk as microphones would record it: whatever gain, the loudspeaker's burst first,
    int16."""
    survey = reader.read_survey(walk)
    scene = Scene(survey.array, survey.probe, Images(), None)  # type: ignore[arg-type]
    for name in survey.files:
        samples = 0.02 * (audio.read_wav(walk / name, 22050.0) + scene.direct)
        assert np.abs(samples).max() < 1
        wavfile.write(walk / name, 22050, np.rint(samples.T * 32767).astype(np.int16))
    edit(walk, direct_path="present")
    removed = rows(
        map_survey(
            survey=world.runs / "survey" / "hall_0dB", bundle=packed, runs=tmp_path, name="removed"
        )
    )
    present = rows(map_survey(survey=walk, bundle=packed, runs=tmp_path, name="present"))
    places = [
        np.array([[float(row["x_m"]), float(row["y_m"])] for row in found])
        for found in (removed, present)
    ]
    same = np.linalg.norm(places[0] - places[1], axis=1) < 0.02
    believed = [
        np.array([float(row["confidence"]) for row in found]) for found in (removed, present)
    ]
    true = distance_to_outline(places[0], np.array(survey.walls)) <= metrics.MAP_TOLERANCE
    assert same[true].mean() > 0.95
    assert np.abs(believed[0] - believed[1])[same].mean() < 0.03


def test_the_way_to_remove_the_direct_path_is_chosen(
    world: World, packed: Path, walk: Path, tmp_path: Path
) -> None:
    """A loudspeaker of gain 0.5 that geometry's arrival fits: fitted and recorded agree, the free
    field is too loud."""
    survey = reader.read_survey(walk)
    scene = Scene(survey.array, survey.probe, Images(), None)  # type: ignore[arg-type]
    with pytest.raises(BadValue, match="direct=fitted: null; .* has direct_path: removed"):
        map_survey(survey=walk, bundle=packed, runs=tmp_path, direct="fitted")
    for name in survey.files:
        samples = 0.5 * (audio.read_wav(walk / name, 22050.0) + scene.direct)
        (walk / name).write_bytes(audio.wav_bytes(samples, 22050.0))
    edit(walk, direct_path="present")
    for way, message in (
        ("calibration", "fitted or analytic; .* has no calibration.wav"),
        ("by hand", "calibration,"),
    ):
        with pytest.raises(BadValue, match=f"direct={way}: {message}"):
            map_survey(survey=walk, bundle=packed, runs=tmp_path, direct=way)
    made = {
        "removed": map_survey(
            survey=world.runs / "survey" / "hall_0dB", bundle=packed, runs=tmp_path / "2"
        )
    }
    made["fitted"] = map_survey(survey=walk, bundle=packed, runs=tmp_path / "0")
    (walk / "calibration.wav").write_bytes(audio.wav_bytes(scene.direct, 22050.0))
    for way in ("calibration", "analytic", "fitted"):
        name = made.get(way, tmp_path).name
        made[f"{way} again"] = map_survey(
            survey=walk, bundle=packed, runs=tmp_path / way, direct=way, name=name
        )
    made["first"] = map_survey(survey=walk, bundle=packed, runs=tmp_path / "1")
    found = {
        way: [(row["x_m"], row["y_m"]) for row in rows(folder)] for way, folder in made.items()
    }
    assert found["first"] == found["calibration again"]
    assert found["fitted"] == found["fitted again"]
    places = {way: np.array(points, dtype=float) for way, points in found.items()}

    def true(way: str) -> float:
        return float(
            np.mean(
                distance_to_outline(places[way], np.array(survey.walls)) <= metrics.MAP_TOLERANCE
            )
        )

    assert min(true("first"), true("fitted")) > true("removed") - 0.05
    assert true("analytic again") < true("first") / 2


def test_another_simulator_at_another_rate_with_a_turned_array_is_mapped(
    packed: Path, tmp_path: Path
) -> None:
    """Recorded by pyroomacoustics at 44.1 kHz, int16, direct path present, the array mounted at 30
    degrees; 20 dB."""
    tower = Room((6.0, 5.0, 7.0), 0.25)  # its floor and ceiling are out of reach
    rate, turn = 44100, np.pi / 6
    burst = plans()[0].scene.probe.samples
    fine = (
        np.fft.irfft(np.fft.rfft(burst, 2048), 4096)[: 2 * len(burst)] * 2
    )  # twice the rate by zeros in the spectrum
    array = circular_array(offset=turn)
    probe = Probe(fine, float(rate), 12000)
    scene, walk = Scene(array, probe, Pyroom(), White()), tmp_path / "walk"
    poses = trajectory(tower, poses=60)[:24]  # along the walls
    names = [f"observations/{index}.wav" for index in range(len(poses))]
    (walk / "observations").mkdir(parents=True)
    for index, (pose, name) in enumerate(zip(poses, names, strict=True)):
        received = scene.received(tower, pose)
        noise = np.random.default_rng(index).standard_normal(received.shape)
        samples = 0.05 * (received + noise * np.sqrt(np.mean(received**2) / 100))
        wavfile.write(walk / name, rate, np.rint(samples.T * 32767).astype(np.int16))
    padded = np.pad(fine, (0, 12000 - len(fine)))
    (walk / "probe.wav").write_bytes(audio.wav_bytes(padded, rate))
    (walk / "poses.csv").write_bytes(poses_csv(poses, names))
    about = description_bytes(array, probe, speed_of_sound=343.0, walls=outline(tower), conditions={})
    (walk / "survey.yaml").write_bytes(about)
    edit(walk, direct_path="present")
    with pytest.raises(BadValue, match="resample with `echolearn map resample=true`"):
        map_survey(survey=walk, bundle=packed, runs=tmp_path)
    found = rows(map_survey(survey=walk, bundle=packed, runs=tmp_path, resample=True))
    points = np.array([[float(row["x_m"]), float(row["y_m"])] for row in found])
    kept = np.array([row["kept"] == "1" for row in found])
    true = distance_to_outline(points, outline(tower)) <= metrics.MAP_TOLERANCE
    assert true.mean() > 0.8 and kept.sum() >= 12
    assert true[kept].mean() >= 0.9


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (lambda x: np.clip(x, -0.2 * x.std(), 0.2 * x.std()), "observations/0033.wav: microphone 1 clipped at "),
        (lambda x: x * (np.arange(6) > 0), "observations/0033.wav: silence at microphone 1: a reference that hears; "
         "localizer=joint and localizer=em, or a bundle trained with one of them, can do without it"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_recording_is_said_of_its_file(
    fault: Callable[[Array], Array], said: str, packed: Path, walk: Path, tmp_path: Path
) -> None:
    path = walk / "observations" / "0033.wav"
    wavfile.write(path, 22050, fault(wavfile.read(path)[1]).astype(np.float32))
    with pytest.raises(BadValue, match=said):
        map_survey(survey=walk, bundle=packed, runs=tmp_path)


def test_where_nothing_is_kept_there_is_advice(
    packed: Path, walk: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Noise has no echoes; of 36 poses with it one might be believed, of 4 none."""
    map_survey(survey=walk, bundle=packed, runs=tmp_path)
    assert "no echo is believed" not in capsys.readouterr().out
    (walk / "poses.csv").write_text(
        "".join((walk / "poses.csv").read_text().splitlines(keepends=True)[:5])
    )
    for seed, name in enumerate(reader.read_survey(walk).files):
        noise = np.random.default_rng(seed).standard_normal((6, 6000))
        (walk / name).write_bytes(audio.wav_bytes(noise, 22050.0))
    folder = map_survey(survey=walk, bundle=packed, runs=tmp_path)
    assert json.loads((folder / "manifest.json").read_text())["kept"] == 0
    first, second, *_ = capsys.readouterr().out.splitlines()
    assert first.startswith("4 poses, 0 echoes kept")
    assert second.startswith(
        "no echo is believed; is the direct path removed (calibration.wav, direct=), is speed_of_s"
    )


@pytest.mark.parametrize("resample", [False, True])
def test_a_rate_too_low_for_the_bundle_is_refused(
    resample: bool, packed: Path, walk: Path, tmp_path: Path
) -> None:
    edit(walk, sample_rate=16000.0)
    for name in ("probe.wav", *read_poses(walk / "poses.csv")[2]):
        wavfile.write(walk / name, 16000, wavfile.read(walk / name)[1])
    said = "survey.yaml sample_rate=16000 Hz: at least 22050 Hz; the rate is too low: the bundle listens up to 11025 Hz"
    with pytest.raises(BadValue, match=said):
        map_survey(survey=walk, bundle=packed, runs=tmp_path, resample=resample)


def test_an_extent_too_large_for_the_grid_is_refused_with_nothing_written(
    packed: Path, walk: Path, tmp_path: Path
) -> None:
    """One pose 9 km away would need 60 000 million cells."""
    lines = (walk / "poses.csv").read_text().splitlines()
    index, _, _, *rest = lines[1].split(",")
    (walk / "poses.csv").write_text(
        "\n".join([lines[0], ",".join([index, "9000", "9000", *rest]), *lines[2:]])
    )
    with pytest.raises(
        BadValue,
        match=r"^resolution=0.05 m: at most 16000000 cells; choose a larger one; are the pos",
    ):
        map_survey(survey=walk, bundle=packed, runs=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_what_does_not_fit_is_refused_and_nothing_is_left(
    packed: Path, walk: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"

    def refusal(**changes: object) -> str:
        with pytest.raises(BadValue) as refused:
            map_survey(**{"survey": walk, "bundle": packed, "runs": out} | changes)  # type: ignore[arg-type]
        assert "\n" not in str(refused.value) and not out.exists()
        return str(refused.value)

    assert "a folder that echolearn export wrote; there is no such folder" in refusal(
        bundle=tmp_path / "nowhere"
    )
    assert "a folder in the recorded-survey format; there is no such folder" in refusal(
        survey=tmp_path / "nowhere"
    )
    assert "it is a file" in refusal(survey=walk / "survey.yaml")
    assert "this is a survey; did you swap survey and bundle?" in refusal(bundle=walk)
    assert "this is a bundle; did you swap survey and bundle?" in refusal(survey=packed)
    assert "survey.yaml: cannot be read" in refusal(survey=tmp_path)
    assert "name=../up" in refusal(name="../up")
    assert "resolution=0 m" in refusal(resolution=0)
    assert "name=nnnnnnnnnnnnnnnnnnnn...: must have at most 100 bytes; it has 101" in refusal(name="n" * 101)
    assert "resample=maybe: true or false" in refusal(resample="maybe")
    rate, samples = wavfile.read(walk / "probe.wav")
    wavfile.write(walk / "probe.wav", 44100, samples)
    edit(walk, sample_rate=44100.0)
    for name in reader.read_survey(walk).files:
        wavfile.write(walk / name, 44100, wavfile.read(walk / name)[1])
    assert "bundle expects sample_rate=22050 Hz, survey has 44100 Hz; resample with" in refusal()
    edit(walk, sample_rate=22050.0, microphones=[[0.1, k / 100, 0.0] for k in range(6)])
    wavfile.write(walk / "probe.wav", rate, samples)
    for name in reader.read_survey(walk).files:
        wavfile.write(walk / name, 22050, wavfile.read(walk / name)[1])
    assert "microphones=one is off by" in refusal()


@pytest.mark.parametrize(
    "hostile", ["/etc/passwd", "../secret.wav", "observations/../../secret.wav", "link.wav"]
)
def test_a_survey_from_a_stranger_stays_in_its_folder(
    hostile: str, packed: Path, walk: Path, tmp_path: Path
) -> None:
    (tmp_path / "secret.wav").write_bytes((walk / "observations" / "0000.wav").read_bytes())
    (walk / "link.wav").symlink_to("../secret.wav")
    text = (walk / "poses.csv").read_text().replace("observations/0003.wav", hostile)
    (walk / "poses.csv").write_text(text)
    with pytest.raises(BadValue, match="a path inside the survey's folder"):
        map_survey(survey=walk, bundle=packed, runs=tmp_path / "out")


def test_the_command_maps_and_verifies(
    packed: Path,
    walk: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["map", f"survey={walk}", f"bundle={packed}", "resolution=0.1"]
    assert main(words) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"{POSES} poses, ") and said.endswith("runs/maps/walk-small\n")
    assert main(["verify", "runs/maps/walk-small"]) == 0
    about = yaml.safe_load(Path("runs/maps/walk-small/map.yaml").read_text())
    assert about["resolution"] == 0.1 and -0.7 <= about["origin"][0] < HALL.size[0]
    assert main(["verify", str(walk)]) == 0
    assert f"readable, {POSES} recordings; there is no manifest.json" in capsys.readouterr().out
    (walk / "observations" / "0007.wav").write_bytes(b"torn")
    assert main(["verify", str(walk)]) == 1
    assert "observations/0007.wav: cannot be read as WAV" in capsys.readouterr().err
    assert main(["map", f"bundle={packed}"]) == 1
    assert (
        "survey=None: a folder in the recorded-survey format; name it: echolearn map survey="
        in capsys.readouterr().err
    )
    Path("runs/maps/mine").mkdir()
    Path("runs/maps/mine/thesis.txt").write_text("all of it")
    assert main([*words, "name=mine"]) == 1
    assert "holds something else" in capsys.readouterr().err


def test_a_robot_without_hydra_maps_by_the_same_command(
    packed: Path, walk: Path, tmp_path: Path
) -> None:
    """The laboratory's libraries cannot be found; the map is the same, byte for byte."""
    code = """
import importlib.util, sys
there = importlib.util.find_spec
hidden = set("torch sklearn hydra omegaconf lightning pyroomacoustics numba onnx matplotlib rich".split())
hidden |= {"soundfile", "rosbags"}
def find(name, package=None):
    return None if name.split(".")[0] in hidden else there(name, package)
importlib.util.find_spec = find
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in hidden:
            raise ModuleNotFoundError(name)
sys.meta_path.insert(0, Hidden())
from echolearn.cli.main import main
sys.exit(main(sys.argv[1:]))
"""

    def run(*words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-c", code, *words]
        return subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)

    words = ["map", f"survey={walk}", f"bundle={packed}"]
    done = run(*words)
    assert done.returncode == 0, done.stderr
    alone = content(tmp_path / "runs" / "maps" / "walk-small")
    whole = content(map_survey(survey=walk, bundle=packed, runs=tmp_path / "whole"))
    assert {name: alone[name] for name in FILES[1:]} == {name: whole[name] for name in FILES[1:]}
    assert "no key bundel; did you mean bundle?" in run("map", "bundel=x").stderr
    assert (
        "train: needs the whole laboratory; run: pip install 'echolearn[lab]'"
        in run("train").stderr
    )
