"""ONNX models from strangers: taken where they compute and do nothing else.

An ONNX file is a protocol buffer: a sequence of (key, value), key = 8 * field number + wire type,
and a value is a varint (type 0), 8 or 4 bytes (types 1 and 5), or a length followed by as many
bytes (type 2): numbers, text, or another message. `MESSAGES` names the fields of onnx.proto3 (IR
version 10) by what they hold. Refused is what reaches outside the file (external data), calls
foreign code (operators that are not in `OPERATORS`, functions), repeats without an end (subgraphs
of Loop, Scan and If), or is larger in memory than in the file: texts, kernels, and more fields than
any classifier has. Whatever appears twice is looked at twice, so it does not matter which one a
parser takes.
"""

import math
from collections.abc import Iterator
from itertools import islice

from echolearn.checks import BadValue, check

Value = int | memoryview

MOST_NODES = 5000
"""Most operators in a model."""

MOST_FIELDS = 200_000
"""Most fields in a model, those of messages within it among them."""

MOST_DIMENSIONS = 8
"""Most dimensions of a tensor."""

LARGEST_NUMBER = 1024
"""Largest magnitude of a whole number among attributes: a kernel, a stride, padding, an axis."""

LARGEST_LIST = 1 << 16
"""Bytes of numbers that stand in a list; a tensor of more keeps them as raw bytes."""

OPERATORS = frozenset(
    """
    Abs Add And ArgMax ArgMin AveragePool BatchNormalization Cast Ceil Clip Concat Constant
    ConstantOfShape Conv Cos CumSum Div Dropout Einsum Elu Equal Erf Exp Expand Flatten Floor Gather
    GatherElements GatherND Gelu Gemm GlobalAveragePool GlobalMaxPool Greater GreaterOrEqual
    HardSigmoid HardSwish Identity InstanceNormalization LayerNormalization LeakyRelu Less
    LessOrEqual Log LogSoftmax MatMul Max MaxPool Mean Min Mish Mod Mul Neg Not Or PRelu Pow
    Reciprocal ReduceL1 ReduceL2 ReduceLogSumExp ReduceMax ReduceMean ReduceMin ReduceProd ReduceSum
    ReduceSumSquare Relu Reshape Round Selu Shape Sigmoid Sign Sin Size Slice Softmax Softplus
    Softsign Split Sqrt Squeeze Sub Sum Tanh TopK Transpose Trilu Unsqueeze Where Xor
    """.split()
)
"""Operators of which a classifier may be made: arithmetic, and what rearranges numbers."""

MESSAGES: dict[str, dict[int, str]] = {
    "model": {
        7: "graph",
        8: "opset",
        14: "property",
        20: "!training info",
        25: "!functions",
        26: "!devices",
    },
    "graph": {
        1: "node",
        5: "tensor",
        11: "value",
        12: "value",
        13: "value",
        14: "!quantization",
        15: "!sparse tensors",
        16: "property",
    },
    "node": {4: "operator", 5: "attribute", 7: "domain", 9: "property", 10: "!devices"},
    "attribute": {
        3: "number",
        4: "text",
        5: "tensor",
        6: "!a subgraph",
        7: "list",
        8: "number",
        9: "!texts",
        10: "tensor",
        11: "!a subgraph",
        14: "!types",
        15: "!types",
        22: "!sparse",
        23: "!sparse",
    },
    "tensor": {
        2: "type",
        4: "list",
        5: "list",
        6: "!texts",
        7: "list",
        10: "list",
        11: "list",
        13: "!data in another file",
        14: "location",
        16: "property",
    },
    "value": {2: "kind", 4: "property"},
    "kind": {1: "array", 4: "!sequences", 5: "!maps", 8: "!sparse", 9: "!optionals"},
    "array": {2: "shape"},
    "shape": {1: "dimension"},
    "dimension": {},
    "property": {},
    "opset": {1: "domain"},
}
"""Fields that matter, by the role that `_check_role` knows; ! is forbidden, other names here are
messages."""

TEXTS = 8
"""Type of a tensor of texts."""


