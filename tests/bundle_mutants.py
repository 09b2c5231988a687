"""Bundles as an enemy would leave them: what is done to a copy, and what the refusal says."""

import json
import os
import socket
import warnings
import zipfile
from collections.abc import Callable
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from echolearn.robot import schema
from echolearn.robot.reference import Reference
from echolearn.storage import manifests
from echolearn.storage.files import json_bytes, sha256
from echolearn.survey.audio import wav_bytes

Mutate = Callable[[Path], object]
FILES = ("bundle.json", *schema.LIMITS)
SUMMED = (*schema.LIMITS, schema.REFERENCE)


def seal(folder: Path, **changes: Any) -> None:
    """Make every checksum right again, as an enemy would, after changing keys of `bundle.json`.

    `a__b` is the key b within a; ... removes a key.
    """
    about = json.loads((folder / "bundle.json").read_text())
    about["files"] = {
        name: {"bytes": (folder / name).stat().st_size, "sha256": sha256(folder / name)}
        for name in SUMMED
        if (folder / name).is_file()
    }
    for path, value in changes.items():
        *way, last = path.split("__")
        inside = about
        for key in way:
            inside = inside[key]
        if value is ...:
            del inside[last]
        else:
            inside[last] = value
    (folder / "bundle.json").write_bytes(json_bytes(manifests.with_checksum(about)))


def replaced(name: str, make: Callable[[bytes], bytes]) -> Mutate:
    """Return the mutation that rewrites a file and seals."""

    def mutate(folder: Path) -> None:
        (folder / name).write_bytes(make((folder / name).read_bytes()))
        seal(folder)

    return mutate


def instead(name: str, put: Callable[[Path], object]) -> Mutate:
    """Return the mutation that puts something else in a file's place, which moves outside."""

    def mutate(folder: Path) -> None:
        (folder / name).rename(folder.parent / "outside")
        put(folder / name)

    return mutate


def model(change: Callable[[Any], object]) -> Mutate:
    """Return the mutation that changes the ONNX model and seals."""

    def make(data: bytes) -> bytes:
        proto = onnx.load_from_string(data)
        change(proto)
        return bytes(proto.SerializeToString())

    return replaced("model.onnx", make)


def graph(*nodes: Any, domain: str = "", opset: int = 20, **constants: Any) -> Mutate:
    """Return the mutation that puts another model in place, from x (b, 4) to confidence (b,)."""
    ends = [
        helper.make_tensor_value_info("x", TensorProto.FLOAT, ["b", 4]),
        helper.make_tensor_value_info("confidence", TensorProto.DOUBLE, ["c"]),
    ]
    sets = [helper.make_opsetid("", opset), *([helper.make_opsetid(domain, 1)] if domain else [])]
    given = [numpy_helper.from_array(np.asarray(value), key) for key, value in constants.items()]
    proto = helper.make_graph(list(nodes), "g", ends[:1], ends[1:], given)
    whole = helper.make_model(proto, opset_imports=sets, ir_version=10)
    return replaced("model.onnx", lambda _: bytes(whole.SerializeToString()))


def node(kind: str, inputs: str, output: str = "confidence", **attributes: Any) -> Any:
    """Return an operator, its inputs and its output by their names."""
    return helper.make_node(kind, inputs.split(), [output], **attributes)


def ending(most: str, *nodes: Any, **constants: Any) -> Mutate:
    """Return the mutation that puts a model in place whose confidence is a tensor's largest."""
    last = node("ReduceMax", f"{most} last", "most", keepdims=0)
    double = node("Cast", "most", to=TensorProto.DOUBLE)
    return graph(*nodes, last, double, last=[1], **constants)


def arrays(**changes: Callable[[Any], Any]) -> Mutate:
    """Return the mutation that saves other golden arrays, without those that become None."""

    def make(data: bytes) -> bytes:
        held = dict(np.load(BytesIO(data)))
        held |= {key: change(held.get(key)) for key, change in changes.items()}
        buffer = BytesIO()
        np.savez(buffer, **{key: value for key, value in held.items() if value is not None})
        return buffer.getvalue()

    return replaced("golden.npz", make)


def zipped(data: bytes) -> bytes:
    """Return the golden arrays in a compressed archive."""
    buffer = BytesIO()
    np.savez_compressed(buffer, **np.load(BytesIO(data)))
    return buffer.getvalue()


