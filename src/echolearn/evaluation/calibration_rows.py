"""The rows of `results.csv` that judge a model by the label that it has learned.

`calibration_error` over all rows and in each 10 dB band of SNR, and beside it, as
`calibration_error_perfect`, what it would be if confidences were exactly right (`reliability`). A
model of another label than the paper's also has `own_auc`, and so on, by its own.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from echolearn.acoustics.types import Array
from echolearn.evaluation import metrics
from echolearn.evaluation.reliability import BANDS_DB, evaluate_calibration
from echolearn.evaluation.rows import PAPER, LabelledRows, Model, Predictions, Row
from echolearn.evaluation.scoring import tabulate, tabulate_bands

OWN = ("auc", "balanced_accuracy", "precision", "recall", "specificity")
"""Metrics that are also given by a model's own label."""


def score_calibration(
    model: Model, predictions: Sequence[Predictions], *, labelled: LabelledRows
) -> Iterator[Row]:
    """Yield a model's rows by its own label.

    Args:
        model: the model.
        predictions: what it says, one for each seed.
        labelled: the test set, its reference the label that the model has learned.
    """

    def calibration(given: Predictions, weights: Array | None) -> Mapping[str, Array]:
        """Return the calibration error of one seed's predictions."""
        reference = labelled.reference[given.rows]
        return evaluate_calibration(reference, given.confidence, weights=weights)

    def own(given: Predictions, weights: Array | None) -> Mapping[str, Array]:
        """Return other metrics, too."""
        reference = labelled.reference[given.rows]
        about: Any = {"threshold": given.threshold, "weights": weights}
        found = metrics.evaluate_labels(reference, given.confidence, **about)
        return {**calibration(given, weights), **{f"own_{name}": found[name] for name in OWN}}

    every = own if model.target not in ("", PAPER) else calibration
    about: dict[str, Any] = {"model": model, "predictions": predictions, "labelled": labelled}
    yield from tabulate(every, **about)
    yield from tabulate_bands(calibration, BANDS_DB, **about)
