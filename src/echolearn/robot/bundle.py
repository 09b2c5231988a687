"""A bundle: all that a robot needs of a trained classifier, in files of data, no code.

    bundle.json   what it is, what it expects and how it was evaluated (`schema.py`), and the
                  SHA-256 of itself and of the others; written last
    model.onnx    input "x", float32, (batch, *input_shape), raw units;
                  output "confidence", float64, (batch,)
    golden.npz    `x` and `confidence` of 32 inputs: whoever loads the model can tell whether it
                  computes the same
    probe.wav     the burst to be played, followed by silence up to the length of a recording
    reference.npz columns of simulated walks of the training kind (`reference`), if it has them

`read_bundle` believes nothing: sizes are limited before reading, names are known beforehand, a
localizer is one of echolearn's with plain arguments, and every value passes the checks that a
configuration passes. What is refused is refused in one line that names the file or the key.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any, NoReturn

import numpy as np

from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Array, MicArray, Probe
from echolearn.checks import BadValue, check, suggest
from echolearn.localization import methods
from echolearn.localization.columns import SEVERAL
from echolearn.localization.localizer import Localizer
from echolearn.robot import untrusted_files, untrusted_models
from echolearn.robot.bundle_inputs import NEWER, echo_inputs, wall_inputs
from echolearn.robot.reference import Reference, read_reference
from echolearn.robot.schema import GOLDEN, OF_WALLS, REFERENCE, limits_of, upgraded
from echolearn.storage import manifests
from echolearn.storage.advice import MEND
from echolearn.storage.files import json_bytes, one_line
from echolearn.storage.kinds import check_kind
from echolearn.survey.audio import burst_of, wav_samples


@dataclass(frozen=True)
class Bundle:
    """A bundle that has been read and checked; what its model computes is not proved yet.

    Attributes:
        about: content of `bundle.json`, as today's schema has it.
        inputs: columns the model looks at, in order, or its one tensor.
        shape: shape of one input.
        threshold: confidence from which an echo is kept.
        array: the microphones.
        probe: the burst.
        localizer: estimator of the echoes, with its window.
        model: the ONNX file.
        golden: inputs (32, *shape), float32, and their confidences (32,).
        reference: what it was trained on looks like; None: the bundle does not tell.
        hypotheses: most lines of a walk among which it finds walls; None: it judges echoes.
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
    reference: Reference | None = None
    hypotheses: int | None = None

    @property
    def is_tensor(self) -> bool:
        """Whether the model looks at a tensor rather than at columns."""
        return len(self.shape) > 1


def read_bundle(folder: Path) -> Bundle:
    """Read and check a bundle.

    Raises:
        BadValue: a file that is missing, damaged, too large or no plain file, or a value that is
            not allowed.
    """
    folder = Path(folder)
    place = folder / manifests.BUNDLE
    content = read_content(folder)
    try:
        about = upgraded(content)
    except BadValue as error:
        raise BadValue(f"{place} {error}") from None

    # Sizes and checksums come before any parser sees a byte.
    data = {}
    for name, limit in limits_of(about).items():
        data[name] = untrusted_files.read_bytes(folder / name, limit=limit)
        found = {"bytes": len(data[name]), "sha256": hashlib.sha256(data[name]).hexdigest()}
        whole = found == about["files"][name]
        allowed = "must have the size and SHA-256 in bundle.json"
        check(whole, str(folder / name), "damaged", allowed=allowed, hint=MEND)

    try:
        return _assembled(about, data, folder=folder)
    except BadValue as error:
        # What is wrong with a file is said of the file, the rest of a key of `bundle.json`.
        named = str(error).startswith(str(folder))
        raise error if named else BadValue(f"{place} {error}") from None


def read_content(folder: Path) -> dict[str, Any]:
    """Return what `bundle.json` says, proved against its own checksum and not yet checked.

    Raises:
        BadValue: no folder, or no such file in it that is whole.
    """
    place = folder / manifests.BUNDLE
    allowed = "must be a folder that echolearn export wrote"
    check_kind("bundle", folder, wanted="bundle", allowed=allowed)
    return _parse(untrusted_files.read_bytes(place, limit=1 << 20), str(place))


