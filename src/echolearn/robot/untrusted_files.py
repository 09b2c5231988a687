"""Files from strangers: read with a limit, and refused for what they might do rather than for what
they say.

    read          bytes of a plain file, never more than a limit; no symbolic links, pipes or devices
    read_arrays   arrays of an `.npz` whose names, types and shapes are known beforehand, so no size is believed
    check_onnx    an ONNX model that computes and does nothing else

An ONNX file is a protocol buffer: a sequence of (key, value), key = 8 * field number + wire type,
    and a value is a
varint (type 0), 8 or 4 bytes (types 1 and 5), or a length followed by as many bytes (type 2):
numbers, text, or another message. `MESSAGES` names the fields of onnx.proto3 (IR version 10) on the
way to everything that reaches outside the file (external data), calls foreign code (operators of
another domain, functions), or repeats without an end (subgraphs of Loop, Scan and If). Whatever
appears twice is looked at twice, so it does not matter which one a parser takes.
"""

import ast
import math
import os
import stat
import zipfile
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check

Value = int | memoryview

NODES = 5000
"""Most operators in a model."""

MESSAGES: dict[str, dict[int, str]] = {
    "model": {7: "graph", 8: "opset", 20: "!training info", 25: "!functions"},
    "graph": {1: "node", 5: "tensor", 15: "!sparse tensors"},
    "node": {5: "attribute", 7: "domain"},
    "attribute": {
        5: "tensor",
        6: "!a subgraph",
        10: "tensor",
        11: "!a subgraph",
        22: "!sparse",
        23: "!sparse",
    },
    "tensor": {13: "!data in another file", 14: "location"},
    "opset": {1: "domain"},
}
"""Fields that matter, by the role that `_check_role` knows; ! is forbidden, other names here are
messages."""


def read(path: Path, *, limit: int) -> bytes:
    """Return the bytes of a plain file.

    Raises:
        BadValue: it is missing, larger than `limit` bytes, a symbolic link, or no plain file.
    """
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        reason = "it is a symbolic link" if Path(path).is_symlink() else error.strerror or error
        raise BadValue(f"{path}: cannot be read ({reason})") from None
    with os.fdopen(handle, "rb") as file:
        about = os.fstat(handle)
        check(stat.S_ISREG(about.st_mode), str(path), "not a plain file", allowed="a plain file")
        check(
            about.st_size <= limit,
            str(path),
            f"{about.st_size} bytes",
            allowed=f"at most {limit} bytes",
        )
        return file.read(limit)


def read_arrays(
    data: bytes, expected: Mapping[str, tuple[str, tuple[int, ...]]], *, name: str
) -> dict[str, Array]:
    """Return the arrays of an uncompressed `.npz` file.

    Args:
        data: the file.
        expected: dtype, as "<f4", and shape of each array; there may be no others.
        name: of the file, for errors.

    Raises:
        BadValue: no such file, other arrays, types or shapes, or a value that is not finite.
    """
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            members = {member.filename: member for member in archive.infolist()}
            plain = all(member.compress_type == zipfile.ZIP_STORED for member in members.values())
            if sorted(members) != sorted(f"{key}.npy" for key in expected) or not plain:
                raise ValueError(f"holds {sorted(members)}")
            files = {key: archive.read(f"{key}.npy") for key in expected}
        arrays = {key: _array(files[key], *kind) for key, kind in expected.items()}
    except Exception as error:  # a damaged archive trips zipfile over whatever it meets first
        raise BadValue(
            f"{name}: not the arrays it should hold ({' '.join(str(error).split())})"
        ) from None
    for key, array in arrays.items():
        check(
            bool(np.isfinite(array).all()),
            f"{name} {key}",
            "NaN or infinity",
            allowed="finite numbers",
        )
    return arrays


def _array(data: bytes, dtype: str, shape: tuple[int, ...]) -> Array:
    """Return what an `.npy` file holds, or raise ValueError if that is not an array of that type
    and shape.
    """
    check(data[:8] == b"\x93NUMPY\x01\x00", "npy", "another version", allowed="1.0")
    end = 10 + int.from_bytes(data[8:10], "little")
    header = ast.literal_eval(data[10 : min(end, 1024)].decode("latin1").strip())
    wanted = {"descr": dtype, "fortran_order": False, "shape": shape}
    body = data[end:]
    size = np.dtype(dtype).itemsize * math.prod(shape)
    if header != wanted or len(body) != size:
        raise ValueError(f"{len(body)} bytes, {header} instead of {wanted}")
    return np.frombuffer(body, dtype).reshape(shape)


