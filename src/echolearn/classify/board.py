"""TensorBoard, the same for every classifier, so that one dashboard compares an SVM with a network."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torch.utils.tensorboard import SummaryWriter
from torch.utils.tensorboard.summary import hparams

from echolearn.types import Array


def write_board(
    folder: Path, *, parameters: Mapping[str, Any], scalars: Mapping[str, float], reference: Array, confidence: Array
) -> None:
    """Write hyperparameters, final figures and the test part's precision-recall curve into a run folder.

    Args:
        folder: of the run; events already there (a network's losses) stay.
        parameters: nested plain containers.
        scalars: by tag, such as "test/auc".
        reference: labels of the test part, shape (B,).
        confidence: of the test part, shape (B,).
    """
    with SummaryWriter(log_dir=str(folder)) as writer:
        for tag, value in scalars.items():
            writer.add_scalar(tag, value)
        writer.add_pr_curve("test/pr", reference, confidence)
        for summary in hparams(flat(parameters), dict(scalars)):
            writer.file_writer.add_summary(summary)


def flat(parameters: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return nested mappings as one, keys joined by dots; lists become text."""
    result: dict[str, Any] = {}
    for key, value in parameters.items():
        if isinstance(value, Mapping):
            result |= flat(value, f"{before}{key}.")
        else:
            result[before + str(key)] = value if isinstance(value, bool | int | float | str) else str(value)
    return result
