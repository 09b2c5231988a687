"""Classifiers: from what is known about an echo to the belief that a wall made it.

A classifier sees either named columns of a data set (`score`, `peak_to_rms`, ...; view "features")
or one tensor (`covariance`, ...; view "covariance"), and gives one real number per observation,
the *decision*: the larger, the stronger the belief in a reflector. Its scale is the classifier's
own: a logit for networks and trees, a signed margin for the SVM, a standardised column for a bare
threshold. Turning decisions into confidences is not the classifier's business: every one of them is
calibrated in the same way (`calibration`), on rows that `fit` used for early stopping at most.

    examples --fit--> classifier --decision--> d --sigmoid(a d + b)--> confidence >= threshold

Each file in `methods/` is one method: `threshold`, `svm`, `trees`, `network` (any `torch.nn.Module`
from `architectures`, or your own). To add another, write a dataclass with the three methods of
`Classifier` below, check its arguments in `__post_init__`, and put a `conf/classifier/<name>.yaml`
beside the others whose first line names the class and whose other keys are its arguments. Nothing
registers it: the contract tests find the file by glob, and so does a sweep over `classifier=...`.

Three promises keep all classifiers exchangeable:

- *Finite float32.* Inputs are rounded to float32 before anything looks at them (`inputs.as_input`),
  and whatever is not finite is refused. So `decision` and its exported twin see the same numbers.
- *One scorer.* `scorer()` writes the fitted function, scaler and all, as a torch module of real
  tensor operations. `onnx_export` turns it into a file that onnxruntime evaluates to the same
  confidences, for an SVM as for a network, and that file is all that is ever loaded again. Nothing
  is pickled.
- *Seeds.* `fit` with equal arguments gives equal decisions, and leaves the global random state
  alone.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, Self

from echolearn.acoustics.types import Array
from echolearn.classifiers.inputs import Inputs, check_labels

if TYPE_CHECKING:
    import torch


@dataclass(frozen=True)
class Examples:
    """Labelled observations to learn from, and what belongs to them.

    Attributes:
        x: columns, shape (B, K), or tensors, shape (B, bands, M * M); rows that are fetched when
            asked for, or an array (`as_input` turns either into an array).
        y: True for a reflector, shape (B,), bool, both classes among them.
        groups: id of the position each row was observed from, shape (B,); rows of one position
            never part.
        validation: x and y of positions that are not in `groups`, for early stopping.
        folder: folder of the run, where logs and checkpoints may be left.
        seed: seed of everything random.
        watch: called after each epoch with its number and a figure of validation rows, the larger
            the better; whatever it raises ends the fit.
        loggers: loggers of Lightning that a network tells its epochs to, besides its own files.
    """

    x: Inputs
    y: Array
    groups: Array
    validation: tuple[Inputs, Array]
    folder: Path
    seed: int
    watch: Callable[[int, float], None] | None = None
    loggers: Sequence[Any] = ()

    def __post_init__(self) -> None:
        check_labels(self.y, len(self.x))


class Classifier(Protocol):
    """What every classifier does.

    Two further attributes are copied into a run's metrics where a classifier has them after `fit`:
    `cross_validation`, what a search over its own settings has found, and `device`, the torch
    device that trained it. TensorBoard draws `curves`, figures by step under a tag each.
    A classifier that can begin from a filter that was trained before has `begin`, which is called
    with that (`earlier.EarlierFilter`) before `fit`.

    Attributes:
        inputs: names of the columns it sees, in order, or of the one tensor; `inputs.view_of` tells
            which.
    """

    inputs: tuple[str, ...]

    def fit(self, examples: Examples) -> Self:
        """Learn from labelled observations."""

    def decision(self, x: Inputs) -> Array:
        """Return the belief in a reflector, shape (B,), float64, on the classifier's own scale."""

    def scorer(self) -> "torch.nn.Module":
        """Return the same function as a torch module: float32 x to decisions (B,), on the CPU."""
