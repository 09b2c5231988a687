"""A fitted classifier as one ONNX file: raw inputs in, confidence out, nothing to unpickle.

    x (B, ...) float32 -> scorer -> d -> calibration -> confidence (B,) float64

torch traces the scorer and writes down its operators (`torch.onnx.export` with `dynamo=False`; the
newer exporter parses its library of 500 operators anew at every call, which takes longer than
fitting most classifiers). Operator set 13 has all that scorers need, so that runtimes of 2021 read
the files. Equal classifiers give equal bytes wherever they were trained.

The file is proved before anybody trusts it: on `TRIALS` inputs or more, ordinary and extreme,
onnxruntime must compute the confidences of the trained object.
"""

import re
from collections.abc import Iterator, Sequence
from io import BytesIO
from itertools import chain
from typing import NamedTuple

import numpy as np
import onnx
import torch

from echolearn.acoustics.types import PARITY, Array
from echolearn.checks import BadValue
from echolearn.classifiers.calibration import Calibrated, Sigmoid
from echolearn.classifiers.constants import Formula
from echolearn.classifiers.inference import BLOCK, POSES, open_onnx
from echolearn.classifiers.inputs import Inputs, block_rows, blocks_of, is_tensor, view_of
from echolearn.classifiers.remarks import without_remarks
from echolearn.localization.columns import STRIPS

OPSET = 13
"""ONNX operator set; the lowest in which sums take their axes as torch gives them."""

TRIALS = 10_000
"""Inputs on which the two are compared, at least."""

STRANGE = 4_000
"""Of these, at least so many that no recording would give."""

LIMITS = np.finfo(np.float32)
ODD = np.array(
    [0.0, 1.0, 1e30, LIMITS.max, LIMITS.tiny, LIMITS.smallest_subnormal], dtype=np.float32
)
"""Numbers at the ends of what float32 can hold; either sign is tried."""


