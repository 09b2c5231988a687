"""TensorBoard, the same for every classifier: one dashboard compares an SVM with a network.

A run says its own hyperparameters and no more: an "experiment" would name those that all runs have,
and TensorBoard takes the first that it finds for all. Without one it shows the union.
"""

import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from torch.utils.tensorboard import SummaryWriter
from torch.utils.tensorboard.summary import hparams

from echolearn.acoustics.types import Array
from echolearn.evaluation.metrics import reliability_curve
from echolearn.storage.files import unwritable


def write_events(
    folder: Path,
    *,
    identity: Mapping[str, Any],
    result: Mapping[str, Any],
    reference: Array,
    confidence: Array,
    curves: Mapping[str, Sequence[float]],
) -> None:
    """Write hyperparameters, figures, and the test part's precision-recall and reliability curves.

    Args:
        folder: folder of the run; events already there (a network's losses) stay.
        identity: what the run is made from, as in its `config.json`.
        result: metrics of the run.
        reference: labels of the test part, shape (B,).
        confidence: confidences of the test part, shape (B,).
        curves: figures by step that fitting has left, by tag.
    """
    scalars = {}
    for tag, part in (("val", "validation"), ("test", "test")):
        for name, value in result[part].items():
            # A metric without a value, such as the precision where nothing is kept, has no dot.
            if value is not None:
                scalars[f"{tag}/{name}"] = value
    # Its columns stand in this order: first what one looks for first.
    problem = dict(identity["problem"])
    first = {key: problem.pop(key) for key in ("plan", "seed")}
    settings = {"classifier": identity["name"], "argument": identity["classifier"]}
    parameters = flat(first | settings | problem)
    with SummaryWriter(log_dir=str(folder)) as writer:
        for tag, value in scalars.items():
            writer.add_scalar(tag, value)
        writer.add_pr_curve("test/pr", reference, confidence)
        for tag, values in curves.items():
            for step, value in enumerate(values):
                writer.add_scalar(tag, value, step)
        writer.add_figure(
            "test/reliability", reliability_diagram(reference, confidence), close=False
        )
        _, *session = hparams(parameters, dict(scalars))
        for summary in session:
            writer.file_writer.add_summary(summary)


def reliability_diagram(reference: Array, confidence: Array) -> Figure:
    """Draw what share of the echoes of about one confidence are true.

    Args:
        reference: labels, shape (B,).
        confidence: confidences, shape (B,).
    """
    figure = Figure(figsize=(3.2, 3.2), dpi=100, layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], color="#bbbbbb", label="as it should be")
    axes.plot(*reliability_curve(reference, confidence), "o-", label="test part")
    axes.set(xlabel="mean confidence", ylabel="share that is true", xlim=(0, 1), ylim=(0, 1))
    axes.legend(frameon=False)
    return figure


def flat(parameters: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return nested mappings as one, keys joined by dots; lists become text."""
    result: dict[str, Any] = {}
    for key, value in parameters.items():
        if isinstance(value, Mapping):
            result |= flat(value, f"{before}{key}.")
        else:
            shown = value if isinstance(value, int | float | str) else str(value)
            result[f"{before}{key}"] = shown
    return result


@contextmanager
def writable(folder: Path) -> Iterator[None]:
    """Turn a failing disk within the block into one `BadValue`.

    TensorBoard writes from a thread of its own, which would print a traceback besides raising in
    the main thread.

    Args:
        folder: where the block writes, for the message.
    """
    # The traceback of that thread says nothing that the message below does not.
    before = threading.excepthook
    threading.excepthook = lambda failed: (
        None if isinstance(failed.exc_value, OSError) else before(failed)
    )
    try:
        yield
    except OSError as error:
        raise unwritable(folder, error) from error
    finally:
        threading.excepthook = before
