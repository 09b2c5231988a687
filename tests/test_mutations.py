"""Bundles as an enemy or a bad disk would leave them: each refused in one clear line, at once, none taken for sound."""

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from echolearn import bundle, deploy, store
from echolearn.types import BadValue

Mutate = Callable[[Path], None]
FILES = ("bundle.json", "model.onnx", "golden.npz", "probe.wav")
MUTATIONS: dict[str, tuple[Mutate, str]] = {}
"""What is done to a copy of a bundle, and what the refusal says."""


def seal(folder: Path, **changes: Any) -> None:
    """Make every checksum right again, as an enemy would, after changing keys of `bundle.json`; ... removes one."""
    about = json.loads((folder / "bundle.json").read_text())
    about.pop("sha256")
    about = {key: value for key, value in (about | changes).items() if value is not ...}
    if isinstance(about.get("files"), dict) and "files" not in changes:
        about["files"] = {
            name: {"bytes": (folder / name).stat().st_size, "sha256": store.sha256(folder / name)}
            for name in bundle.LIMITS
            if (folder / name).is_file()
        }
    (folder / "bundle.json").write_bytes(store.readable(store.stamped(about)))


def keys(said: str, **changes: Any) -> tuple[Mutate, str]:
    """Return the mutation that changes keys and seals."""
    return lambda folder: seal(folder, **changes), said


def nested(said: str, part: str, **changes: Any) -> tuple[Mutate, str]:
    """Return the mutation that changes keys within a mapping and seals."""

    def mutate(folder: Path) -> None:
        inside = json.loads((folder / "bundle.json").read_text())[part] | changes
        seal(folder, **{part: {key: value for key, value in inside.items() if value is not ...}})

    return mutate, said


def flip(name: str, share: float, bit: int) -> Mutate:
    """Return the mutation that flips one bit."""

    def mutate(folder: Path) -> None:
        data = bytearray((folder / name).read_bytes())
        data[int(share * (len(data) - 1))] ^= 1 << bit
        (folder / name).write_bytes(data)

    return mutate


def cut(name: str, share: float, *, sealed: bool = False) -> Mutate:
    """Return the mutation that keeps a share of a file."""

    def mutate(folder: Path) -> None:
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: int(share * len(data))])
        if sealed:
            seal(folder)

    return mutate


def replaced(name: str, make: Callable[[bytes], bytes]) -> Mutate:
    """Return the mutation that rewrites a file and seals."""

    def mutate(folder: Path) -> None:
        (folder / name).write_bytes(make((folder / name).read_bytes()))
        seal(folder)

    return mutate


def model(change: Callable[[Any], object]) -> Mutate:
    """Return the mutation that changes the ONNX model and seals."""

    def make(data: bytes) -> bytes:
        proto = onnx.load_from_string(data)
        change(proto)
        return bytes(proto.SerializeToString())

    return replaced("model.onnx", make)


def arrays(**changes: Any) -> Mutate:
    """Return the mutation that saves other golden arrays and seals."""

    def make(data: bytes) -> bytes:
        from io import BytesIO

        held = dict(np.load(BytesIO(data)))
        buffer = BytesIO()
        changed = {key: value(held.get(key)) for key, value in changes.items()}
        (np.savez_compressed if "zipped" in changes else np.savez)(
            buffer, **{k: v for k, v in (held | changed).items() if v is not None}
        )
        return buffer.getvalue()

    return replaced("golden.npz", make)


def graph(*nodes: Any, initializers: tuple[Any, ...] = (), domain: str = "") -> Mutate:
    """Return the mutation that puts another model in place, from x (b, 4) to confidence (b,)."""
    ends = [
        helper.make_tensor_value_info("x", TensorProto.FLOAT, ["b", 4]),
        helper.make_tensor_value_info("confidence", TensorProto.DOUBLE, ["c"]),
    ]
    sets = [helper.make_opsetid("", 20), *([helper.make_opsetid(domain, 1)] if domain else [])]
    proto = helper.make_model(
        helper.make_graph(list(nodes), "g", ends[:1], ends[1:], list(initializers)), opset_imports=sets, ir_version=10
    )
    return replaced("model.onnx", lambda _: proto.SerializeToString())