class Confidence(torch.nn.Module):
    """A scorer with its calibration."""

    def __init__(self, fitted: Calibrated) -> None:
        super().__init__()
        self.scorer = fitted.classifier.scorer()
        mapping = fitted.mapping
        if isinstance(mapping, Sigmoid):
            formula = Formula(sigmoid, slope=mapping.slope, intercept=mapping.intercept)
        else:
            knots, rises = np.array(mapping.decision), np.diff(mapping.confidence)
            widths = np.diff(knots)
            lowest = mapping.confidence[0]
            formula = Formula(
                export_steps, left=knots[:-1], width=widths, rise=rises, lowest=lowest
            )
        self.mapping = formula

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, ...) to confidences (B,)."""
        confidence: torch.Tensor = self.mapping(self.scorer(x).double())
        return confidence


def sigmoid(
    decision: torch.Tensor, *, slope: torch.Tensor, intercept: torch.Tensor
) -> torch.Tensor:
    """Return the logistic of slope d + intercept, shape (B,).

    Args:
        decision: shape (B,).
        slope, intercept: numbers.
    """
    return torch.sigmoid(decision * slope + intercept)


def export_steps(
    decision: torch.Tensor,
    *,
    left: torch.Tensor,
    width: torch.Tensor,
    rise: torch.Tensor,
    lowest: torch.Tensor,
) -> torch.Tensor:
    """Return straight lines between knots: each adds the part of its rise that lies behind d.

    Args:
        decision: shape (B,).
        left, width, rise: left end, width and rise of each line, shape (K - 1,).
        lowest: confidence at the first knot.
    """
    part = ((decision[:, None] - left) / width).clamp(0.0, 1.0)
    return lowest + (part * rise).sum(dim=1)


class ProvedModel(NamedTuple):
    """A file that computes what its classifier does: bytes, largest difference, inputs tried."""

    data: bytes
    parity: float
    trials: int


def export_proved(fitted: Calibrated, x: Inputs) -> ProvedModel:
    """Return a classifier as an ONNX file, after proving that onnxruntime computes its confidences.

    Args:
        fitted: what to export.
        x: inputs to compare on, shape (B, ...); others are added, up to `TRIALS` and extreme ones
            among them.

    Raises:
        RuntimeError: the difference exceeds `PARITY`.
    """
    data = _whole(fitted, x.shape[1:])
    score = open_onnx(data)

    # Rows of the set come first, then what no recording gives: robots meet both.
    ordinary = blocks_of(x, fitted.classifier.inputs, size=BLOCK)
    parity = 0.0
    trials = 0
    for block in chain(ordinary, strange(x, max(STRANGE, TRIALS - len(x)))):
        difference = np.abs(score(block) - fitted.confidence(block)).max(initial=0.0)
        # Unlike Python's, this maximum is NaN if either is.
        parity = float(np.maximum(parity, difference))
        trials += len(block)
    if not parity <= PARITY:
        raise RuntimeError(
            f"onnx: exported confidences differ by {parity:g} from the classifier's, "
            f"more than {PARITY:g}"
        )
    return ProvedModel(data, parity, trials)


def _whole(fitted: Calibrated, shape: tuple[int, ...]) -> bytes:
    """Return the file of a classifier whose inputs have a shape, that it looks behind included."""
    earlier = getattr(fitted.classifier, "earlier", None)
    seen = getattr(fitted.classifier, "seen", None)
    if earlier is None or seen is None:
        return to_onnx(Confidence(fitted), shape=shape, inputs=fitted.classifier.inputs)
    from echolearn.classifiers.onnx_behind import behind

    columns = None if is_tensor(earlier.inputs) else len(earlier.inputs)
    plane = to_onnx(Confidence(fitted), shape=(seen,))
    return behind(earlier, plane, columns=columns, shape=shape)


def strange(x: Inputs, count: int) -> Iterator[Array]:
    """Yield blocks of `count` inputs in all that are not rows of `x`.

    The ends of float32 come first. Of the others, a third are rows scaled by many orders and
    turned, a third rows with some entries of `ODD`, a third lie between two rows.
    """
    rng = np.random.default_rng(0)
    ends = np.concatenate([ODD, -ODD]).reshape(-1, *(1,) * (len(x.shape) - 1))
    yield (ends * np.ones(x.shape[1:], np.float32))[:count]
    size = block_rows(x.shape[1:], BLOCK)
    for start in range(len(ends), count, size):
        yield mixtures(x, min(size, count - start), rng=rng)


def mixtures(x: Inputs, count: int, *, rng: np.random.Generator) -> Array:
    """Return inputs (count, ...), float32: rows of `x` far away, spoilt, and mixed, in turns.

    Args:
        x: shape (B, ...).
        count: number wanted.
        rng: source of chance.
    """
    rows = x[rng.integers(len(x), size=count)]
    others = x[rng.integers(len(x), size=count)]
    scale = rng.choice([-1.0, 1.0], rows.shape) * 10.0 ** rng.uniform(-6, 6, rows.shape)
    odd = rng.choice(ODD, rows.shape) * rng.choice([-1.0, 1.0], rows.shape)
    spoilt = np.where(rng.random(rows.shape) < 1 / 3, odd, rows)
    # Between two rows the function is smooth or has a cut that both sides must place equally.
    share = rng.random((count, *(1,) * (rows.ndim - 1)))
    mixed = share * rows + (1 - share) * others
    turn = np.arange(count).reshape(share.shape) % 3
    found = np.where(turn == 0, rows * scale, np.where(turn == 1, spoilt, mixed))
    return found.astype(np.float32)


def to_onnx(
    module: torch.nn.Module, *, shape: tuple[int, ...], inputs: Sequence[str] = ()
) -> bytes:
    """Return the ONNX file of a module: "x", float32 (B, *shape), to "confidence", (B,).

    Args:
        module: what computes it.
        shape: of a row.
        inputs: names of what a row holds; strips may have any number of poses.

    Raises:
        BadValue: the module computes with an operator that the set lacks.
    """
    buffer = BytesIO()
    grows = {0: "batch"} | ({1: POSES} if view_of(inputs) == STRIPS else {})
    try:
        with without_remarks():
            torch.onnx.export(
                module.eval(),
                (torch.zeros((3, *shape)),),
                buffer,  # type: ignore[arg-type]  # the tracing exporter writes to open files, too
                dynamo=False,
                opset_version=OPSET,
                input_names=["x"],
                output_names=["confidence"],
                dynamic_axes={"x": grows, "confidence": {0: "batch"}},
            )
    except torch.onnx.errors.UnsupportedOperatorError as error:
        operator = re.findall(r"'(?:aten::)?(\S+)'", str(error))
        allowed = f"must be operators of ONNX's set {OPSET}"
        hint = "write it out in simpler ones, see docs/extend.md"
        raise BadValue(f"scorer={' '.join(operator[:1])}: {allowed}; {hint}") from None
    model = onnx.load_from_string(buffer.getvalue())

    # With torch's version in it, the file would change although the classifier does not.
    model.producer_name = "echolearn"
    model.producer_version = ""
    return bytes(model.SerializeToString(deterministic=True))
