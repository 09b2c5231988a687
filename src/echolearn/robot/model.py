"""The model of a bundle at work: onnxruntime, on one core, in limited memory, proved before use.

    read_bundle --open--> compute: inputs (B, *shape) -> confidences (B,), golden ones among them

It has an arena of `MEMORY` bytes, and folds no constants while it opens a model, which could make
one of any size.
"""

import os
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np

# Before it is imported: onnxruntime would keep files about its use in the home folder.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

import onnxruntime

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check
from echolearn.robot.bundle import Bundle, read_bundle
from echolearn.storage.files import one_line

Compute = Callable[[Array], Array]

TOLERANCE = 1e-5
"""Largest difference in confidence between two machines."""

MEMORY = 256 << 20
"""Bytes that a model may use while it computes."""


def replay(folder: Path) -> tuple[Bundle, Compute]:
    """Return a bundle and what its model computes, which includes its golden confidences.

    Raises:
        BadValue: as `read_bundle`, or onnxruntime refuses the model, or it answers otherwise.
    """
    bundle = read_bundle(folder)
    name = f"{folder}/model.onnx"
    compute = _open(bundle, name)
    x, expected = bundle.golden
    difference = np.abs(compute(x) - expected)
    shown = f"golden confidences differ by {difference.max():.2g}"
    hint = "this machine computes something else than the one that made the bundle"
    same = bool((difference <= TOLERANCE).all())
    check(same, name, shown, allowed=f"must be at most {TOLERANCE:g}", hint=hint)
    return bundle, compute


def _open(bundle: Bundle, name: str) -> Compute:
    """Return the function that a bundle's model computes; `name` is that of its file in errors."""
    _limit_memory()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    # Its complaints come as exceptions, which are told in one line.
    options.log_severity_level = 4
    options.add_session_config_entry("session.use_env_allocators", "1")
    options.add_session_config_entry("session.load_model_format", "ONNX")
    try:
        session = onnxruntime.InferenceSession(
            bundle.model,
            options,
            providers=["CPUExecutionProvider"],
            # Folding would compute a giant constant while the model is being opened.
            disabled_optimizers=["ConstantFolding"],
        )
        ends = [*session.get_inputs(), *session.get_outputs()]
    except Exception as error:  # onnxruntime's own kinds have no common ancestor
        raise BadValue(f"{name}: onnxruntime refuses it ({one_line(error):.200})") from None
    found = [(end.name, end.type, len(end.shape)) for end in ends]
    wanted = [("x", "tensor(float)", 1 + len(bundle.shape)), ("confidence", "tensor(double)", 1)]
    check(found == wanted, f"{name} inputs and outputs", found, allowed=f"must be {wanted}")

    def compute(x: Array) -> Array:
        """Return the confidences (B,) of float32 inputs (B, ...)."""
        try:
            confidence = np.asarray(session.run(["confidence"], {"x": x})[0])
        except Exception as error:
            raise BadValue(f"{name}: cannot be computed ({one_line(error):.200})") from None
        inside = bool(((confidence >= 0) & (confidence <= 1)).all())
        shown = f"shape {confidence.shape}, from 0 to 1: {inside}"
        allowed = f"must be {len(x)} numbers from 0 to 1"
        check(
            inside and confidence.shape == (len(x),), f"{name} confidence", shown, allowed=allowed
        )
        return confidence

    return compute


@cache
def _limit_memory() -> None:
    """Let all sessions of this process that ask for it share one arena of `MEMORY` bytes."""
    kind = onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR
    place = onnxruntime.OrtMemoryInfo("Cpu", kind, 0, onnxruntime.OrtMemType.DEFAULT)
    arena = onnxruntime.OrtArenaCfg({"max_mem": MEMORY, "arena_extend_strategy": 1})
    with suppress(Exception):  # there is one already: the host program's
        onnxruntime.create_and_register_allocator(place, arena)
