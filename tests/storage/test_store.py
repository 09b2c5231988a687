"""Files are whole or absent; nothing damaged is ever read as if it were sound."""

import json
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from echolearn.checks import BadValue
from echolearn.storage import files as disk
from echolearn.storage import manifests
from echolearn.storage.identity import canonical, digest
from echolearn.storage.once import locked

PLAIN = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


def finished(folder: Path) -> dict[str, bytes]:
    """Make a small finished folder and return its bytes by file name."""
    for index in range(2):
        manifests.write_shard(folder, index, np.arange(5.0) + index)
    disk.save_json(folder / "config.json", {"plan": {"step": 0.5}})
    names = [manifests.shard_name(0), manifests.shard_name(1), "config.json"]
    manifests.finish(folder, {"rows": 10, "command": "echolearn generate plan=tiny"}, names)
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def python(code: str, *args: object) -> subprocess.Popen[str]:
    """Start a Python process that runs `code`."""
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, args)],
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


# ---------------------------------------------------------------- identity


def test_a_digest_is_the_sha256_of_the_canonical_text() -> None:
    """The golden value was computed with `printf '{"a":1,"b":[0.1,null]}' | sha256sum`."""
    assert canonical({"b": [0.1, None], "a": 1}) == b'{"a":1,"b":[0.1,null]}'
    assert digest({"b": [0.1, None], "a": 1}) == "e4a9ad4b9681"


@given(PLAIN)
def test_a_digest_survives_json_and_the_order_of_keys(plain: object) -> None:
    assert digest(json.loads(json.dumps(plain))) == digest(plain)
    if isinstance(plain, dict):
        assert digest(dict(reversed(plain.items()))) == digest(plain)


@given(
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(allow_nan=False, allow_infinity=False),
)
def test_different_floats_have_different_digests(a: float, b: float) -> None:
    assert (digest(a) == digest(b)) == (repr(a) == repr(b))


@pytest.mark.parametrize("bad", [float("nan"), {"x": float("inf")}, object(), np.zeros(2)])
def test_what_json_cannot_hold_has_no_digest(bad: object) -> None:
    with pytest.raises(BadValue, match="plain finite"):
        digest(bad)


# ---------------------------------------------------------------- whole or absent


@given(
    arrays.arrays(
        st.sampled_from([np.float32, np.float64, np.int64, np.bool_]),
        arrays.array_shapes(max_side=4),
    )
)
def test_an_array_comes_back_as_it_was(array: np.ndarray) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "deeper" / "a.npy"
        disk.save_array(path, array)
        back = disk.open_array(path, size=path.stat().st_size, sha256=disk.sha256(path))
        np.testing.assert_array_equal(back, array)
        assert back.dtype == array.dtype
        assert not back.flags.writeable


