"""From decisions to confidences, and the cut between kept and rejected: one rule for all.

Platt (1999) fits confidence = sigmoid(a d + b) by maximum likelihood on data the classifier was not
fitted to, with targets (n1 + 1)/(n1 + 2) and 1/(n0 + 2) in place of 1 and 0, so that a perfect
separation gives no infinite slope. The slope is kept positive: calibration may flatten a classifier
but never turn its verdict round.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from echolearn.acoustics.types import Array
from echolearn.classifiers.classifier import Classifier
from echolearn.classifiers.inputs import Inputs

SMALLEST_SLOPE = 1e-3
"""Lower bound of a, per interquartile range of the decisions."""


@dataclass(frozen=True)
class Calibrated:
    """A fitted classifier with its confidence, sigmoid(slope d + intercept), and its cut."""

    classifier: Classifier
    slope: float
    intercept: float
    threshold: float

    def confidence(self, x: Inputs) -> Array:
        """Return the belief in a reflector, 0 to 1, shape (B,)."""
        belief: Array = expit(self.slope * self.classifier.decision(x) + self.intercept)
        return belief


def calibrate(classifier: Classifier, x: Inputs, y: Array) -> Calibrated:
    """Return a fitted classifier with the calibration and the threshold that rows call for.

    Args:
        classifier: what has been fitted, to other rows.
        x: inputs, shape (B, ...).
        y: True for a reflector, shape (B,).
    """
    decision = classifier.decision(x)
    slope, intercept = platt(decision, y)
    threshold = best_threshold(expit(slope * decision + intercept), y)
    return Calibrated(classifier, slope, intercept, threshold)


def platt(decision: Array, y: Array) -> tuple[float, float]:
    """Return slope a > 0 and intercept b of the best calibration.

    Args:
        decision: shape (B,).
        y: True for a reflector, shape (B,).
    """
    y = np.asarray(y).astype(bool)

    # The optimiser works on decisions of unit spread; where the quartiles coincide the deviation
    # stands in, and where all decisions do, nothing is scaled.
    low, centre, high = np.quantile(decision, [0.25, 0.5, 0.75])
    spread = 1.0
    for candidate in (float(np.std(decision)), float(high - low)):
        if candidate > 1e-9 * abs(centre):
            spread = candidate
    z = np.clip((decision - centre) / spread, -100.0, 100.0)

    positives = int(y.sum())
    target = np.where(y, (positives + 1) / (positives + 2), 1 / (len(y) - positives + 2))

    def cost(parameters: Array) -> tuple[float, Array]:
        """Return the cross-entropy of slope and intercept, and its gradient."""
        logit = parameters[0] * z + parameters[1]
        error = expit(logit) - target
        likelihood = float(np.sum(np.logaddexp(0.0, logit) - target * logit))
        return likelihood, np.array([error @ z, error.sum()])

    start = np.array([1.0, 0.0])
    bounds = [(SMALLEST_SLOPE, None), (None, None)]
    slope, intercept = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds).x
    return float(slope / spread), float(intercept - slope * centre / spread)


def best_threshold(confidence: Array, y: Array) -> float:
    """Return the cut with the largest balanced accuracy when confidence >= cut is kept.

    Cuts lie midway between neighbouring confidences. Among equally good ones the one nearest to 0.5
    is taken, so that a plateau does not leave the choice to chance.

    Args:
        confidence: 0 to 1, shape (B,).
        y: True for a reflector, shape (B,).
    """
    y = np.asarray(y).astype(bool)
    values = np.unique(confidence)
    if len(values) < 2:
        return 0.5
    cuts = (values[:-1] + values[1:]) / 2.0
    kept_true = y.sum() - np.searchsorted(np.sort(confidence[y]), cuts)
    dropped_false = np.searchsorted(np.sort(confidence[~y]), cuts)
    balanced = kept_true / max(1, y.sum()) + dropped_false / max(1, (~y).sum())

    # Cuts that divide the rows equally well differ by rounding only.
    best = cuts[np.isclose(balanced, balanced.max(), rtol=0.0, atol=1e-12)]
    return float(best[np.argmin(np.abs(best - 0.5))])