def headed(header: str) -> Mutate:
    """Return the mutation that makes an archive of arrays with that header and no data."""
    text = header.encode().ljust(117) + b"\n"
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name in ("x.npy", "confidence.npy"):
            archive.writestr(name, b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text)
    return replaced("golden.npz", lambda _: buffer.getvalue())


def external(proto: Any) -> None:
    """Move a tensor into another file."""
    tensor = proto.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")


def added(field: int, inside: bytes, *way: int) -> Mutate:
    """Return the mutation that appends a field to the model, within the fields of `way`."""

    def wrapped(data: bytes, number: int) -> bytes:
        return varint(8 * number + 2) + varint(len(data)) + data

    def make(data: bytes) -> bytes:
        content = wrapped(inside, field)
        for number in reversed(way):
            content = wrapped(content, number)
        return data + content

    return replaced("model.onnx", make)


def referring(
    make: Callable[[bytes], bytes] = lambda data: data, **changes: Any
) -> Callable[[Path], None]:
    """Return the mutation that adds a reference of 100 walks, of two poses each, and spoils it.

    Args:
        make: what becomes of the file.
        changes: what `bundle.json` says of it instead.
    """

    def mutate(folder: Path) -> None:
        rows = np.random.default_rng(0).standard_normal((100, 2, 2)).astype("<f4")
        sound = Reference(("score", "joint"), rows, np.array([[-2, -2], [2, 2]], "<f4"))
        (folder / schema.REFERENCE).write_bytes(make(sound.to_bytes()))
        seal(folder, schema=schema.WITH_REFERENCE, reference=sound.about() | changes)

    return mutate


def saved(**arrays_: Any) -> Callable[[bytes], bytes]:
    """Return what saves other arrays in place of those of a reference."""

    def make(data: bytes) -> bytes:
        buffer = BytesIO()
        np.savez(buffer, **dict(np.load(BytesIO(data))) | arrays_)
        return buffer.getvalue()

    return make


def bomb(_: bytes) -> bytes:
    """Return an archive of 128 MiB of zeros in a few kilobytes."""
    buffer = BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name in ("rows.npy", "limits.npy"):
            archive.writestr(name, bytes(1 << 26))
    return buffer.getvalue()


def varint(number: int) -> bytes:
    """Return a number as protocol buffers have it."""
    more = b"" if number < 128 else varint(number >> 7)
    return bytes([number & 127 | 128 * bool(more)]) + more


def nudge(proto: Any) -> None:
    """Change one number of the model."""
    tensor = next(t for t in proto.graph.initializer if t.data_type == TensorProto.DOUBLE)
    tensor.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(tensor) * 1.5 + 0.1, tensor.name))


def written(text: str) -> Mutate:
    """Return the mutation that writes another `bundle.json`."""
    return lambda folder: (folder / "bundle.json").write_text(text)


def bound(path: Path) -> None:
    """Put a socket in place, whose path may be too long to be told at once."""
    above = os.open(path.parent, os.O_RDONLY)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(f"/proc/self/fd/{above}/{path.name}")
    os.close(above)


def swapped(folder: Path) -> None:
    """Exchange model and golden inputs, and seal."""
    (folder / "model.onnx").rename(folder / "other")
    (folder / "golden.npz").rename(folder / "model.onnx")
    (folder / "other").rename(folder / "golden.npz")
    seal(folder)


def archived(*names: str, method: int = zipfile.ZIP_STORED, size: int = 0) -> Mutate:
    """Return the mutation that makes an archive of files with these names, of zeros."""

    def make(_: bytes) -> bytes:
        buffer = BytesIO()
        zeros = bytes(size)
        with (
            warnings.catch_warnings(),
            zipfile.ZipFile(buffer, "w", method, compresslevel=1) as archive,
        ):
            warnings.simplefilter("ignore", UserWarning)  # names may be there twice
            for name in names:
                archive.writestr(name, zeros)
        return buffer.getvalue()

    # Made only where it is wanted: a bomb takes seconds.
    return replaced("golden.npz", make)


def boastful(data: bytes) -> bytes:
    """Return an archive whose directory says that each of its files has 2 GiB."""
    head, *entries = data.split(b"PK\x01\x02")
    huge = (2**31 - 2).to_bytes(4, "little") * 2
    return b"PK\x01\x02".join([head, *(each[:16] + huge + each[24:] for each in entries)])


def sparse(proto: Any) -> None:
    """Add a sparse tensor of 2^40 numbers, of which one is there."""
    value, place = (numpy_helper.from_array(np.array([1]), name) for name in ("v", "i"))
    proto.graph.sparse_initializer.append(helper.make_sparse_tensor(value, place, [2**40]))