def test_an_array_of_python_objects_is_neither_written_nor_read(tmp_path: Path) -> None:
    path = tmp_path / "a.npy"
    with pytest.raises(ValueError, match="allow_pickle"):
        disk.save_array(path, np.array([{}], dtype=object))
    assert list(tmp_path.iterdir()) == []
    np.save(path, np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(BadValue, match="not a plain array"):
        disk.open_array(path, size=path.stat().st_size, sha256=disk.sha256(path))


def test_an_error_in_the_middle_leaves_the_old_file_and_no_temporary(tmp_path: Path) -> None:
    path = tmp_path / "a.bin"
    disk.write_atomic(path, b"old")

    def broken(file: object) -> None:
        file.write(b"new, half of")  # type: ignore[attr-defined]
        raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        disk.write_atomic(path, broken)
    assert path.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["a.bin"]


KILLED = """
import sys, time
from pathlib import Path
from echolearn.storage import files as disk, manifests as store

def slowly(file):
    file.write(b"new" * 10_000)
    file.flush()
    print("half", flush=True)
    time.sleep(60)

disk.write_atomic(Path(sys.argv[1]), slowly)
"""


@pytest.mark.parametrize("old", [None, b"old"])
def test_sigkill_in_the_middle_leaves_the_old_file_or_none(
    tmp_path: Path, old: bytes | None
) -> None:
    path = tmp_path / "a.bin"
    if old is not None:
        disk.write_atomic(path, old)
    with python(KILLED, path) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == "half\n"
        disk.clean(tmp_path)
        assert len(list(tmp_path.glob(".*.tmp"))) == 1, "a living writer keeps its temporary"
        writer.send_signal(signal.SIGKILL)
    assert (path.read_bytes() if path.exists() else None) == old
    disk.clean(tmp_path)
    assert list(tmp_path.iterdir()) == ([path] if old is not None else [])


COUNTER = """
import sys
from pathlib import Path
from echolearn.storage.once import locked

path = Path(sys.argv[1])
for _ in range(200):
    with locked(path):
        path.write_text(str(int(path.read_text()) + 1))
"""


def test_one_at_a_time_changes_a_file(tmp_path: Path) -> None:
    path = tmp_path / "count"
    path.write_text("0")
    counting = [python(COUNTER, path) for _ in range(3)]
    assert [process.wait() for process in counting] == [0, 0, 0]
    assert path.read_text() == "600"
    assert list(tmp_path.iterdir()) == [path]


HOLDER = """
import os, sys, time
from pathlib import Path
from echolearn.storage.once import locked

with locked(Path(sys.argv[1])):
    if os.fork() == 0:
        os.setsid()
        time.sleep(5)  # a worker that outlives it
        os._exit(0)
    print("held", flush=True)
    time.sleep(60)
"""


def test_whoever_waits_says_so_and_comes_next_when_the_holder_is_killed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path, began = tmp_path / "new" / "folder", time.monotonic()
    with python(HOLDER, path) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        killing = threading.Timer(0.5, holder.kill)
        killing.start()
        with locked(path, waiting="waiting for another"):
            assert holder.wait() == -signal.SIGKILL
            assert time.monotonic() - began < 4, "its child holds nothing"
            assert [path.name for path in path.parent.iterdir()] == [".folder.lock"]
    assert list(path.parent.iterdir()) == []
    with locked(path, waiting="never said"):
        assert not path.exists()
    assert capfd.readouterr().err == "waiting for another\n"


def test_an_error_inside_lets_the_next_in(tmp_path: Path) -> None:
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt), locked(tmp_path / "a"):
            raise KeyboardInterrupt
    with locked(tmp_path / "a"), locked(tmp_path / "b"):
        assert {path.name for path in tmp_path.iterdir()} == {".a.lock", ".b.lock"}
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(
        BadValue, match=r"/\.b\.lock: cannot be written \(.+\); is the folder the right one\?$"
    ):
        (tmp_path / "file").write_bytes(b"")
        with locked(tmp_path / "file" / "b"):
            pass


SHARDS = """
import sys
from pathlib import Path
import numpy as np
from echolearn.storage import files as disk, manifests as store

print("start", flush=True)
for index in range(400):
    store.write_shard(Path(sys.argv[1]), index, np.full(200, index))
"""


@settings(max_examples=5, deadline=None)
@given(st.floats(0.0, 0.25))
def test_sigkill_at_any_moment_never_leaves_a_shard_that_counts_but_is_wrong(delay: float) -> None:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with python(SHARDS, folder) as writer:
            assert writer.stdout is not None
            writer.stdout.readline()
            time.sleep(delay)
            writer.kill()
        disk.clean(folder)
        missing = set(manifests.missing_shards(folder, 400))
        for index in sorted(set(range(400)) - missing):
            np.testing.assert_array_equal(
                np.load(folder / manifests.shard_name(index)), np.full(200, index)
            )
        assert not list(folder.glob(".*.tmp"))


FULL = """
import resource, sys
from pathlib import Path
import numpy as np
from echolearn.storage import files as disk, manifests as store
from echolearn.checks import BadValue

resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
try:
    store.write_shard(Path(sys.argv[1]), 0, np.zeros(100_000))
except BadValue as error:
    print(error)
"""


