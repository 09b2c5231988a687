"""A bundle: all that a robot needs of a trained classifier, as a folder of four files that are
data, never code.

    bundle.json   what it is, what it expects and how it was judged; SHA-256 of itself and of the others; written last
    model.onnx    input "x", float32, (batch, *input_shape), raw units; output "confidence", float64, (batch,)
    golden.npz    `x` and `confidence` of 32 inputs: whoever loads the model can tell whether it computes the same
    probe.wav     the burst to be played, followed by silence up to the length of a recording

`read` believes nothing: sizes are limited before reading, names are known beforehand, a localizer
is one of echolearn's with plain arguments, and every value passes the checks that a configuration
passes. What is refused is refused in one line that names the file or the key.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from importlib import import_module
from math import prod
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

import numpy as np

import echolearn.localization.methods
from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, MicArray, Probe
from echolearn.checks import BadValue, check, check_list, check_number, check_whole
from echolearn.localization import features
from echolearn.localization.localizer import Localizer
from echolearn.robot import untrusted_files
from echolearn.robot.schema import check_text, check_told, part
from echolearn.storage import manifests
from echolearn.storage.files import MEND, json_bytes, one_line

SCHEMA = 2
"""Version of the format; a reader refuses others. In the first, `parity` was a number."""

GOLDEN = 32
"""Inputs whose confidences travel with the model."""

LIMITS = {"model.onnx": 64 << 20, "golden.npz": 16 << 20, "probe.wav": 16 << 20}
"""The files besides `bundle.json`, each with the bytes it may have."""

KEYS = """
    array bands calibration classifier columns data files golden input_shape kind label localizer metrics name parity
    probe run sample_rate schema seed sha256 speed_of_sound threshold trained_on versions view window