def opset(version: int, domain: str = "") -> Mutate:
    """Return the mutation that imports an operator set more."""
    return model(lambda m: m.opset_import.append(helper.make_opsetid(domain, version)))


MANY = 2**34
WORDS = np.array(["a", "b"], dtype=object)
ONE = np.ones(1, np.float32)
BODY = helper.make_graph([], "body", [], [])
BRANCHES = {"then_branch": BODY, "else_branch": BODY}
MILLIONS = 3 << 20
HUGE = "{'descr': '<f4', 'fortran_order': False, 'shape': (10000000000, 4)}"

BUNDLES: dict[str, tuple[Mutate, str]] = {
    "no folder": (lambda f: f.rename(f.parent / "gone"), "must be a folder that echolearn export"),
    "a pipe": (instead("model.onnx", os.mkfifo), "model.onnx=not a plain file"),
    "a device": (
        instead("probe.wav", lambda p: p.symlink_to("/dev/zero")),
        "it is a symbolic link",
    ),
    "swapped": (swapped, "not an ONNX file"),
    "not JSON": (written("{"), "cannot be read as JSON"),
    "a list": (written("[]"), "damaged"),
    "nested without end": (written("[" * 10**5), "cannot be read as JSON"),
    "a number without end": (written("9" * 10**5), "cannot be read as JSON"),
    "NaN": (written('{"a": NaN}'), "cannot be read as JSON (NaN is no number)"),
    "infinity": (written('{"a": 1e999}'), "(a=inf: must be a finite number"),
    "a key twice": (written('{"a": 1, "a": 2}'), "damaged"),
    "half a character": (written('{"name": "\\ud800"}'), "damaged"),
    "another encoding": (
        lambda f: (f / "bundle.json").write_text((f / "bundle.json").read_text(), "utf-16"),
        "damaged",
    ),
    "a socket": (instead("model.onnx", bound), "cannot be read"),
    "a link to itself": (instead("probe.wav", lambda p: p.symlink_to(p.name)), "symbolic link"),
    "golden other inputs": (arrays(x=lambda x: x[::-1]), "golden confidences differ"),
    "golden other answers": (arrays(confidence=lambda c: c + 1e-4), "differ by 0.0001"),
    "golden NaN": (arrays(confidence=lambda c: c * np.nan), "confidence=NaN or infinity"),
    "golden double": (arrays(x=lambda x: x.astype(float)), "not the arrays"),
    "golden fewer": (arrays(x=lambda x: x[:5]), "not the arrays"),
    "golden objects": (arrays(x=lambda _: np.array([{}], dtype=object)), "not the arrays"),
    "golden one more": (arrays(code=lambda _: np.zeros(1)), "not the arrays"),
    "golden one fewer": (arrays(confidence=lambda _: None), "not the arrays"),
    "golden zipped": (replaced("golden.npz", zipped), "not the arrays"),
    "golden bomb": (
        archived("x.npy", "confidence.npy", method=zipfile.ZIP_DEFLATED, size=1 << 28),
        "not the arrays",
    ),
    "golden of many files": (archived(*map(str, range(99_999))), "not the arrays"),
    "golden of a file twice": (archived("x.npy", "x.npy", "confidence.npy"), "not the arrays"),
    "golden outside": (archived("../../x.npy", "/etc/passwd"), "not the arrays"),
    "golden boastful": (replaced("golden.npz", boastful), "not the arrays"),
    "golden giant": (headed(HUGE), "not the arrays"),
    "golden no literal": (headed("__import__('os').system('true')"), "not the arrays"),
    "probe of another length": (
        replaced("probe.wav", lambda _: wav_bytes(np.ones(9), 22050)),
        "=(1, 9)",
    ),
    "model of text": (replaced("model.onnx", lambda _: b"import os"), "must be an ONNX model"),
    "model with tail": (replaced("model.onnx", lambda d: d + b"\xff" * 9), "not an ONNX file"),
    "model nudged": (model(nudge), "golden confidences differ"),
    "model external": (model(external), "content=data in another file"),
    "model with a function": (model(lambda m: m.functions.add(name="f")), "content=functions"),
    "model with training": (model(lambda m: m.training_info.add()), "content=training info"),
    "model of a later format": (model(lambda m: setattr(m, "ir_version", 10**6)), "refuses it"),
    "model of another input": (model(lambda m: setattr(m.graph.input[0], "name", "y")), "onnx"),
    "model without output": (model(lambda m: m.graph.output.pop()), "model.onnx"),
    "model of giant dims": (
        model(lambda m: m.graph.initializer[0].dims.extend([2**40])),
        "must be as many as it holds",
    ),
    "model of negative dims": (
        model(lambda m: m.graph.initializer[0].dims.extend([-5])),
        "must be as many as it holds",
    ),
    "model of a custom domain": (
        graph(node("Add", "x x", domain="evil"), domain="evil"),
        "domain='evil': must be operators of ONNX itself, none custom",
    ),
    "model with a loop": (graph(node("Identity", "x", body=BODY)), "content=a subgraph"),
    "model with branches": (graph(node("If", "x", **BRANCHES)), "operator='If': must be"),
    "model with hidden branches": (graph(node("Identity", "x", **BRANCHES)), "content=a subgraph"),
    "model with many graphs": (graph(node("Identity", "x", g=[BODY, BODY])), "content=a subgraph"),
    "model that scans": (
        graph(node("Scan", "x", body=BODY, num_scan_inputs=1)),
        "operator='Scan': must be",
    ),
    "model with sparse numbers": (model(sparse), "content=sparse tensors"),
    "model with data elsewhere, unsaid": (
        model(lambda m: m.graph.initializer[0].external_data.add(key="location", value="/etc")),
        "content=data in another file",
    ),
    "model that says data are elsewhere": (
        model(lambda m: setattr(m.graph.initializer[0], "data_location", TensorProto.EXTERNAL)),
        "data location=1: must be inside the file",
    ),
    "model of infinite weights": (
        ending("y", node("Mul", "x infinite", "y"), infinite=ONE * np.inf),
        "numbers from 0 to 1",
    ),
    "model that imports operators": (opset(1, "evil"), "domain='evil'"),
    "model that imports ai.onnx.ml": (opset(3, "ai.onnx.ml"), "domain='ai.onnx.ml'"),
    "model of operators to come": (opset(10**9), "onnxruntime refuses it"),
    "model of negative operators": (opset(-5), "onnxruntime refuses it"),
    "model in a circle": (
        graph(node("Add", "x b", "a"), node("Add", "x a", "b"), node("Identity", "a")),
        "onnxruntime refuses it",
    ),
    "model of one name twice": (
        graph(node("Abs", "x", "a"), node("Neg", "x", "a"), node("Identity", "a")),
        "onnxruntime refuses it",
    ),
    "model of names that move the cursor": (
        graph(node("Identity", "\x1b[2J\x1b]0;a\x07")),
        "'\\x1b[2J",
    ),
    "model with a name of a megabyte": (graph(node("Identity", "x" * 10**6)), "refuses it"),
    "model of inputs without end": (
        model(lambda m: setattr(m.graph.input[0].type.tensor_type.shape.dim[0], "dim_value", MANY)),
        "cannot be computed",
    ),
    "model that looks beyond": (
        ending("y", node("Gather", "x far", "y"), far=[2**40]),
        "cannot be computed",
    ),
    "model of an unknown operator": (graph(node("Steal", "x")), "operator='Steal': must be"),
    "model without nodes": (graph(), "no operators"),
    "model of many nodes": (
        graph(*(node("Identity", f"a{i}", f"a{i + 1}") for i in range(6000))),
        "operators=5001",
    ),
    "model of single precision": (
        graph(node("Cast", "x", to=TensorProto.FLOAT)),
        "onnxruntime refuses it",
    ),
    "model with a text": (
        model(lambda m: m.graph.initializer.append(numpy_helper.from_array(WORDS, "words"))),
        "tensor=texts: must be numbers",
    ),
    "model with an attribute of texts": (
        graph(node("Constant", "", value_strings=["a", "b"])),
        "content=texts",
    ),
    "model with a long text": (
        graph(node("Einsum", "x x", equation="i" * 64)),
        "text=64 bytes: must be fewer",
    ),
    "model with a tensor of texts": (
        graph(node("Constant", "", value=numpy_helper.from_array(WORDS, "words"))),
        "tensor=texts",
    ),
    "model of many fields": (added(13, b"\x0a\x00" * MILLIONS, 7), "fields=200001"),
    "model of many values": (added(7, b"\x6a\x00" * MILLIONS), "fields=200001"),
    "model of many dimensions": (added(1, b"\x0a\x00" * MILLIONS, 7, 13, 2, 1, 2), "fields=20"),
    "model of many properties": (added(14, b"\x0a\x00" * MILLIONS), "fields=200001"),
    "model of many opsets": (
        replaced("model.onnx", lambda data: data + b"\x42\x00" * MILLIONS),
        "fields=200001",
    ),
    "model of a deep tensor": (added(1, b"\x01" * MILLIONS, 7, 5), "tensor=more of them: must"),
    "model of many packed numbers": (added(7, b"\x01" * MILLIONS, 7, 5), "numbers=3145728 bytes"),
    "model of many attribute numbers": (added(8, b"\x81\x10" * 9, 7, 1, 5), "attribute=2049"),
    "model of a giant kernel": (
        graph(node("MaxPool", "x", kernel_shape=[2**30])),
        "attribute=1073741824: must be at most 1024, as kernels and axes are",
    ),
    "model of giant padding": (
        graph(node("Conv", "x x", pads=[-(2**40), 0])),
        "attribute=1099511627776",
    ),
    "model of a giant axis": (graph(node("Concat", "x x", axis=-1025)), "attribute=1025: must"),
    "model of sequences": (added(4, b"", 7, 11, 2), "content=sequences"),
    "model that answers beyond 1": (ending("x"), "must be 32 numbers from 0 to 1"),
    "model of NaN": (
        ending("y", node("Mul", "x nan", "y"), nan=ONE * np.nan),
        "numbers from 0 to 1",
    ),
    "model of a giant product": (
        ending(
            "c",
            node("Expand", "one tall", "a"),
            node("Expand", "one wide", "b"),
            node("Mul", "a b", "c"),
            one=ONE,
            tall=[2**20, 1],
            wide=[1, 2**20],
        ),
        "cannot be computed",
    ),
    "model that never ends": (
        ending(
            "a4000",
            node("Expand", "one size", "a0"),
            *(node("MatMul", f"a{i} a0", f"a{i + 1}") for i in range(4000)),
            one=ONE,
            size=[1500, 1500],
        ),
        "cannot be computed",
    ),
}


