"""Files from strangers, refused for what they might do rather than for what they say.

No size that a file declares is believed, and none is read that is no plain file of a known size.
"""

import ast
import math
import os
import stat
import zipfile
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check
from echolearn.storage.files import one_line


def read_bytes(path: Path, *, limit: int) -> bytes:
    """Return the bytes of a plain file.

    Raises:
        BadValue: it is missing, larger than `limit` bytes, a symbolic link, or no plain file.
    """
    try:
        file = open(path, "rb", opener=_open)  # noqa: SIM115 - closed below
    except OSError as error:
        reason = "it is a symbolic link" if path.is_symlink() else error.strerror or error
        raise BadValue(f"{path}: cannot be read ({reason})") from None
    with file:
        about = os.fstat(file.fileno())
        check(
            stat.S_ISREG(about.st_mode),
            str(path),
            "not a plain file",
            allowed="must be a plain file",
        )
        size = about.st_size
        check(size <= limit, str(path), f"{size} bytes", allowed=f"must be at most {limit} bytes")
        return file.read(limit)


def _open(path: str, flags: int) -> int:
    """Open a file, no link, without waiting for a pipe that nobody writes to."""
    return os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK)


def read_arrays(
    data: bytes, expected: Mapping[str, tuple[str, tuple[int, ...]]], *, name: str
) -> dict[str, Array]:
    """Return the arrays of an uncompressed `.npz` file.

    Args:
        data: the file.
        expected: dtype, as "<f4", and shape of each array; there may be no others.
        name: name of the file in errors.

    Raises:
        BadValue: no such file, other arrays, types or shapes, or a value that is not finite.
    """
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            members = archive.infolist()
            names = sorted(member.filename for member in members)
            plain = {member.compress_type for member in members} == {zipfile.ZIP_STORED}
            if names != sorted(f"{key}.npy" for key in expected) or not plain:
                raise ValueError(f"holds {names[:5]}, packed or not")
            arrays = {
                key: _array(archive.read(f"{key}.npy"), *kind) for key, kind in expected.items()
            }
    except Exception as error:  # a damaged archive trips zipfile over whatever it meets first
        raise BadValue(f"{name}: not the arrays it should hold ({one_line(error)})") from None
    for key, array in arrays.items():
        finite = bool(np.isfinite(array).all())
        check(finite, f"{name} {key}", "NaN or infinity", allowed="must be finite numbers")
    return arrays


def _array(data: bytes, dtype: str, shape: tuple[int, ...]) -> Array:
    """Return what an `.npy` file holds, or raise ValueError if it is not of that type and shape."""
    if data[:8] != b"\x93NUMPY\x01\x00":
        raise ValueError("no npy file of version 1.0")
    end = 10 + int.from_bytes(data[8:10], "little")
    header = ast.literal_eval(data[10 : min(end, 1024)].decode("latin1").strip())
    wanted = {"descr": dtype, "fortran_order": False, "shape": shape}
    body = data[end:]
    if header != wanted or len(body) != np.dtype(dtype).itemsize * math.prod(shape):
        raise ValueError(f"{len(body)} bytes, {header} instead of {wanted}")
    return np.frombuffer(body, dtype).reshape(shape)
