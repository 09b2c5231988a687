"""Manifests of surveys: whoever proves one reads it, and whoever seals one has read it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from echolearn.acoustics.geometry import circular_array, outline
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Pose, Room
from echolearn.checks import BadValue
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.scene import Scene
from echolearn.simulation.survey import survey
from echolearn.simulation.walk import trajectory
from echolearn.storage import manifests
from echolearn.storage.files import load_json, save_json
from echolearn.storage.identity import plain
from echolearn.survey import audio, proof, reader
from echolearn.survey.description import description_bytes
from echolearn.survey.poses import poses_csv

ROOM = Room((5.0, 4.5, 3.0), 0.2)
PROBE, ARRAY = noise_probe(burst=100, length=400), circular_array(microphones=3)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a survey of two poses, as a robot leaves it."""
    poses, files = [Pose(np.array([1.0, y, 1.5])) for y in (1.0, 2.0)], ["a.wav", "b.wav"]
    (tmp_path / "survey.yaml").write_bytes(
        description_bytes(ARRAY, PROBE, speed_of_sound=343.0, walls=outline(ROOM), conditions={})
    )
    (tmp_path / "probe.wav").write_bytes(audio.wav_bytes(np.pad(PROBE.samples, (0, 300)), 22050.0))
    (tmp_path / "poses.csv").write_bytes(poses_csv(poses, files))
    for seed, name in enumerate(files):
        samples = np.random.default_rng(seed).standard_normal((3, 400))
        (tmp_path / name).write_bytes(audio.wav_bytes(samples, 22050.0))
    return tmp_path


def test_what_a_long_walk_is_made_from_is_not_too_large(brief: Scene, tmp_path: Path) -> None:
    """As of the most poses that there may be, of which but two recordings differ."""
    few = survey(
        name="few", room=ROOM, scene=brief, levels=NoiseLevels(5.0), poses=2, runs=tmp_path
    )
    most = 20_000
    walk = trajectory(ROOM, poses=most, start=0.6)
    files = [f"observations/{index:04d}.wav" for index in range(most)]
    (few / "poses.csv").write_bytes(poses_csv(walk, files))
    assert (few / "poses.csv").stat().st_size < proof.LIMITS["poses.csv"]
    about = load_json(few / "simulated.json")
    about["made_from"]["walk"] = plain(walk)
    save_json(few / "simulated.json", about)
    for name in files[2:]:
        (few / name).hardlink_to(few / files[1])
    names = ["survey.yaml", "probe.wav", "poses.csv", "simulated.json", *files]
    manifests.finish(few, about, names, largest=manifests.FOREIGN)
    read, proved = proof.read_proved(few)
    assert (len(read.poses), proved) == (most, most + 4)


def test_a_survey_that_would_not_be_read_is_not_begun(brief: Scene, tmp_path: Path) -> None:
    with pytest.raises(BadValue, match="^poses=20001: at most 20000; walk in several surveys$"):
        survey(
            name="long",
            room=ROOM,
            scene=brief,
            levels=NoiseLevels(5.0),
            poses=20_001,
            runs=tmp_path,
        )
    assert not any(tmp_path.iterdir())


# ---------------------------------------------------------------- seals


def test_what_is_sealed_is_whole(folder: Path) -> None:
    assert (
        proof.verify_survey(folder) == "readable, 2 recordings; there is no manifest.json to prove them by"
    )
    assert proof.seal(folder) == 5
    assert proof.verify_survey(folder) == "whole, 5 files; readable, 2 recordings"
    with pytest.raises(BadValue, match="one without manifest.json"):
        proof.seal(folder)


def absent(folder: Path) -> None:
    (folder / "b.wav").unlink()


def spoilt(folder: Path) -> None:
    (folder / "b.wav").write_bytes(audio.wav_bytes(np.full((3, 400), np.nan), 22050.0))


def noise_of_two(folder: Path) -> None:
    (folder / "noise.wav").write_bytes(audio.wav_bytes(np.ones((2, 400)), 22050.0))


def named_otherwise(folder: Path) -> None:
    """Two megabytes of a name that says nothing: read without a manifest, but not with one."""
    probe = noise_probe(burst=100, length=200_000)
    (folder / "probe.wav").write_bytes(
        audio.wav_bytes(np.pad(probe.samples, (0, 199_900)), 22050.0)
    )
    samples = np.random.default_rng(0).standard_normal((3, 200_000))
    for name in ("a.wav", "b.raw"):
        (folder / name).write_bytes(audio.wav_bytes(samples, 22050.0))
    (folder / "poses.csv").write_text((folder / "poses.csv").read_text().replace("b.wav", "b.raw"))
    assert "readable" in proof.verify_survey(folder)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (absent, "b.wav: cannot be read"),
        (spoilt, "b.wav=NaN"),
        (noise_of_two, "noise.wav=(2, 400)"),
        (named_otherwise, "b.raw=2400058 bytes: at most 1048576 bytes"),
    ],
)
def test_what_cannot_be_read_is_not_sealed(
    folder: Path, change: Callable[[Path], None], message: str
) -> None:
    change(folder)
    with pytest.raises(BadValue) as refused:
        proof.seal(folder)
    assert str(refused.value).startswith(f"{folder}/{message}")
    assert not (folder / "manifest.json").exists()