def test_a_file_that_may_not_grow_gives_one_clear_line_and_nothing_half_written(
    tmp_path: Path,
) -> None:
    with python(FULL, tmp_path) as writer:
        out, err = writer.communicate(timeout=30)
    assert err == ""
    assert out.count("\n") == 1
    assert "shard-00000.npy: cannot be written (File too large)" in out
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_gives_one_clear_line_and_nothing_half_written(tmp_path: Path) -> None:
    """/dev/full refuses every write with ENOSPC, as a full disk does."""

    def on_full_disk(file: object) -> None:
        file.write(b"first part")  # type: ignore[attr-defined]
        with open("/dev/full", "wb", buffering=0) as full:
            full.write(b"second part")

    with pytest.raises(BadValue) as caught:
        disk.write_atomic(tmp_path / "a.bin", on_full_disk)
    assert str(caught.value).endswith(
        "a.bin: cannot be written (No space left on device); make room and run the same command again"
    )
    assert list(tmp_path.iterdir()) == []


# ---------------------------------------------------------------- finished folders


def test_a_finished_folder_is_verified_and_gives_its_manifest(tmp_path: Path) -> None:
    files = finished(tmp_path)
    assert sorted(files) == ["config.json", "manifest.json", "shard-00000.npy", "shard-00001.npy"]
    manifest = manifests.verify(tmp_path)
    assert manifest["rows"] == 10
    assert manifest["files"]["shard-00001.npy"]["bytes"] == len(files["shard-00001.npy"])


def test_the_same_content_gives_the_same_bytes(tmp_path: Path) -> None:
    assert finished(tmp_path / "a") == finished(tmp_path / "b")


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, bytes]]:
    """Return one finished folder; the tests that damage a file put it right again."""
    folder = tmp_path_factory.mktemp("finished")
    return folder, finished(folder)


