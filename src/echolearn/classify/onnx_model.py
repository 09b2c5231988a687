"""A fitted classifier as one ONNX file: raw inputs in, confidence out, nothing to unpickle.

    x (B, ...) float32 -> scorer -> d -> sigmoid(a d + b) -> confidence (B,) float64

torch.export captures the scorer with a free batch axis, `onnx_graph` writes it down; a scorer that holds an operator
unknown there goes through torch's general exporter, twenty times slower, and is stripped of what torch notes about the
source code it came from. Either way equal classifiers give equal bytes wherever they were trained.
"""

import logging
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import onnxruntime
import torch

from echolearn.classify.calibration import Calibrated
from echolearn.classify.inputs import Inputs, blocks
from echolearn.classify.onnx_graph import Unknown, translate
from echolearn.types import Array

PARITY = 1e-5
"""Largest difference in confidence between a classifier and its file."""

BLOCK = 1024
"""Rows scored at once."""


class Confidence(torch.nn.Module):
    """A scorer with its calibration."""

    def __init__(self, scorer: torch.nn.Module, slope: float, intercept: float) -> None:
        super().__init__()
        self.scorer = scorer
        self.register_buffer("slope", torch.tensor(slope, dtype=torch.float64))
        self.register_buffer("intercept", torch.tensor(intercept, dtype=torch.float64))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, ...) to confidences (B,)."""
        decision: torch.Tensor = self.scorer(x)
        return torch.sigmoid(decision.double() * self.get_buffer("slope") + self.get_buffer("intercept"))


def export(fitted: Calibrated, x: Inputs) -> tuple[bytes, float]:
    """Return a classifier as an ONNX file, after proving that onnxruntime computes its confidences.

    Args:
        fitted: what to export.
        x: inputs to compare on, shape (B, ...); extreme ones are added.

    Returns:
        The file's bytes and the largest difference in confidence.

    Raises:
        RuntimeError: the difference exceeds 1e-5.
    """
    data = to_onnx(Confidence(fitted.classifier.scorer(), fitted.slope, fitted.intercept), shape=x.shape[1:])
    score, names = open_onnx(data), fitted.classifier.inputs
    parity = max(difference(score, fitted, block) for block in (*blocks(x, names, size=BLOCK), extremes(x)))
    if not parity <= PARITY:
        raise RuntimeError(
            f"onnx: exported confidences differ by {parity:g} from the classifier's, more than {PARITY:g}"
        )
    return data, parity


def difference(score: Callable[[Array], Array], fitted: Calibrated, x: Array) -> float:
    """Return the largest difference between two confidences on `x` (B, ...), NaN if either is."""
    return float(np.abs(score(x) - fitted.confidence(x)).max(initial=0.0))


def extremes(x: Inputs) -> Array:
    """Return what no recording would give: rows of `x` scaled and turned by many orders, zeros, the largest floats."""
    rng = np.random.default_rng(0)
    some = x[rng.integers(len(x), size=64)]
    scale = rng.choice([-1.0, 1.0], some.shape) * 10.0 ** rng.uniform(-6, 6, some.shape)
    largest = np.full(x[:1].shape, np.finfo(np.float32).max)
    return np.concatenate([some * scale, 0 * largest, largest, -largest]).astype(np.float32)


def to_onnx(module: torch.nn.Module, *, shape: tuple[int, ...]) -> bytes:
    """Return the ONNX file of a module from float32 (B, *shape), input "x", to (B,), output "confidence"."""
    with quiet_export():
        batch = {0: torch.export.Dim("batch")}
        program = torch.export.export(module.eval(), (torch.zeros((3, *shape)),), dynamic_shapes=(batch,))
        try:
            model = translate(program)
        except Unknown:
            model = translate_any(program)
    return bytes(model.SerializeToString(deterministic=True))


def translate_any(program: torch.export.ExportedProgram) -> Any:
    """Return the ONNX model of any program that torch can export."""
    exported = torch.onnx.export(
        program, input_names=["x"], output_names=["confidence"], dynamo=True, external_data=False, verbose=False
    )
    if exported is None:
        raise RuntimeError("onnx: torch returned no program")
    model = exported.model_proto
    strip(model)
    return model


@contextmanager
def quiet_export() -> Iterator[None]:
    """Silence the exporter's remarks within the block."""
    logger = logging.getLogger("torch.onnx")
    level = logger.level
    logger.setLevel(logging.ERROR)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            yield
        finally:
            logger.setLevel(level)


def strip(model: Any) -> None:
    """Remove names of source files and variables from an ONNX model, in place."""
    graph = model.graph
    items = [model, graph]
    for part in (graph.node, graph.value_info, graph.input, graph.output, graph.initializer):
        items += part
    for item in items:
        del item.metadata_props[:]
        item.doc_string = ""


def open_onnx(data: bytes) -> Callable[[Array], Array]:
    """Return the function that an ONNX file computes, on one thread: float32 (B, ...) to confidences (B,)."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])

    def confidence(x: Array) -> Array:
        x = np.ascontiguousarray(x, dtype=np.float32)
        blocks = [session.run(None, {"x": x[i : i + BLOCK]})[0] for i in range(0, len(x), BLOCK)]
        return np.concatenate([np.empty(0), *blocks])

    return confidence
