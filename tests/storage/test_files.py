"""Files are whole or absent, whatever happens to their writer."""

import os
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from echolearn.checks import BadValue
from echolearn.storage import files


@given(
    arrays.arrays(
        st.sampled_from([np.float32, np.float64, np.int64, np.bool_]),
        arrays.array_shapes(max_side=4),
    )
)
def test_an_array_comes_back_as_it_was(array):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "deeper" / "a.npy"
        files.save_array(path, array)
        back = files.open_array(path, size=path.stat().st_size, sha256=files.sha256(path))
        np.testing.assert_array_equal(back, array)
        assert back.dtype == array.dtype
        assert not back.flags.writeable
        files.let_go(back)
        np.testing.assert_array_equal(back, array)


def test_an_array_of_python_objects_is_neither_written_nor_read(tmp_path):
    path = tmp_path / "a.npy"
    with pytest.raises(ValueError, match="allow_pickle"):
        files.save_array(path, np.array([{}], dtype=object))
    assert list(tmp_path.iterdir()) == []
    np.save(path, np.array([{}], dtype=object), allow_pickle=True)
    with pytest.raises(BadValue, match="not a plain array"):
        files.open_array(path, size=path.stat().st_size, sha256=files.sha256(path))


def test_a_file_is_on_the_disk_before_it_has_its_name_and_the_name_after(tmp_path, monkeypatch):
    path, sync, named = tmp_path / "a.bin", os.fsync, []

    def watched(handle):
        named.append(path.exists())
        sync(handle)

    monkeypatch.setattr(os, "fsync", watched)
    files.write_atomic(path, b"content")
    assert named == [False, True]


@pytest.mark.parametrize(
    ("path", "said"),
    [
        # It refuses every write with ENOSPC, as a full disk does.
        ("/dev/full", r"a\.bin: cannot be written \(No space left on device\); make room and run"),
        ("/nowhere/a", r"a\.bin: cannot be written \(No such file or directory\); is the folder"),
    ],
)
def test_an_error_in_the_middle_leaves_the_old_file_and_no_temporary(path, said, tmp_path):
    target = tmp_path / "a.bin"

    def broken(file):
        file.write(b"new, half of")
        with open(path, "wb", buffering=0) as full:
            full.write(b"the rest")

    files.write_atomic(target, b"old")
    with pytest.raises(BadValue, match=said):
        files.write_atomic(target, broken)
    assert list(tmp_path.iterdir()) == [target]
    assert target.read_bytes() == b"old"


LIMITED = """
import resource, sys
from pathlib import Path
from echolearn.storage.files import BadValue, write_atomic

resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
try:
    write_atomic(Path(sys.argv[1]), bytes(100_000))
except BadValue as error:
    print(error)
"""


def test_a_file_that_may_not_grow_gives_one_line(tmp_path):
    command = [sys.executable, "-c", LIMITED, str(tmp_path / "a")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True)
    advice = "make room and run the same command again"
    assert done.stdout == f"{tmp_path}/a: cannot be written (File too large); {advice}\n"
    assert list(tmp_path.iterdir()) == []


SLOW = """
import sys, time
from pathlib import Path
from echolearn.storage.files import write_atomic

def slowly(file):
    file.write(b"new" * 10_000)
    file.flush()
    print("half", flush=True)
    time.sleep(60)

write_atomic(Path(sys.argv[1]), slowly)
"""


@pytest.mark.parametrize("old", [None, b"old"])
def test_sigkill_in_the_middle_leaves_the_old_file_or_none(tmp_path, old):
    path = tmp_path / "a.bin"
    if old is not None:
        files.write_atomic(path, old)
    command = [sys.executable, "-c", SLOW, str(path)]
    with subprocess.Popen(command, text=True, stdout=subprocess.PIPE) as writer:
        assert writer.stdout.readline() == "half\n"
        files.clean(tmp_path)
        assert len(list(tmp_path.glob(".*.tmp"))) == 1, "a living writer keeps its temporary"
        writer.send_signal(signal.SIGKILL)
    assert (path.read_bytes() if path.exists() else None) == old
    files.clean(tmp_path)
    assert list(tmp_path.iterdir()) == ([path] if old is not None else [])


def test_the_size_is_looked_at_before_a_byte_is_read(tmp_path):
    path = tmp_path / "giant"
    path.touch()
    os.truncate(path, 10 << 40)
    for size, said in ((1, "bytes, more than 68719476736"), (10 << 40, "bytes, more than")):
        with pytest.raises(BadValue, match=f"giant: damaged, 10995116277760 {said}"):
            files.check_file(path, size=size, expected="0" * 64)