def check_onnx(data: bytes, *, name: str) -> None:
    """Raise `BadValue` unless a model is whole, alone, of standard operators, and without loops."""
    nodes = 0
    try:
        for count, (role, value) in enumerate(_walk(memoryview(data), "model"), 1):
            nodes += role == "node"
            check(nodes <= MOST_NODES, "operators", nodes, allowed=f"must be at most {MOST_NODES}")
            check(count <= MOST_FIELDS, "fields", count, allowed=f"must be at most {MOST_FIELDS}")
            _check_role(role, value)
    except BadValue as error:
        raise BadValue(f"{name} {error}") from None
    except (ValueError, IndexError) as error:
        raise BadValue(f"{name}: not an ONNX file ({error})") from None
    check(nodes > 0, name, "no operators", allowed="must be an ONNX model")


def _walk(message: memoryview, kind: str) -> Iterator[tuple[str, Value]]:
    """Yield each field of a message and of those within it, with its role, if it has one."""
    for number, value in _fields(message):
        role = MESSAGES[kind].get(number, "")
        yield role, value
        if role not in MESSAGES:
            continue
        if not isinstance(value, memoryview):
            raise ValueError(f"field {number} of {kind} is a number")
        yield from _walk(value, role)


def _check_role(role: str, value: Value) -> None:
    """Raise `BadValue` if a field, or the size that a tensor declares, is not allowed."""
    if role.startswith("!"):
        alone = "nothing of the kind; a bundle's model stands alone, without loops"
        raise BadValue(f"content={role[1:]}: {alone}")
    if role in ("operator", "domain", "text"):
        _check_text(role, value)
    elif role == "number":
        _check_numbers(value)
    elif role == "tensor" and isinstance(value, memoryview):
        _check_dimensions(value)
    elif role == "list" and isinstance(value, memoryview):
        allowed = f"must be at most {LARGEST_LIST} bytes of them"
        check(len(value) <= LARGEST_LIST, "numbers", f"{len(value)} bytes", allowed=allowed)
    elif role == "type":
        check(value != TEXTS, "tensor", "texts", allowed="must be numbers")
    elif role == "location":
        check(value == 0, "data location", str(value), allowed="must be inside the file")


def _check_text(role: str, value: Value) -> None:
    """Raise `BadValue` unless a text is short, and names an operator of ONNX where it names one."""
    if isinstance(value, int):
        raise ValueError(f"{role} is a number")
    text = bytes(value[:64]).decode("latin1")
    if role == "operator":
        allowed = "must be arithmetic or a rearrangement, as classifiers are made of"
        check(text in OPERATORS, role, f"{text!a}", allowed=allowed)
    elif role == "domain":
        allowed = "must be operators of ONNX itself, none custom"
        check(text in ("", "ai.onnx"), role, f"{text!a}", allowed=allowed)
    else:
        check(len(value) < 64, role, f"{len(value)} bytes", allowed="must be fewer than 64 bytes")


def _check_numbers(value: Value) -> None:
    """Raise `BadValue` unless the whole numbers of an attribute are those of kernels and axes."""
    for number in _varints(value):
        # Negative ones are stored as 2^64 less their magnitude.
        size = min(number, 2**64 - number)
        allowed = f"must be at most {LARGEST_NUMBER}, as kernels and axes are"
        check(size <= LARGEST_NUMBER, "attribute", size, allowed=allowed)


def _check_dimensions(tensor: memoryview) -> None:
    """Raise `BadValue` unless a tensor holds as many elements as it claims."""
    dimensions = list(islice(_dimensions(tensor), MOST_DIMENSIONS + 1))
    allowed = f"must have at most {MOST_DIMENSIONS} dimensions"
    check(len(dimensions) <= MOST_DIMENSIONS, "tensor", "more of them", allowed=allowed)
    # Before anybody makes room for a tensor of the size that it claims.
    elements = math.prod(dimensions)
    fits = elements <= 8 * len(tensor)
    check(fits, "tensor", f"{elements} elements", allowed="must be as many as it holds")


def _dimensions(tensor: memoryview) -> Iterator[int]:
    """Yield the dimensions of a tensor."""
    for number, value in _fields(tensor):
        if number == 1:
            yield from _varints(value)


def _varints(value: Value) -> Iterator[int]:
    """Yield whole numbers, which come one by one or several in a packed field."""
    if isinstance(value, int):
        yield value
        return
    place = 0
    while place < len(value):
        number, place = _varint(value, place)
        yield number


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
