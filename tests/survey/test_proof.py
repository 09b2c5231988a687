"""Manifests of surveys: what one names is whole, and what is used is named."""

import numpy as np
import pytest

from by_hand import FILES, ROOM
from echolearn.checks import BadValue
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.survey import survey
from echolearn.simulation.walk import trajectory
from echolearn.storage import manifests
from echolearn.storage.files import load_json, save_json
from echolearn.storage.identity import plain
from echolearn.survey import audio, proof, reader
from echolearn.survey.poses import poses_csv


def seal(folder):
    """Write the manifest of a survey that has none."""
    names = proof.used(reader.read_survey(folder))
    manifests.finish(folder, {"kind": "survey"}, files=names, largest=manifests.FOREIGN)


@pytest.mark.release
def test_what_a_long_walk_is_made_from_is_not_too_large(brief, tmp_path):
    """As of the most poses that there may be, of which but two recordings differ."""
    few = survey(
        name="few", room=ROOM, scene=brief, levels=NoiseLevels(5.0), poses=2, runs=tmp_path
    )
    walk = trajectory(ROOM, poses=20_000, start=0.6)
    files = [f"observations/{index:04d}.wav" for index in range(len(walk))]
    (few / "poses.csv").write_bytes(poses_csv(walk, files))
    about = load_json(few / "simulated.json")
    about["made_from"]["walk"] = plain(walk)
    save_json(few / "simulated.json", about)
    for name in files[2:]:
        (few / name).hardlink_to(few / files[1])
    names = ["survey.yaml", "probe.wav", "poses.csv", "simulated.json", *files]
    manifests.finish(few, about, files=names, largest=manifests.FOREIGN)
    read, proved = proof.read_proved(few)
    assert (len(read.poses), proved) == (len(walk), len(walk) + 4)


def test_a_survey_that_would_not_be_read_is_not_begun(brief, tmp_path):
    with pytest.raises(BadValue, match="^poses=20001: .*20000"):
        survey(
            name="long",
            room=ROOM,
            scene=brief,
            levels=NoiseLevels(5.0),
            poses=20_001,
            runs=tmp_path,
        )
    assert not any(tmp_path.iterdir())


def test_a_manifest_proves_what_a_map_depends_on(folder):
    bare = "readable, 2 recordings; there is no manifest.json to prove them by"
    assert proof.verify_survey(folder) == bare
    seal(folder)
    assert proof.verify_survey(folder) == "whole, 5 files; readable, 2 recordings"
    noise = np.ones((3, 400))
    (folder / "noise.wav").write_bytes(audio.wav_bytes(noise, 22050.0))
    with pytest.raises(BadValue, match="noise.wav=unknown: must be among the files that manifest"):
        proof.verify_survey(folder)


@pytest.mark.parametrize(
    ("name", "samples", "message"),
    [
        (FILES[1], np.full((3, 400), np.nan), "=NaN"),
        (FILES[1], np.zeros((3, 400)), "=silence"),
        ("noise.wav", np.ones((2, 400)), r"=\(2, 400\)"),
    ],
)
def test_a_whole_file_is_read_besides(folder, name, samples, message):
    """A checksum tells that nothing has changed, not that it was good."""
    (folder / name).write_bytes(audio.wav_bytes(samples, 22050.0))
    seal(folder)
    with pytest.raises(BadValue, match=f"^{folder / name}{message}"):
        proof.verify_survey(folder)


def test_a_recording_by_a_name_that_says_nothing_is_limited(folder):
    text = (folder / "poses.csv").read_text().replace(FILES[1], "1.raw")
    (folder / "poses.csv").write_text(text)
    (folder / FILES[1]).rename(folder / "1.raw")
    seal(folder)
    proof.verify_survey(folder)
    with (folder / "1.raw").open("ab") as file:
        file.truncate(2 << 20)
    (folder / "manifest.json").unlink()
    manifests.finish(folder, {"kind": "survey"}, files=[*proof.used(reader.read_survey(folder))])
    with pytest.raises(BadValue, match="1.raw=2097152 bytes: must be at most 1048576"):
        proof.verify_survey(folder)