def external(proto: Any) -> None:
    """Move a tensor into another file."""
    tensor = proto.graph.initializer[0]
    tensor.ClearField("raw_data")
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")


def inner(kind: str) -> Any:
    """Return a node that holds a subgraph: a loop that would run a million million times."""
    body = helper.make_graph([], "body", [], [])
    return helper.make_node(kind, ["x"], ["confidence"], body=body)


def linked(name: str, target: str) -> Mutate:
    """Return the mutation that puts a symbolic link in a file's place."""

    def mutate(folder: Path) -> None:
        content = (folder / name).read_bytes()
        (folder.parent / "outside").write_bytes(content)
        (folder / name).unlink()
        (folder / name).symlink_to(target)

    return mutate


def pipe(folder: Path) -> None:
    """Put a pipe, which nobody ever writes to, in a file's place."""
    (folder / "model.onnx").unlink()
    os.mkfifo(folder / "model.onnx")


def huge(name: str) -> Mutate:
    """Return the mutation that makes a file a terabyte long, without a byte of it on the disk."""
    return lambda folder: os.truncate(folder / name, 1 << 40)


def swap(first: str, second: str, *, sealed: bool) -> Mutate:
    """Return the mutation that exchanges two files."""

    def mutate(folder: Path) -> None:
        a, b = (folder / first).read_bytes(), (folder / second).read_bytes()
        (folder / first).write_bytes(b)
        (folder / second).write_bytes(a)
        if sealed:
            seal(folder)

    return mutate


def constant(value: Any, name: str) -> Any:
    return numpy_helper.from_array(np.asarray(value), name)


def nudge(proto: Any) -> None:
    """Change one number of the model: the calibration's slope or whatever is scalar and double first."""
    tensor = next(t for t in proto.graph.initializer if t.data_type == TensorProto.DOUBLE and not t.dims)
    tensor.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(tensor) * 1.5 + 0.1, tensor.name))


def npy(header: str) -> Callable[[bytes], bytes]:
    """Return a function that makes an archive whose first array has that header and no data."""

    def make(_: bytes) -> bytes:
        import zipfile
        from io import BytesIO

        buffer = BytesIO()
        with zipfile.ZipFile(buffer, "w") as archive:
            text = header.encode().ljust(117) + b"\n"
            for name in ("x.npy", "confidence.npy"):
                archive.writestr(name, b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text)
        return buffer.getvalue()

    return make


for file_ in FILES:
    for place, bit in ((0.0, 0), (0.3, 7), (0.5, 1), (0.77, 4), (1.0, 2)):
        MUTATIONS[f"bit {bit} at {place} of {file_}"] = (flip(file_, place, bit), f"{file_}")
    for share in (0.0, 0.5, 0.99):
        MUTATIONS[f"{share} of {file_}"] = (cut(file_, share), file_)
    MUTATIONS[f"{file_} absent"] = (lambda folder, name=file_: (folder / name).unlink(), f"{file_}: cannot be read")  # type: ignore[misc]
    MUTATIONS[f"{file_} a link out"] = (linked(file_, "../outside"), f"{file_}: cannot be read (it is a symbolic link")
    MUTATIONS[f"{file_} a terabyte"] = (huge(file_), "1099511627776 bytes: at most")
for file_ in FILES[1:]:
    MUTATIONS[f"half of {file_}, sealed"] = (cut(file_, 0.5, sealed=True), file_)
    MUTATIONS[f"nothing of {file_}, sealed"] = (cut(file_, 0.0, sealed=True), file_)

