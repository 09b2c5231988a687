"""Finished folders: nothing damaged is ever read as if it were sound."""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from echolearn.checks import BadValue
from echolearn.storage import files, manifests
from echolearn.storage.advice import repair_hint

ABOUT = {"rows": 10, "command": "echolearn generate plan=tiny"}


def contents(folder):
    """Return the bytes of every file by its name."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def finished(folder):
    """Make a small finished folder and return its bytes by file name."""
    for index in range(2):
        manifests.write_shard(folder, index, array=np.arange(5.0) + index)
    files.save_json(folder / "config.json", {"plan": {"step": 0.5}})
    manifests.finish(folder, ABOUT, files=["shard-00000.npy", "shard-00001.npy", "config.json"])
    return contents(folder)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    """Return one finished folder; the tests that damage a file put it right again."""
    folder = tmp_path_factory.mktemp("finished")
    return folder, finished(folder)


def test_a_finished_folder_gives_its_manifest_the_same_bytes_each_time(sound, tmp_path):
    folder, made = sound
    assert sorted(made) == ["config.json", "manifest.json", "shard-00000.npy", "shard-00001.npy"]
    manifest = manifests.verify(folder)
    assert manifest["rows"] == 10
    assert manifest["files"]["shard-00001.npy"]["bytes"] == len(made["shard-00001.npy"])
    assert finished(tmp_path) == made


def damaged(sound, name, content):
    """Return what `verify` says when a file of the sound folder holds `content`, or is gone."""
    folder, made = sound
    path = folder / name
    path.unlink() if content is None else path.write_bytes(content)
    try:
        with pytest.raises(BadValue) as caught:
            manifests.verify(folder)
    finally:
        path.write_bytes(made[name])
    assert name in str(caught.value)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@settings(max_examples=200)
@given(st.data(), st.booleans())
def test_any_flipped_bit_and_any_truncation_is_detected(sound, data, cut):
    name = data.draw(st.sampled_from(sorted(sound[1])))
    content = bytearray(sound[1][name])
    place = data.draw(st.integers(0, len(content) - 1))
    content[place] ^= 1 << data.draw(st.integers(0, 7))
    damaged(sound, name, bytes(content[:place] if cut else content))


def test_damage_is_named_with_the_command_that_mends_it(sound):
    mend = "run again: echolearn generate plan=tiny"
    short = damaged(sound, "shard-00001.npy", sound[1]["shard-00001.npy"][:-1])
    assert short.endswith(f"shard-00001.npy: damaged, 167 bytes instead of 168; {mend}")
    gone = damaged(sound, "config.json", None)
    assert gone.endswith(f"config.json: cannot be read (No such file or directory); {mend}")


FOREIGN = ["echolearn train; rm -r x", "echolearn train\nrm", "echolearn 'train", "rm -r x", None]


def advised(folder, command):
    """Return what is advised about a folder that was made here by a command."""
    return repair_hint(manifests.finish(folder, {"command": command}, files=[]), folder)


def test_only_a_command_line_of_ones_own_is_advised(tmp_path):
    own = "echolearn train 'name=a b'"
    assert advised(tmp_path, own) == f"run again: {own}"
    told = {advised(tmp_path, command) for command in FOREIGN}
    assert told == {"make it again as it was made"}


def test_the_command_of_a_stranger_is_not_advised(tmp_path, monkeypatch):
    with monkeypatch.context() as elsewhere:
        elsewhere.setenv("XDG_STATE_HOME", str(tmp_path / "another"))
        manifest = manifests.finish(tmp_path, {"command": "echolearn train runs=/"}, files=[])
    assert repair_hint(manifest, tmp_path) == "make it again as it was made"


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b"null", b'{"files": 3}', b"\xff", b"[" * 100_000]
)
def test_a_manifest_that_is_none_is_refused(sound, content):
    damaged(sound, manifests.MANIFEST, content)


def test_a_folder_without_manifest_is_not_finished(tmp_path):
    assert not manifests.is_finished(tmp_path)
    with pytest.raises(BadValue, match="not finished, or not made by echolearn: there is no"):
        manifests.verify(tmp_path)


def test_the_largest_set_is_read_again():
    """As many shards of a megabyte as a set may have: their entries are of equal length."""
    name = manifests.shard_name(manifests.MOST)
    entry = {"bytes": 10**6, "sha256": 64 * "0"}
    one = len(files.json_bytes({f"{name}1": entry}))
    two = len(files.json_bytes({f"{name}1": entry, f"{name}2": entry}))
    assert (two - one) * manifests.MOST < manifests.LARGEST


def test_a_manifest_that_nobody_would_read_is_not_written(tmp_path):
    """What the shards are known by stays, so that nothing is lost."""
    name = manifests.shard_name(0)
    manifests.write_shard(tmp_path, 0, array=np.arange(5.0))
    before = contents(tmp_path)
    about = {"plan": "x" * 1000}
    said = r"1\d\d\d bytes: at most 1000 bytes; it names 1 files; of a set, make plan"
    with pytest.raises(BadValue, match=said):
        manifests.finish(tmp_path, about, files=[name], largest=1000)
    assert contents(tmp_path) == before
    size = len(files.json_bytes(manifests.finish(tmp_path, about, files=[name])))
    assert manifests.load_manifest(tmp_path, largest=size)["plan"] == about["plan"]
    with pytest.raises(BadValue, match=f"={size} bytes: at most {size - 1} bytes"):
        manifests.load_manifest(tmp_path, largest=size - 1)


def test_the_metrics_of_a_run_are_a_manifest_too(tmp_path):
    files.save_json(tmp_path / "config.json", {"seed": 1})
    written = manifests.finish(
        tmp_path, {"auc": (0.5,)}, files=["config.json"], last=manifests.METRICS
    )
    assert sorted(contents(tmp_path)) == ["config.json", "metrics.json"]
    assert manifests.verify(tmp_path) == written
    assert written["auc"] == [0.5], "tuples become lists, as in JSON"
    assert manifests.with_checksum(written) == written, "a checksum does not count itself"
    content = contents(tmp_path)["metrics.json"].replace(b"0.5", b"0.7")
    (tmp_path / manifests.METRICS).write_bytes(content)
    said = r"metrics\.json: damaged, its SHA-256 differs; make it again as it was made$"
    with pytest.raises(BadValue, match=said):
        manifests.verify(tmp_path)


# ---------------------------------------------------------------- shards


def test_only_what_is_absent_torn_or_damaged_is_missing(tmp_path):
    paths = [tmp_path / manifests.shard_name(index) for index in range(5)]
    for index in range(5):
        manifests.write_shard(tmp_path, index, array=np.arange(8.0) * index)
    paths[0].unlink()
    manifests.sidecar(paths[1]).unlink()
    paths[2].write_bytes(paths[2].read_bytes()[:-3])
    manifests.sidecar(paths[3]).write_bytes(b"null")
    assert manifests.missing_shards(tmp_path, 7) == [0, 1, 2, 3, 5, 6]


def test_a_finished_set_is_mended_by_redoing_the_damaged_shard_alone(tmp_path):
    before = finished(tmp_path)
    assert manifests.missing_shards(tmp_path, 2) == []
    (tmp_path / "shard-00001.npy").write_bytes(before["shard-00001.npy"][:-1] + b"\x01")
    assert manifests.missing_shards(tmp_path, 2) == [1]
    manifests.write_shard(tmp_path, 1, array=np.arange(5.0) + 1)
    manifests.finish(tmp_path, ABOUT, files=sorted(set(before) - {manifests.MANIFEST}))
    assert contents(tmp_path) == before


SHARDS = """
import sys
from pathlib import Path
import numpy as np
from echolearn.storage import manifests

print("start", flush=True)
for index in range(400):
    manifests.write_shard(Path(sys.argv[1]), index, array=np.full(200, index))
"""


@settings(max_examples=4)
@given(st.floats(0.0, 0.25))
def test_sigkill_at_any_moment_never_leaves_a_shard_that_counts_but_is_wrong(delay):
    with tempfile.TemporaryDirectory() as name:
        command = [sys.executable, "-c", SHARDS, name]
        with subprocess.Popen(command, text=True, stdout=subprocess.PIPE) as writer:
            writer.stdout.readline()
            time.sleep(delay)
            writer.kill()
        files.clean(Path(name))
        for index in set(range(400)) - set(manifests.missing_shards(Path(name), 400)):
            found = np.load(Path(name) / manifests.shard_name(index))
            np.testing.assert_array_equal(found, np.full(200, index))
        assert not list(Path(name).glob(".*.tmp"))
