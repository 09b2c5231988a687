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
from echolearn.storage.files import unwritable


def write_events(
    folder: Path,
    *,
    identity: Mapping[str, Any],
    result: Mapping[str, Any],
    reference: Array,
    confidence: Array,
    curves: Mapping[str, Sequence[float]],
    figures: Mapping[str, Figure | None],
    last: int = 0,
) -> None:
    """Write hyperparameters, metrics, curves and drawings of a run.

    Args:
        folder: folder of the run; events already there (a network's losses) stay.
        identity: what the run is made from, as in its `config.json`.
        result: metrics of the run.
        reference: labels of the test part, shape (B,).
        confidence: confidences of the test part, shape (B,).
        curves: numbers by step that fitting has left, by tag.
        figures: drawings by tag; those that are None are left out.
        last: step at which the metrics stand, after those of a network's epochs.
    """
    scalars = scalars_of(result)
    # Columns are sorted by their names, and the first five are shown: digits come before letters.
    problem = dict(identity["problem"])
    first = {"1 plan": problem.pop("plan"), "2 seed": problem.pop("seed")}
    settings = {"3 classifier": identity["name"], "argument": identity["classifier"]}
    parameters = flat(first | settings | problem)
    with SummaryWriter(log_dir=str(folder)) as writer:
        # A network's curves end in what its best epoch, whose weights were put back, is worth.
        for tag, value in scalars.items():
            writer.add_scalar(tag, value, last)
        writer.add_pr_curve("test/pr", reference, confidence)
        for tag, values in curves.items():
            for step, value in enumerate(values):
                writer.add_scalar(tag, value, step)
        for tag, figure in figures.items():
            if figure is not None:
                writer.add_figure(tag, figure, close=False)
        _, *session = hparams(parameters, dict(scalars))
        for summary in session:
            writer.file_writer.add_summary(summary)


def scalars_of(result: Mapping[str, Any]) -> dict[str, float]:
    """Return a run's metrics of validation and test rows, by tag."""
    scalars = {}
    for tag, part in (("val", "validation"), ("test", "test")):
        for name, value in result[part].items():
            # A metric without a value, such as the precision where nothing is kept, has no dot.
            if value is not None:
                scalars[f"{tag}/{name}"] = value
    return scalars


def log_run(
    logger: Any, identity: Mapping[str, Any], *, result: Mapping[str, Any], last: int
) -> None:
    """Tell a logger of Lightning what a run is made from and what it is worth.

    Args:
        logger: `lightning.pytorch.loggers.Logger`; a network has told it its epochs.
        identity, result, last: as those of `write_events`.
    """
    logger.log_hyperparams(flat(identity))
    logger.log_metrics(scalars_of(result), step=last)
    logger.save()
    logger.finalize("success")


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