MUTATIONS |= {
    "no folder": (lambda folder: folder.rename(folder.parent / "gone"), "a folder that echolearn export wrote"),
    "a pipe": (pipe, "model.onnx=not a plain file"),
    "a device": (linked("probe.wav", "/dev/zero"), "it is a symbolic link"),
    "swapped": (swap("model.onnx", "golden.npz", sealed=False), "damaged"),
    "swapped, sealed": (swap("model.onnx", "golden.npz", sealed=True), "golden.npz: not the arrays"),
    "swapped probe, sealed": (swap("model.onnx", "probe.wav", sealed=True), "not an ONNX file"),
    "not JSON": (lambda f: (f / "bundle.json").write_text("{"), "cannot be read as JSON"),  # type: ignore[func-returns-value, arg-type, return-value]
    "a list": (lambda f: (f / "bundle.json").write_text("[]"), "damaged"),  # type: ignore[return-value, arg-type]
    "nested without end": (lambda f: (f / "bundle.json").write_text("[" * 10**5), "cannot be read as JSON"),  # type: ignore[return-value, arg-type]
    "a number without end": (lambda f: (f / "bundle.json").write_text("9" * 10**5), "cannot be read as JSON"),  # type: ignore[return-value, arg-type]
    "NaN in JSON": (
        lambda f: (f / "bundle.json").write_text((f / "bundle.json").read_text().replace("343.0", "NaN")),  # type: ignore[return-value, arg-type]
        "cannot be read as JSON",
    ),
    "another schema": keys("schema=2: 1; this echolearn reads schema 1", schema=2),
    "schema as text": keys("schema=1", schema="1"),
    "schema true": keys("schema=True", schema=True),
    "another kind": keys("kind=set: bundle", kind="set"),
    "no threshold": keys("without threshold", threshold=...),
    "no files": keys("without files", files=...),
    "a key too many": keys("with code", code="import os"),
    "files up": keys("files=['../../etc/passwd']", files={"../../etc/passwd": {"bytes": 1, "sha256": "0"}}),
    "files absolute": keys("files=['/etc/passwd']", files={"/etc/passwd": {"bytes": 1, "sha256": "0"}}),
    "files a list": keys("files=['model.onnx']", files=["model.onnx"]),
    "files without sums": keys("damaged", files=dict.fromkeys(bundle.LIMITS)),
    "threshold NaN": nested("threshold.value=nan", "threshold", value="nan"),
    "threshold 2": nested("threshold.value=2", "threshold", value=2),
    "threshold true": nested("threshold.value=True", "threshold", value=True),
    "threshold without value": nested("threshold=['chosen']", "threshold", value=...),
    "threshold a number": keys("threshold=0.5: a mapping with value chosen", threshold=0.5),
    "another label": nested("label.name=wall", "label", name="wall"),
    "rate 0": keys("sample_rate=0 Hz", sample_rate=0),
    "rate as text": keys("sample_rate=fast Hz", sample_rate="fast"),
    "another rate": keys("probe.wav=", sample_rate=44100.0),
    "speed of light": keys("speed_of_sound=300000000.0", speed_of_sound=3e8),
    "no microphones": keys("array=0 microphones", array=[]),
    "one microphone fewer": keys("", array=[[0.2, 0.0, 0.0]] * 1000),
    "flat microphones": keys("array=[0.2, 0.0]", array=[[0.2, 0.0]]),
    "text for microphones": keys("array=here", array="here"),
    "microphone far away": keys("array=1e+30 m", array=[[1e30, 0.0, 0.0]]),
    "window turned": nested("window.nearest=5.0 m", "window", nearest=5.0),
    "window of text": nested("window.nearest=near", "window", nearest="near"),
    "window with more": nested("window=", "window", run="rm"),
    "window rule": nested("window.rule=all", "window", rule="all"),
    "another localizer": nested("localizer.name=os.system", "localizer", name="os.system"),
    "a function": nested("localizer.name=snls.mpdr_spectrum", "localizer", name="snls.mpdr_spectrum"),
    "another's class": nested("localizer.name=gated.Matched", "localizer", name="gated.Matched"),
    "no localizer at all": nested("localizer.name=matched.Matched", "localizer", name="matched.Matched"),
    "a path": nested("localizer.name=../x.Gated", "localizer", name="../x.Gated"),
    "dunder": nested("localizer.name=gated.__class__", "localizer", name="gated.__class__"),
    "a number for a name": nested("localizer.name=7", "localizer", name=7),
    "giant grid": nested("localizer.azimuths=1000000000", "localizer", arguments={"azimuths": 10**9}),
    "unknown argument": nested("localizer.arguments={'shell': 1}", "localizer", arguments={"shell": 1}),
    "list argument": nested("localizer.arguments={'azimuths': [36]}", "localizer", arguments={"azimuths": [36]}),
    "another column": keys("columns=['snr_db']", columns=[{"name": "snr_db", "unit": "dB"}]),
    "another unit": keys("columns=['ms']: the units ['s']", columns=[{"name": "toa", "unit": "ms"}]),
    "no columns": keys("columns=[]", columns=[]),
    "fewer columns": keys("input_shape=[4]: [1]", columns=[{"name": "joint", "unit": "1"}]),
    "columns twice": keys("each once", columns=[{"name": "joint", "unit": "1"}] * 4),
    "giant input": keys("input_shape=[1000000000000]", input_shape=[10**12]),
    "negative input": keys("input_shape=[-4]", input_shape=[-4]),
    "another view": keys("view=patch", view="patch"),
    "tensor of columns": keys("columns=", view="covariance"),
    "probe length": nested("probe.length=", "probe", length=10**15),
    "burst": nested("probe.burst=7: 1500, as probe.wav has it", "probe", burst=7),
    "probe of NaN": (
        replaced("probe.wav", lambda d: d[:-4] + np.float32("nan").tobytes()), "NaN or silence"
    ),
    "probe of silence": (
        replaced("probe.wav", lambda d: d[:-24000] + bytes(24000)), "NaN or silence"
    ),
    "giant chunk": (replaced("probe.wav", lambda d: d[:16] + b"\xff" * 4 + d[20:]), "probe.wav="),
    "golden other inputs": (arrays(x=lambda x: x[::-1]), "golden confidences differ"),
    "golden other answers": (arrays(confidence=lambda c: c + 1e-4), "golden confidences differ by 0.0001"),
    "golden NaN": (arrays(confidence=lambda c: c * np.nan), "golden.npz confidence=NaN or infinity"),
    "golden infinity": (arrays(x=lambda x: x + np.float32(np.inf)), "golden.npz x=NaN or infinity"),
    "golden double": (arrays(x=lambda x: x.astype(float)), "not the arrays it should hold"),
    "golden fewer": (arrays(x=lambda x: x[:5]), "not the arrays it should hold"),
    "golden objects": (arrays(x=lambda x: np.array([{}, 1], dtype=object)), "not the arrays it should hold"),
    "golden one more": (arrays(code=lambda _: np.zeros(1)), "not the arrays it should hold"),
    "golden one fewer": (arrays(confidence=lambda _: None), "not the arrays it should hold"),
    "golden zipped": (arrays(zipped=lambda _: np.zeros(1)), "not the arrays it should hold"),
    "golden giant": (
        replaced("golden.npz", npy("{'descr': '<f4', 'fortran_order': False, 'shape': (10000000000, 4)}")), "npz"
    ),
    "golden no literal": (replaced("golden.npz", npy("__import__('os').system('true')")), "not the arrays"),
    "model of text": (replaced("model.onnx", lambda _: b"import os"), "model.onnx=no operators: an ONNX model"),
    "model with tail": (replaced("model.onnx", lambda d: d + b"\xff" * 9), "not an ONNX file"),
    "model nudged": (model(nudge), "golden confidences differ"),
    "model external": (model(external), "contains data in another file"),
    "model of a custom domain": (
        graph(helper.make_node("Steal", ["x"], ["confidence"], domain="evil"), domain="evil"),
        "domain='evil': operators of ONNX itself, none custom",
    ),
    "model of Microsoft's domain": (
        graph(helper.make_node("Gelu", ["x"], ["confidence"], domain="com.microsoft"), domain="com.microsoft"),
        "domain='com.microsoft'",
    ),
    "model with a loop": (graph(inner("Loop")), "contains a subgraph"),
    "model with a branch": (graph(inner("If")), "contains a subgraph"),
    "model of an unknown operator": (graph(helper.make_node("Steal", ["x"], ["confidence"])), "onnxruntime refuses it"),
    "model without nodes": (graph(), "no operators"),
    "model of giant dims": (
        model(lambda m: m.graph.initializer[0].dims.extend([2**40])), "elements: as many as it holds"
    ),
    "model of negative dims": (
        model(lambda m: m.graph.initializer[0].dims.extend([-5])), "elements: as many as it holds"
    ),
    "model of many nodes": (
        graph(*(helper.make_node("Identity", [f"a{i}"], [f"a{i + 1}"]) for i in range(6000))), "operators=5001"
    ),
    "model of other ends": (
        graph(
            helper.make_node("ReduceSum", ["x", "axis"], ["sum"], keepdims=0),
            helper.make_node("Cast", ["sum"], ["confidence"], to=TensorProto.FLOAT),
            initializers=(constant([1], "axis"),),
        ),
        "onnxruntime refuses it",
    ),
    "model of giant memory": (
        graph(
            helper.make_node("Expand", ["zero", "size"], ["big"]),
            helper.make_node("Cast", ["big"], ["confidence"], to=TensorProto.DOUBLE),
            initializers=(constant(np.zeros(1, np.float32), "zero"), constant([2**33], "size")),
        ),
        "cannot be computed",
    ),
    "model that answers beyond 1": (
        graph(
            helper.make_node("ReduceMax", ["x", "axis"], ["most"], keepdims=0),
            helper.make_node("Cast", ["most"], ["confidence"], to=TensorProto.DOUBLE),
            initializers=(constant([1], "axis"),),
        ),
        "32 numbers from 0 to 1",
    ),
}  # fmt: skip


