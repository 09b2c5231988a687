"""Files from strangers, refused for what they might do rather than for what they say.

    read_bytes    bytes of a plain file, never more than a limit; no symbolic links, pipes, devices
    read_arrays   arrays of an `.npz` whose names, types and shapes are known beforehand, so no size
                  is believed
    check_onnx    an ONNX model that computes and does nothing else

An ONNX file is a protocol buffer: a sequence of (key, value), key = 8 * field number + wire type,
and a value is a varint (type 0), 8 or 4 bytes (types 1 and 5), or a length followed by as many
bytes (type 2): numbers, text, or another message. `MESSAGES` names the fields of onnx.proto3 (IR
version 10) on the way to everything that reaches outside the file (external data), calls foreign
code (operators of another domain, functions), or repeats without an end (subgraphs of Loop, Scan
and If). Whatever appears twice is looked at twice, so it does not matter which one a parser takes.
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
from echolearn.storage.files import one_line

Value = int | memoryview

MOST_NODES = 5000
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


def read_bytes(path: Path, *, limit: int) -> bytes:
    """Return the bytes of a plain file.

    Raises:
        BadValue: it is missing, larger than `limit` bytes, a symbolic link, or no plain file.
    """
    try:
        # Not blocking: a pipe that nobody writes to would be waited for.
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        reason = "it is a symbolic link" if path.is_symlink() else error.strerror or error
        raise BadValue(f"{path}: cannot be read ({reason})") from None
    with os.fdopen(handle, "rb") as file:
        about = os.fstat(handle)
        check(
            stat.S_ISREG(about.st_mode),
            str(path),
            "not a plain file",
            allowed="must be a plain file",
        )
        size = about.st_size
        check(size <= limit, str(path), f"{size} bytes", allowed=f"must be at most {limit} bytes")
        return file.read(limit)


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
                raise ValueError(f"holds {names}, packed or not")
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


def check_onnx(data: bytes, *, name: str) -> None:
    """Raise `BadValue` unless a model is whole, alone, of standard operators, and without loops."""
    nodes = 0
    try:
        for role, value in _marked(memoryview(data), "model"):
            nodes += role == "node"
            check(nodes <= MOST_NODES, "operators", nodes, allowed=f"must be at most {MOST_NODES}")
            _check_role(role, value)
    except BadValue as error:
        raise BadValue(f"{name} {error}") from None
    except (ValueError, IndexError, RecursionError) as error:
        raise BadValue(f"{name}: not an ONNX file ({error})") from None
    check(nodes > 0, name, "no operators", allowed="must be an ONNX model")


def _marked(message: memoryview, kind: str) -> Iterator[tuple[str, Value]]:
    """Yield each message of `MESSAGES` and each of its marked fields, with its role."""
    yield kind, message
    for number, value in _fields(message):
        role = MESSAGES[kind].get(number)
        if role not in MESSAGES:
            if role:
                yield role, value
        elif isinstance(value, memoryview):
            yield from _marked(value, role)
        else:
            raise ValueError(f"field {number} of {kind} is a number")


def _check_role(role: str, value: Value) -> None:
    """Raise `BadValue` if a marked field, or the size that a tensor declares, is not allowed."""
    if role.startswith("!"):
        alone = "nothing of the kind; a bundle's model stands alone, without loops"
        raise BadValue(f"content={role[1:]}: {alone}")
    if role == "location":
        check(value == 0, "data location", str(value), allowed="must be inside the file")
    if isinstance(value, int):
        check(role != "domain", "domain", value, allowed="must be a text")
    elif role == "domain":
        domain = bytes(value[:64]).decode("latin1")
        allowed = "must be operators of ONNX itself, none custom"
        check(domain in ("", "ai.onnx"), "domain", repr(domain), allowed=allowed)
    elif role == "tensor":
        # Before anybody makes room for a tensor of the size that it claims.
        elements = math.prod(_dimensions(value))
        fits = elements <= 8 * len(value)
        check(fits, "tensor", f"{elements} elements", allowed="must be as many as it holds")


def _dimensions(tensor: memoryview) -> Iterator[int]:
    """Yield the dimensions of a tensor, which come one by one or several in a packed field."""
    for number, value in _fields(tensor):
        if number != 1:
            continue
        if isinstance(value, int):
            yield value
            continue
        place = 0
        while place < len(value):
            dimension, place = _varint(value, place)
            yield dimension


def _fields(message: memoryview) -> Iterator[tuple[int, Value]]:
    """Yield number and value of each field of a message.

    Raises:
        ValueError, IndexError: it is cut or malformed.
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