def check_onnx(data: bytes, *, name: str) -> None:
    """Raise `BadValue` unless a model is whole, on its own, of standard operators, and without
    loops.

    Args:
        data: the file.
        name: of the file, for errors.
    """
    nodes = 0
    try:
        for role, value in _marked(memoryview(data), "model"):
            nodes += role == "node"
            check(nodes <= NODES, f"{name} operators", nodes, allowed=f"at most {NODES}")
            _check_role(role, value, name)
    except BadValue:
        raise
    except (ValueError, IndexError, RecursionError) as error:
        raise BadValue(f"{name}: not an ONNX file ({error})") from None
    check(nodes > 0, name, "no operators", allowed="an ONNX model")


def _marked(message: memoryview, kind: str) -> Iterator[tuple[str, Value]]:
    """Yield each message of `MESSAGES` and each of its marked fields, depth first, with its role."""
    yield kind, message
    for number, value in _fields(message):
        role = MESSAGES[kind].get(number)
        if role in MESSAGES:
            if not isinstance(value, memoryview):
                raise ValueError(f"field {number} of {kind} is a number")
            yield from _marked(value, role)
        elif role:
            yield role, value


def _check_role(role: str, value: Value, name: str) -> None:
    """Raise `BadValue` if a marked field, or the size that a tensor declares, is not allowed."""
    shown = (
        ascii(bytes(value[:64]).decode("latin1")) if isinstance(value, memoryview) else str(value)
    )
    if role.startswith("!"):
        raise BadValue(f"{name}: contains {role[1:]}; a bundle's model stands alone, without loops")
    if role == "domain":
        check(
            shown in ("''", "'ai.onnx'"),
            f"{name} domain",
            shown,
            allowed="operators of ONNX itself, none custom",
        )
    elif role == "location":
        check(value == 0, f"{name} data location", shown, allowed="inside the file")
    elif role == "tensor" and isinstance(value, memoryview):
        elements = math.prod(_dimensions(value))
        check(
            elements <= 8 * len(value),
            f"{name} tensor",
            f"{elements} elements",
            allowed="as many as it holds",
        )


def _dimensions(tensor: memoryview) -> Iterator[int]:
    """Yield the dimensions of a tensor, which come one by one or several in a packed field."""
    for value in (value for number, value in _fields(tensor) if number == 1):
        if isinstance(value, int):
            yield value
            continue
        place = 0
        while place < len(value):
            dimension, place = _varint(value, place)
            yield dimension


def _fields(message: memoryview) -> Iterator[tuple[int, Value]]:
    """Yield number and value of each field of a message; raise ValueError or IndexError if it is
    cut or malformed.
    """
    place = 0
    while place < len(message):
        key, place = _varint(message, place)
        wire = key & 7
        if wire == 0:
            value, place = _varint(message, place)
            yield key >> 3, value
            continue
        if wire == 2:
            size, place = _varint(message, place)
        elif wire in (1, 5):
            size = 8 if wire == 1 else 4
        else:
            raise ValueError(f"wire type {wire}")
        if place + size > len(message):
            raise ValueError("it is cut")
        yield key >> 3, message[place : place + size]
        place += size


def _varint(message: memoryview, place: int) -> tuple[int, int]:
    """Return the number at `place`, seven bits a byte, lowest first, and the place after it."""
    value = 0
    for shift in range(0, 70, 7):
        byte = message[place]
        place += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, place
    raise ValueError("a number without an end")


def read_burst(data: bytes, *, sample_rate: float, length: int, name: str) -> Array:
    """Return the samples of a WAV file of one channel, float32, without the silence after them,
    shape (L,), float64.

    Args:
        data: the file.
        sample_rate: expected, in Hz.
        length: expected, in samples.
        name: of the file, for errors.

    Raises:
        BadValue: another kind of file, rate or length, NaN, or nothing but silence.
    """
    chunks, place = {}, 12
    while place + 8 <= len(data):
        size = int.from_bytes(data[place + 4 : place + 8], "little")
        check(
            size <= len(data) - place - 8,
            name,
            f"a chunk of {size} bytes",
            allowed="chunks that the file holds",
        )
        chunks[data[place : place + 4]] = data[place + 8 : place + 8 + size]
        place += 8 + size + size % 2
    wanted = b"".join(
        value.to_bytes(n, "little") for value, n in ((3, 2), (1, 2), (round(sample_rate), 4))
    )
    body = chunks.get(b"data", b"")
    fits = (
        data[:4] + data[8:12] == b"RIFFWAVE"
        and chunks.get(b"fmt ", b"")[:8] == wanted
        and len(body) == 4 * length
    )
    check(
        fits,
        name,
        f"{len(data)} bytes",
        allowed=f"{length} samples, float32, at {sample_rate:g} Hz, as WAV",
    )
    samples = np.frombuffer(body, "<f4").astype(float)
    check(
        bool(np.isfinite(samples).all() and samples.any()),
        name,
        "NaN or silence",
        allowed="the burst",
    )
    return samples[: np.flatnonzero(samples)[-1] + 1]