""".split()
"""Keys of `bundle.json`; `command` may be there, too."""

REFLECTOR = "a wall's echo arrives within 10 samples of toa"
LABELS = {"reflector": REFLECTOR, "on_map": "the map point lies within 0.10 m of a wall"}
"""What a confidence of 1 says."""


@dataclass(frozen=True)
class Bundle:
    """A bundle that has been read and checked; what its model computes is not proved yet.

    Attributes:
        about: the content of `bundle.json`.
        inputs: columns the model looks at, in order, or its one tensor.
        shape: of one input.
        threshold: confidence from which an echo is kept.
        array: the microphones.
        probe: the burst.
        localizer: finds the echoes, in its window.
        model: the ONNX file.
        golden: inputs (32, *shape), float32, and their confidences (32,).
    """

    about: Mapping[str, Any]
    inputs: tuple[str, ...]
    shape: tuple[int, ...]
    threshold: float
    array: MicArray
    probe: Probe
    localizer: Localizer
    model: bytes
    golden: tuple[Array, Array]

    @property
    def is_tensor(self) -> bool:
        """Whether the model looks at a tensor rather than at columns."""
        return len(self.shape) > 1


def read(folder: Path) -> Bundle:
    """Read and check a bundle.

    Raises:
        BadValue: a file that is missing, damaged, too large or no plain file, or a value that is
            not allowed.
    """
    folder = Path(folder)
    place = folder / manifests.BUNDLE
    allowed = "a folder that echolearn export wrote"
    manifests.check_folder("bundle", folder, allowed=allowed)
    swapped = (folder / "survey.yaml").is_file() and not place.exists()
    hint = "this is a survey; did you swap survey and bundle?"
    check(not swapped, "bundle", folder, allowed=allowed, hint=hint)
    about = _parse(untrusted_files.read(place, limit=1 << 20), str(place))
    files = {
        name: _proved(folder / name, about["files"][name], limit=limit)
        for name, limit in LIMITS.items()
    }
    try:
        return _assemble(about, files, folder)
    except BadValue as error:
        named = str(error).startswith(str(folder))
        raise error if named else BadValue(f"{place}: {error}") from None


def _parse(text: bytes, name: str) -> dict[str, Any]:
    """Return the content of `bundle.json`, proved against its own checksum, its keys and names of
    files checked.
    """
    try:
        about = json.loads(text, parse_constant=_refuse)
        whole = isinstance(about, dict) and json_bytes(manifests.with_checksum(about)) == text
    except (ValueError, RecursionError, AttributeError) as error:
        raise BadValue(f"{name}: cannot be read as JSON ({one_line(error)}); {MEND}") from None
    check(
        whole,
        name,
        "damaged",
        allowed="as echolearn export wrote it",
        hint=f"its SHA-256 differs; {MEND}",
    )
    check(about.get("kind") == "bundle", f"{name} kind", about.get("kind"), allowed="bundle")
    hint = f"this echolearn reads schema {SCHEMA}; update it or export again"
    schema = about.get("schema")
    check(
        type(schema) is int and schema == SCHEMA,
        f"{name} schema",
        schema,
        allowed=f"{SCHEMA}",
        hint=hint,
    )
    missing = sorted(set(KEYS) - about.keys())
    foreign = sorted(about.keys() - set(KEYS) - {"command"})
    check(not missing, name, f"without {', '.join(missing)}", allowed="all keys of its schema")
    check(
        not foreign, name, f"with {', '.join(foreign)}", allowed="no keys but those of its schema"
    )
    named = sorted(about["files"]) if isinstance(about["files"], dict) else about["files"]
    check(
        named == sorted(LIMITS),
        f"{name} files",
        named,
        allowed=f"{', '.join(LIMITS)}, no other paths",
    )
    return about


def _refuse(constant: str) -> None:
    raise ValueError(f"{constant} is no number")


def _proved(path: Path, entry: Any, *, limit: int) -> bytes:
    """Return the bytes of a file, if they have the size and SHA-256 that its entry says."""
    data = untrusted_files.read(path, limit=limit)
    found = {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    check(
        found == entry,
        str(path),
        "damaged",
        allowed="the size and SHA-256 in bundle.json",
        hint=MEND,
    )
    return data


def _assemble(about: Mapping[str, Any], files: Mapping[str, bytes], folder: Path) -> Bundle:
    """Return the bundle that checked files describe."""
    array = MicArray(np.array(_numbers(about["array"], "array"), dtype=float))
    inputs, shape = _inputs(about, len(array))
    check_told(about)
    threshold, label = part(about, "threshold", "value chosen"), part(about, "label", "name true")
    check_number("threshold.value", threshold["value"], low=0.0, high=1.0)
    check_text("threshold.chosen", threshold["chosen"])
    check(str(label["name"]) in LABELS, "label.name", label["name"], allowed=" or ".join(LABELS))
    check(
        label["true"] == LABELS[label["name"]],
        "label.true",
        label["true"],
        allowed=LABELS[label["name"]],
    )
    check(about["golden"] == GOLDEN, "golden", about["golden"], allowed=f"{GOLDEN}")
    check_number("speed_of_sound", about["speed_of_sound"], low=100.0, high=2000.0, unit="m/s")
    window = SearchWindow(**part(about, "window", "nearest farthest rule"))
    golden = untrusted_files.read_arrays(
        files["golden.npz"],
        {"x": ("<f4", (GOLDEN, *shape)), "confidence": ("<f8", (GOLDEN,))},
        name=str(folder / "golden.npz"),
    )
    untrusted_files.check_onnx(files["model.onnx"], name=str(folder / "model.onnx"))
    return Bundle(
        about=about,
        inputs=inputs,
        shape=shape,
        threshold=float(threshold["value"]),
        array=array,
        probe=_probe(about, files["probe.wav"], folder),
        localizer=localizer_of(part(about, "localizer", "name arguments"), window),
        model=files["model.onnx"],
        golden=(golden["x"], golden["confidence"]),
    )


def _numbers(value: Any, name: str) -> Any:
    """Return a list of triples of numbers; the microphones."""
    check_list(name, value, allowed="M x 3 numbers in m")
    check(1 <= len(value) <= 256, name, f"{len(value)} microphones", allowed="1 to 256")
    for triple in value:
        check_list(name, triple, length=3, allowed="M x 3 numbers in m")
        for number in triple:
            check_number(name, number, low=-10.0, high=10.0, unit="m")
    return value


def _inputs(about: Mapping[str, Any], microphones: int) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """Return the names of what the model looks at, and the shape of one input."""
    columns, shape, view = about["columns"], about["input_shape"], about["view"]
    check_list("columns", columns)
    listed = all(isinstance(column, dict) and set(column) == {"name", "unit"} for column in columns)
    check(listed and len(columns) > 0, "columns", columns, allowed="a list of name and unit")
    names = tuple(column["name"] for column in columns)
    tensor = view == "covariance"
    known = features.TENSORS if tensor else features.COLUMNS
    check(view in ("features", "covariance"), "view", view, allowed="features or covariance")
    wrong = [name for name in names if name not in known]
    check(
        not wrong,
        "columns",
        wrong,
        allowed=f"some of {', '.join(known)}",
        hint="was it made by a newer echolearn?",
    )
    units = [column["unit"] for column in columns]
    meant = [features.UNITS.get(name, "1") for name in names]
    check(units == meant, "columns", units, allowed=f"the units {meant}")
    wanted = [about["bands"], microphones**2] if tensor else [len(names)]
    check(about["bands"] == features.COVARIANCE_BANDS, "bands", about["bands"], allowed=f"{features.COVARIANCE_BANDS}")
    check(
        len(set(names)) == len(names) and (len(names) == 1 or not tensor),
        "columns",
        list(names),
        allowed="each once",
    )
    check(shape == wanted and prod(wanted) <= 10**5, "input_shape", shape, allowed=f"{wanted}")
    return names, tuple(wanted)


def _probe(about: Mapping[str, Any], data: bytes, folder: Path) -> Probe:
    rate, probe = about["sample_rate"], part(about, "probe", "file burst length")
    check_number("sample_rate", rate, low=1000.0, high=400_000.0, unit="Hz")
    check_whole("probe.length", probe["length"], low=16, high=4 << 20, unit="samples")
    burst = untrusted_files.read_burst(
        data, sample_rate=rate, length=probe["length"], name=str(folder / "probe.wav")
    )
    check(probe["file"] == "probe.wav", "probe.file", probe["file"], allowed="probe.wav")
    check(
        len(burst) == probe["burst"],
        "probe.burst",
        probe["burst"],
        allowed=f"{len(burst)}, as probe.wav has it",
    )
    return Probe(burst, float(rate), probe["length"])


def localizer_names() -> list[str]:
    """Return the short names of echolearn's localizers: those of their modules."""
    return sorted(module.name for module in iter_modules(echolearn.localization.methods.__path__))