def damaged(sound: tuple[Path, dict[str, bytes]], name: str, content: bytes) -> str:
    """Return what `verify` says when one file of the sound folder holds `content` instead."""
    folder, files = sound
    (folder / name).write_bytes(content)
    try:
        with pytest.raises(BadValue) as caught:
            manifests.verify(folder)
    finally:
        (folder / name).write_bytes(files[name])
    return str(caught.value)


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_any_single_flipped_bit_is_detected(
    sound: tuple[Path, dict[str, bytes]], data: st.DataObject
) -> None:
    name = data.draw(st.sampled_from(sorted(sound[1])))
    content = bytearray(sound[1][name])
    place = data.draw(st.integers(0, 8 * len(content) - 1))
    content[place // 8] ^= 1 << place % 8
    said = damaged(sound, name, bytes(content))
    assert name in said
    assert "\n" not in said


@settings(max_examples=100, deadline=None)
@given(st.data())
def test_any_truncation_is_detected(
    sound: tuple[Path, dict[str, bytes]], data: st.DataObject
) -> None:
    name = data.draw(st.sampled_from(sorted(sound[1])))
    content = sound[1][name]
    said = damaged(sound, name, content[: data.draw(st.integers(0, len(content) - 1))])
    assert name in said


def test_damage_is_named_with_the_command_that_mends_it(
    sound: tuple[Path, dict[str, bytes]],
) -> None:
    said = damaged(sound, "shard-00001.npy", sound[1]["shard-00001.npy"][:-1])
    assert (
        "shard-00001.npy: damaged, 167 bytes instead of 168; run again: echolearn generate plan=tiny"
        in said
    )


def test_a_missing_file_is_damage(tmp_path: Path) -> None:
    finished(tmp_path)
    (tmp_path / "config.json").unlink()
    with pytest.raises(
        BadValue,
        match=r"config\.json: cannot be read \(No such file or directory\); run again: echolearn",
    ):
        manifests.verify(tmp_path)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[]", b"null", b'{"files": 3}', b"\xff", b"[" * 100_000]
)
def test_a_manifest_that_is_none_is_refused(tmp_path: Path, content: bytes) -> None:
    finished(tmp_path)
    (tmp_path / manifests.MANIFEST).write_bytes(content)
    with pytest.raises(BadValue, match="manifest.json"):
        manifests.verify(tmp_path)


@pytest.fixture
def unfinished(tmp_path: Path) -> Path:
    """Return the folder of a set whose two shards are written, before `finish`."""
    for index in range(2):
        manifests.write_shard(tmp_path, index, np.arange(5.0))
    return tmp_path


def entries(count: int) -> dict[str, object]:
    """Return what a manifest says of so many shards of a megabyte."""
    return {
        manifests.shard_name(index): {"bytes": 10**6, "sha256": 64 * "0"} for index in range(count)
    }


def test_the_largest_set_is_read_again(tmp_path: Path) -> None:
    """As many shards as a set may have; ten million rows at 64 in each are 156 250."""
    manifest = manifests.with_checksum({"kind": "set", "files": entries(manifests.MOST)})
    disk.save_json(tmp_path / manifests.MANIFEST, manifest)
    assert manifests.load_manifest(tmp_path) == manifest


def test_a_manifest_that_nobody_would_read_is_not_written(unfinished: Path) -> None:
    """What the shards are known by stays, so that nothing is lost."""
    before = {path.name: path.read_bytes() for path in unfinished.iterdir()}
    names, about = [manifests.shard_name(0), manifests.shard_name(1)], {"plan": "x" * 1000}
    with pytest.raises(
        BadValue, match=r"1\d\d\d bytes: at most 1000 bytes; it names 2 files; of a set, make plan"
    ):
        manifests.finish(unfinished, about, names, largest=1000)
    assert {path.name: path.read_bytes() for path in unfinished.iterdir()} == before
    size = len(disk.json_bytes(manifests.finish(unfinished, about, names)))
    assert manifests.load_manifest(unfinished, largest=size)["plan"] == "x" * 1000
    with pytest.raises(BadValue, match=f"={size} bytes: at most {size - 1} bytes"):
        manifests.load_manifest(unfinished, largest=size - 1)


def test_the_metrics_of_a_run_are_a_manifest_too(tmp_path: Path) -> None:
    disk.save_json(tmp_path / "config.json", {"seed": 1})
    written = manifests.finish(tmp_path, {"auc": 0.5}, ["config.json"], last=manifests.METRICS)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["config.json", "metrics.json"]
    assert manifests.verify(tmp_path) == written == disk.load_json(tmp_path / manifests.METRICS)
    content = (tmp_path / manifests.METRICS).read_bytes().replace(b"0.5", b"0.7")
    (tmp_path / manifests.METRICS).write_bytes(content)
    with pytest.raises(
        BadValue,
        match=r"metrics\.json: damaged, its SHA-256 differs; make it again as it was made$",
    ):
        manifests.verify(tmp_path)


def test_what_comes_back_is_what_was_stamped(tmp_path: Path) -> None:
    """Tuples become lists, as in JSON, and a stamp does not count itself."""
    once = manifests.with_checksum({"a": (1, 2)})
    assert once["a"] == [1, 2]
    assert manifests.with_checksum(once) == once


def test_a_folder_without_manifest_is_not_finished(tmp_path: Path) -> None:
    with pytest.raises(BadValue, match="not finished"):
        manifests.verify(tmp_path)


# ---------------------------------------------------------------- shards


def test_only_what_is_absent_torn_or_damaged_is_missing(tmp_path: Path) -> None:
    for index in range(5):
        manifests.write_shard(tmp_path, index, np.arange(8.0) * index)
    (tmp_path / manifests.shard_name(0)).unlink()
    manifests.sidecar(tmp_path / manifests.shard_name(1)).unlink()
    torn = tmp_path / manifests.shard_name(2)
    torn.write_bytes(torn.read_bytes()[:-3])
    manifests.sidecar(tmp_path / manifests.shard_name(3)).write_bytes(b"null")
    assert manifests.missing_shards(tmp_path, 7) == [0, 1, 2, 3, 5, 6]


def test_a_finished_set_is_mended_by_redoing_the_damaged_shard_alone(tmp_path: Path) -> None:
    before = finished(tmp_path)
    assert manifests.missing_shards(tmp_path, 2) == []
    content = bytearray(before["shard-00001.npy"])
    content[-1] ^= 1
    (tmp_path / "shard-00001.npy").write_bytes(content)
    assert manifests.missing_shards(tmp_path, 2) == [1]
    manifests.write_shard(tmp_path, 1, np.arange(5.0) + 1)
    manifests.finish(
        tmp_path,
        {"rows": 10, "command": "echolearn generate plan=tiny"},
        sorted(set(before) - {manifests.MANIFEST}),
    )
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