def _parse(text: bytes, name: str) -> dict[str, Any]:
    """Return the content of `bundle.json`, proved against its own checksum."""
    try:
        about = json.loads(text, parse_constant=_refuse)
        whole = isinstance(about, dict) and json_bytes(manifests.with_checksum(about)) == text
    except (ValueError, RecursionError, AttributeError) as error:
        raise BadValue(f"{name}: cannot be read as JSON ({one_line(error)}); {MEND}") from None
    allowed = "must be as echolearn export wrote it"
    check(whole, name, "damaged", allowed=allowed, hint=f"its SHA-256 differs; {MEND}")
    return dict(about)


def _refuse(constant: str) -> NoReturn:
    raise ValueError(f"{constant} is no number")


def _assembled(about: Mapping[str, Any], data: Mapping[str, bytes], *, folder: Path) -> Bundle:
    """Return the bundle that files of the right size and checksum describe."""
    # From here on every key has the type and range that `schema.TABLE` says; what is left is
    # whether they agree with each other and with the files.
    array = MicArray(np.array(about["array"], dtype=float))
    judging = about["schema"] == OF_WALLS
    inputs, shape = wall_inputs(about) if judging else echo_inputs(about, len(array))

    rate = float(about["sample_rate"])
    length = about["probe"]["length"]
    name = f"{folder}/probe.wav"
    padded = wav_samples(data["probe.wav"], rate, name=name)
    check(padded.shape == (1, length), name, padded.shape, allowed=f"must be (1, {length}) samples")
    burst = burst_of(padded, name=name)
    given = about["probe"]["burst"]
    allowed = f"must be {len(burst)}, as probe.wav has it"
    check(given == len(burst), "probe.burst", given, allowed=allowed)

    untrusted_models.check_onnx(data["model.onnx"], name=f"{folder}/model.onnx")
    expected = {"x": ("<f4", (GOLDEN, *shape)), "confidence": ("<f8", (GOLDEN,))}
    golden = untrusted_files.read_arrays(data["golden.npz"], expected, name=f"{folder}/golden.npz")
    localizer = localizer_of(**about["localizer"], window=SearchWindow(**about["window"]))
    single = localizer.echoes == 1
    reference = None
    if REFERENCE in data:
        told = about["reference"]
        reference = read_reference(data[REFERENCE], told, name=f"{folder}/{REFERENCE}")
    seen = {*inputs, *(reference.columns if reference else ())}
    alone = [name for name in SEVERAL if name in seen and single]
    allowed = "must be columns that a single echo has"
    check(not alone, "columns", alone, allowed=allowed, hint="localizer.echoes is 1")
    return Bundle(
        about=about,
        inputs=inputs,
        shape=shape,
        threshold=float(about["threshold"]["value"]),
        array=array,
        probe=Probe(burst, rate, length),
        localizer=localizer,
        model=data["model.onnx"],
        golden=(golden["x"], golden["confidence"]),
        reference=reference,
        hypotheses=about["hypotheses"]["count"] if judging else None,
    )


def localizer_names() -> list[str]:
    """Return the short names of echolearn's localizers: those of their modules."""
    return sorted(module.name for module in iter_modules(methods.__path__))


def localizer_of(*, name: str, arguments: Mapping[str, Any], window: SearchWindow) -> Localizer:
    """Return the localizer of a short name.

    Args:
        name: its short name, as in `gated`.
        arguments: values of its other fields; it has defaults for all.
        window: where it seeks echoes.

    Raises:
        BadValue: no localizer of that name, or not with these arguments.
    """
    known = localizer_names()
    check(
        name in known,
        "localizer.name",
        name,
        allowed=f"must be one of {', '.join(known)}",
        hint=suggest(name, known) if get_close_matches(name, known, n=1) else NEWER,
    )
    module = import_module(f"{methods.__name__}.{name}")
    classes = {key.lower(): value for key, value in vars(module).items() if isinstance(value, type)}
    # A localizer checks the range of its arguments itself.
    names = {field.name for field in fields(classes[name]) if field.init} - {"window"}
    odd = sorted(set(arguments) - names)
    allowed = f"must be some of {', '.join(sorted(names))}"
    check(not odd, "localizer.arguments", ", ".join(odd), allowed=allowed, hint=NEWER)
    made: Localizer = classes[name](window=window, **arguments)
    return made
