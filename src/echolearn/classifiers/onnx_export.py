"""A fitted classifier as one ONNX file: raw inputs in, confidence out, nothing to unpickle.

    x (B, ...) float32 -> scorer -> d -> sigmoid(a d + b) -> confidence (B,) float64

torch.export captures the scorer with a free batch axis, `onnx_graph` writes it down; a scorer that
holds an operator unknown there goes through torch's general exporter, twenty times slower, and is
stripped of what torch notes about the source code it came from. Either way equal classifiers give
equal bytes wherever they were trained.
"""

import logging
import os
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

os.environ.setdefault(
    "ORT_DISABLE_TELEMETRY", "1"
)  # which onnxruntime would keep in the home folder

import onnxruntime
import torch

from echolearn.acoustics.types import PARITY, Array
from echolearn.classifiers.calibration import Calibrated
from echolearn.classifiers.inputs import Inputs, blocks
from echolearn.classifiers.onnx_graph import Unknown, translate

TRIALS = 10_000
"""Inputs on which the two are compared, at least."""

STRANGE = 4_000
"""Of these, at least so many that no recording would give."""

BLOCK = 1024
"""Rows scored at once."""

LIMITS = np.finfo(np.float32)
ODD = np.array(
    [0.0, 1.0, 1e30, LIMITS.max, LIMITS.tiny, LIMITS.smallest_subnormal], dtype=np.float32
)
"""Numbers at the ends of what float32 can hold; either sign is tried."""


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
        return torch.sigmoid(
            decision.double() * self.get_buffer("slope") + self.get_buffer("intercept")
        )


class Proved(NamedTuple):
    """A file that computes what its classifier computes: its bytes, the largest difference, the
    inputs compared.
    """

    data: bytes
    parity: float
    trials: int


def export(fitted: Calibrated, x: Inputs) -> Proved:
    """Return a classifier as an ONNX file, after proving that onnxruntime computes its confidences.

    Args:
        fitted: what to export.
        x: inputs to compare on, shape (B, ...); others are added, up to `TRIALS` and extreme ones
            among them.

    Raises:
        RuntimeError: the difference exceeds `PARITY`.
    """
    data = to_onnx(
        Confidence(fitted.classifier.scorer(), fitted.slope, fitted.intercept), shape=x.shape[1:]
    )
    score, names = open_onnx(data), fitted.classifier.inputs
    parity, count = 0.0, 0
    for block in chain(blocks(x, names, size=BLOCK), strange(x, max(STRANGE, TRIALS - len(x)))):
        parity, count = (
            float(np.maximum(parity, difference(score, fitted, block))),
            count + len(block),
        )
    if not parity <= PARITY:
        raise RuntimeError(
            f"onnx: exported confidences differ by {parity:g} from the classifier's, more than {PARITY:g}"
        )
    return Proved(data, parity, count)


def difference(score: Callable[[Array], Array], fitted: Calibrated, x: Array) -> float:
    """Return the largest difference between two confidences on `x` (B, ...), NaN if either is."""
    return float(np.abs(score(x) - fitted.confidence(x)).max(initial=0.0))


def strange(x: Inputs, count: int) -> Iterator[Array]:
    """Yield blocks of `count` inputs in all that are not rows of `x`: the ends of float32 first,
    then mixtures.

    Of those, a third are rows scaled by many orders and turned, a third rows with some entries of
    `ODD`, a third lie between two rows.
    """
    rng = np.random.default_rng(0)
    ends = np.concatenate([ODD, -ODD]).reshape(-1, *(1,) * (len(x.shape) - 1)) * np.ones(
        x.shape[1:], np.float32
    )
    yield ends[:count]
    for start in range(len(ends), count, BLOCK):
        yield mixtures(x, min(BLOCK, count - start), rng)


def mixtures(x: Inputs, count: int, rng: np.random.Generator) -> Array:
    """Return `count` inputs, float32: rows of `x` far away, spoilt, and mixed, in turns."""
    rows, others = x[rng.integers(len(x), size=count)], x[rng.integers(len(x), size=count)]
    scale = rng.choice([-1.0, 1.0], rows.shape) * 10.0 ** rng.uniform(-6, 6, rows.shape)
    odd = rng.choice(ODD, rows.shape) * rng.choice([-1.0, 1.0], rows.shape)
    spoilt = np.where(rng.random(rows.shape) < 1 / 3, odd, rows)
    share = rng.random((count, *(1,) * (rows.ndim - 1)))
    kinds = rows * scale, spoilt, share * rows + (1 - share) * others
    which = np.arange(count).reshape(share.shape) % len(kinds)
    return np.select([which == number for number in range(len(kinds))], kinds).astype(np.float32)


def to_onnx(module: torch.nn.Module, *, shape: tuple[int, ...]) -> bytes:
    """Return the ONNX file of a module from float32 (B, *shape), input "x", to (B,), output
    "confidence".
    """
    with quiet_export():
        batch = {0: torch.export.Dim("batch")}
        program = torch.export.export(
            module.eval(), (torch.zeros((3, *shape)),), dynamic_shapes=(batch,)
        )
        try:
            model = translate(program)
        except Unknown:
            model = translate_any(program)
    return bytes(model.SerializeToString(deterministic=True))


def translate_any(program: torch.export.ExportedProgram) -> Any:
    """Return the ONNX model of any program that torch can export."""
    exported = torch.onnx.export(
        program,
        input_names=["x"],
        output_names=["confidence"],
        dynamo=True,
        external_data=False,
        verbose=False,
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
    """Return the function that an ONNX file computes, on one thread: float32 (B, ...) to
    confidences (B,).
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.log_severity_level = 3
    session = onnxruntime.InferenceSession(data, options, providers=["CPUExecutionProvider"])

    def confidence(x: Array) -> Array:
        x = np.ascontiguousarray(x, dtype=np.float32)
        blocks = [session.run(None, {"x": x[i : i + BLOCK]})[0] for i in range(0, len(x), BLOCK)]
        return np.concatenate([np.empty(0), *blocks])

    return confidence