def lazily(folder: Path) -> None:
    """Put a model in place that costs nothing for golden inputs, zeros, and hours for others."""
    last = {"keepdims": 0}
    graph(
        node("Abs", "x", "size"),
        node("ReduceMax", "size", "most", axes=[0, 1], **last),
        node("Sign", "most", "any"),
        node("Mul", "any many", "fewer"),
        node("Add", "fewer one", "side"),
        node("Cast", "side", "whole", to=TensorProto.INT64),
        node("Concat", "whole whole", "sides", axis=0),
        node("Expand", "one sides", "a0"),
        *(node("MatMul", f"a{i} a0", f"a{i + 1}") for i in range(4000)),
        node("ReduceMin", "a4000", "least", axes=[0, 1], **last),
        node("ReduceMax", "size", "each", axes=[1], **last),
        node("Mul", "each zero", "nothing"),
        node("Mul", "least zero", "nothing_more"),
        node("Add", "nothing nothing_more", "sum"),
        node("Cast", "sum", to=TensorProto.DOUBLE),
        opset=13,
        many=1499 * ONE,
        one=ONE,
        zero=0 * ONE,
    )(folder)
    arrays(x=lambda x: 0 * x, confidence=lambda c: 0 * c)(folder)


LATER: dict[str, Mutate] = {"model that is lazy for golden inputs": lazily}
"""Bundles that are sound until a survey is mapped with them."""