def localizer_of(about: Mapping[str, Any], window: SearchWindow) -> Localizer:
    """Return the localizer that a bundle names by its short name, with plain arguments.

    Bundles of version 0.1 name it `module.Class`, as in gated.Gated; its first part is the short
    name.
    """
    name, known = str(about["name"]).partition(".")[0], localizer_names()
    hint = "was it made by a newer echolearn?"
    check(name in known, "localizer.name", about["name"], allowed=", ".join(known), hint=hint)
    module = import_module(f"{echolearn.localization.methods.__name__}.{name}")
    [found] = [
        value
        for value in vars(module).values()
        if _is_localizer(value) and value.__name__.lower() == name
    ]
    names = {field.name for field in fields(found) if field.init} - {"window"}
    arguments = about["arguments"]
    plain = isinstance(arguments, dict) and all(is_plain(value) for value in arguments.values())
    check(
        plain and set(arguments) <= names,
        "localizer.arguments",
        arguments,
        allowed=f"{', '.join(sorted(names))}",
    )
    made: Localizer = found(window=window, **arguments)
    return made


def _is_localizer(found: object) -> bool:
    """Tell whether something is a class of values with a window that can be called."""
    made_of = (
        {field.name for field in fields(found)}
        if isinstance(found, type) and is_dataclass(found)
        else set()
    )
    return "window" in made_of and "__call__" in vars(found)


def is_plain(value: Any) -> bool:
    """Tell whether a value is a number, a text, a truth value or nothing: what an argument may be."""
    return (
        value is None
        or isinstance(value, bool | int | float)
        or (isinstance(value, str) and len(value) < 200)
    )