def test_there_are_many() -> None:
    assert len(MUTATIONS) > 130


@pytest.mark.parametrize("mutation", MUTATIONS)
def test_it_is_refused_in_one_line(mutation: str, packed: Path, tmp_path: Path) -> None:
    mutate, said = MUTATIONS[mutation]
    folder = copytree(packed, tmp_path / "bundle")
    mutate(folder)
    began = time.process_time()
    with pytest.raises(BadValue) as refusal:
        deploy.load(folder)
    assert said in str(refusal.value) and str(folder) in str(refusal.value)
    assert "\n" not in str(refusal.value) and len(str(refusal.value)) < 1000
    assert time.process_time() - began < 2.0


def test_a_model_that_never_ends_is_stopped(packed: Path, tmp_path: Path) -> None:
    """Four thousand products of large matrices would take an hour."""
    folder = copytree(packed, tmp_path / "bundle")
    nodes = [helper.make_node("Expand", ["one", "size"], ["a0"])]
    nodes += [helper.make_node("MatMul", [f"a{i}", "a0"], [f"a{i + 1}"]) for i in range(4000)]
    nodes += [helper.make_node("ReduceMax", ["a4000", "axes"], ["most"], keepdims=0)]
    nodes += [helper.make_node("Cast", ["most"], ["confidence"], to=TensorProto.DOUBLE)]
    tensors = constant(np.ones((1, 1), np.float32), "one"), constant([1500, 1500], "size"), constant([1], "axes")
    graph(*nodes, initializers=tensors)(folder)
    began = time.monotonic()
    with pytest.raises(BadValue, match="cannot be computed"):
        deploy.load(folder)
    assert time.monotonic() - began < 3 * deploy.PATIENCE


def test_what_only_looks_different_is_the_same(packed: Path, tmp_path: Path) -> None:
    """Sealed again without a change, with a file beside that nobody asked for: the same answers."""
    folder = copytree(packed, tmp_path / "bundle")
    seal(folder)
    (folder / "model.onnx.data").write_bytes(b"not read")
    x = deploy.load(packed).bundle.golden[0]
    assert np.array_equal(deploy.load(folder)(x), deploy.load(packed)(x))