BUNDLES |= {
    f"{name} {what}": (instead(name, put), f"{name}{said}")
    for name in FILES
    for what, put, said in (
        ("absent", lambda path: None, ": cannot be read"),
        ("a folder", Path.mkdir, ": cannot be read (Is a directory)"),
        ("a link out", lambda path: path.symlink_to("../outside"), ": cannot be read (it is a sym"),
        ("10 TiB", lambda path: (path.touch(), os.truncate(path, 10 << 40)), "=10995116277760 by"),
    )
}
BUNDLES |= {
    f"model of much by {kind}": (
        ending("big", node(kind, " ".join(given), "big", **attributes), **given),
        "model.onnx",
    )
    for kind, given, attributes in (
        ("Expand", {"zero": 0 * ONE, "size": [MANY, 1]}, {}),
        ("ConstantOfShape", {"size": [MANY, 1]}, {}),
        ("Range", {"start": 0.0, "end": 1e12, "step": 1.0}, {}),
        ("Tile", {"one": ONE, "times": [MANY]}, {}),
        ("Pad", {"one": ONE, "ends": [0, MANY]}, {}),
        ("OneHot", {"index": [0], "depth": MANY, "values": np.float32([0, 1])}, {}),
        ("Resize", {"one": ONE[None, None], "none": ONE[:0], "by": np.float32([1, 1, 2**34])}, {}),
        ("RandomNormal", {}, {"shape": [MANY, 1]}),
    )
}
BUNDLES |= {
    f"model with {kind}": (graph(node(kind, "x")), f"operator='{kind}': must be")
    for kind in """
    Bernoulli Compress DFT GridSample ImageDecoder LSTM Loop Multinomial NonMaxSuppression NonZero
    Optional RegexFullMatch RoiAlign ScatterND Scan SequenceConstruct StringConcat TfIdfVectorizer
    Unique
    """.split()
}
BUNDLES |= {
    f"{path} of {what}": (partial(seal, **{path: value}), said)
    for path, what, value, said in (
        ("localizer", "a target", {"_target_": "os.system"}, "localizer.key=_target_: must be one"),
        ("localizer__name", "a path", "echolearn.cli.main.main", "must be one of em, gated"),
        ("localizer__arguments", "a target", {"_target_": "os.system"}, "_target_: must be some"),
        ("_target_", "a command", "os.system", "key=_target_: must be one of"),
        ("command", "another program", "rm -rf /", "must be one command line of echolearn"),
        ("name", "a line of a megabyte", "a" * 10**6, "must be a printable text"),
        ("classifier", "a moving cursor", "\x1b[2J", "must be a printable text"),
        ("run", "text from right to left", "\u202ebest", "must be a printable text"),
        ("sample_rate", "many digits", 10**4000, "must be a number from 1000"),
        ("threshold__value", "a large number", 1e308, "must be a number from 0 to 1"),
        ("seed", "a negative number", -(2**80), "must be a whole number"),
        ("array", "many microphones", [[0.1, 0.0, 0.0]] * 20_000, "must be 1 to 256"),
        ("metrics__maps", "nested lists", [[[[]]]], "must be a mapping"),
        ("probe__file", "a path", "../../etc/passwd", "must be probe.wav"),
    )
}

NOT_HELD = "reference.npz: not the arrays it should hold"
ROWS = np.zeros((100, 2, 2), "<f4")
BUNDLES |= {
    f"reference {what}": (referring(make, **changes), said)
    for what, make, changes, said in (
        ("not an archive", lambda data: b"PK" + data[2:9], {}, NOT_HELD),
        ("of pickles", saved(rows=np.array([[WORDS]] * 100, dtype=object)), {}, NOT_HELD),
        ("packed", zipped, {}, NOT_HELD),
        ("a bomb", bomb, {}, NOT_HELD),
        ("boastful", boastful, {}, NOT_HELD),
        ("of doubles", saved(rows=ROWS.astype(float)), {}, NOT_HELD),
        ("of another shape", saved(rows=ROWS[:, :1]), {}, NOT_HELD),
        ("of more walks", lambda data: data, {"walks": 101}, NOT_HELD),
        ("with more arrays", saved(more=ROWS), {}, NOT_HELD),
        ("of NaN", saved(rows=ROWS * np.nan), {}, "reference.npz rows=NaN or infinity"),
        ("of infinity", saved(limits=np.full((2, 2), np.inf, "<f4")), {}, "limits=NaN or inf"),
        ("upside down", saved(limits=np.float32([[2, 2], [-2, -2]])), {}, "must be the lower"),
        ("of no columns", lambda data: data, {"columns": []}, "reference.columns=: must be"),
        ("of one twice", lambda data: data, {"columns": ["joint"] * 2}, "reference.columns=joint"),
        ("of the truth", lambda data: data, {"columns": ["score", "reflector"]}, "must be columns"),
        ("of 10^12 walks", lambda data: data, {"walks": 10**12}, "reference.walks=1000000000000"),
        ("larger than any", lambda data: data + bytes(17 << 20), {}, "must be at most 16777216"),
        ("with a key more", lambda data: data, {"code": "x"}, "reference.key=code: must be one"),
    )
} | {
    "reference untold": (lambda f: (referring()(f), seal(f, schema=3)), "key=reference: must be"),
    "reference absent": (
        lambda f: (referring()(f), (f / "reference.npz").unlink()),
        "reference.npz: cannot be read",
    ),
}
