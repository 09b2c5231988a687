"""From decisions to confidences: one rule for all classifiers, on rows they were not fitted to.

    d --mapping--> confidence, 0 to 1;    confidence >= threshold: kept (`operating_point`)

- `platt` (Platt 1999): sigmoid(a d + b) by maximum likelihood, with targets (n1 + 1)/(n1 + 2) and
  1/(n0 + 2) in place of 1 and 0, so that a perfect separation gives no infinite slope.
- `temperature` (Guo et al., ICML 2017): the same with b = 0, for decisions that are logits: one
  number to fit, so few validation rows do.
- `isotonic`: centred isotonic regression (Oron, Flournoy, Statistics in Biopharmaceutical Research
  2017) of the same targets: pools of adjacent violators, joined at their centres by straight lines,
  so that it rises wherever the data do. Any shape; below the first pool and above the last it is
  level, which makes ties.

No mapping turns a classifier's verdict round: it may be flattened, never falls.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import isotonic_regression, minimize
from scipy.special import expit

from echolearn.acoustics.types import Array
from echolearn.checks import check_choice
from echolearn.classifiers.classifier import Classifier
from echolearn.classifiers.inputs import Inputs
from echolearn.classifiers.operating_point import Aim, OperatingPoint, OutOfReach, choose_cut

SMALLEST_SLOPE = 1e-3
"""Lower bound of a, per interquartile range of the decisions."""

ROUNDING = 1e-9
"""Difference of confidences below which two count as equal."""

PLATT = "platt"
METHODS = (PLATT, "temperature", "isotonic")


@dataclass(frozen=True)
class Sigmoid:
    """sigmoid(slope d + intercept)."""

    slope: float
    intercept: float

    def __call__(self, decision: Array) -> Array:
        """Return confidences, shape (B,), of decisions (B,)."""
        belief: Array = expit(self.slope * decision + self.intercept)
        return belief


@dataclass(frozen=True)
class Steps:
    """Straight lines between knots, level beyond them.

    Attributes:
        decision: of each knot, rising, shape (K,).
        confidence: of each knot, rising, shape (K,).
    """

    decision: tuple[float, ...]
    confidence: tuple[float, ...]

    def __call__(self, decision: Array) -> Array:
        """Return confidences, shape (B,), of decisions (B,)."""
        return np.interp(decision, self.decision, self.confidence)


Mapping = Sigmoid | Steps


@dataclass(frozen=True)
class Calibrated:
    """A fitted classifier with its confidence and its cut.

    Attributes:
        classifier: what was fitted.
        method: one of `METHODS`.
        mapping: from its decisions to confidences.
        point: where its confidences are cut.
        missed: what to say of an aim that is out of reach; the cut is then balanced.
    """

    classifier: Classifier
    method: str
    mapping: Mapping
    point: OperatingPoint
    missed: str = ""

    @property
    def threshold(self) -> float:
        """Confidence from which an echo is kept."""
        return self.point.threshold

    def confidence(self, x: Inputs) -> Array:
        """Return the belief in a reflector, 0 to 1, shape (B,)."""
        return self.mapping(self.classifier.decision(x))


def calibrate(
    classifier: Classifier, x: Inputs, y: Array, *, method: str = PLATT, aim: Aim | None = None
) -> Calibrated:
    """Return a fitted classifier with the calibration and the threshold that rows call for.

    Args:
        classifier: what has been fitted, to other rows.
        x: inputs, shape (B, ...).
        y: True for a reflector, shape (B,).
        method: one of `METHODS`.
        aim: what the cut shall do; balanced unless given. One that is out of reach is told, and
            the cut is balanced: what was trained for hours is not lost over it.
    """
    check_choice("calibration", method, *METHODS)
    decision = classifier.decision(x)
    mapping = mapping_of(decision, y, method=method)
    confidence = mapping(decision)
    try:
        return Calibrated(classifier, method, mapping, choose_cut(confidence, y, aim=aim or Aim()))
    except OutOfReach as error:
        point = choose_cut(confidence, y, aim=Aim())
        return Calibrated(classifier, method, mapping, point, missed=str(error))


def mapping_of(decision: Array, y: Array, *, method: str) -> Mapping:
    """Return the mapping from decisions to confidences that labels call for.

    Args:
        decision: shape (B,), of any scale.
        y: True for a reflector, shape (B,).
        method: one of `METHODS`.
    """
    if method == "isotonic":
        return isotonic(decision, y)
    return Sigmoid(*platt(decision, y, centred=method == "temperature"))


def targets(y: Array) -> Array:
    """Return what confidences are fitted to, shape (B,): 1 and 0, drawn in a little."""
    positives = int(y.sum())
    return np.where(y, (positives + 1) / (positives + 2), 1 / (len(y) - positives + 2))


def platt(decision: Array, y: Array, *, centred: bool = False) -> tuple[float, float]:
    """Return slope a > 0 and intercept b of the best calibration.

    Args:
        decision: shape (B,).
        y: True for a reflector, shape (B,).
        centred: whether the intercept is 0.
    """
    y = np.asarray(y).astype(bool)

    # The optimiser works on decisions of unit spread; where the quartiles coincide the deviation
    # stands in, and where all decisions do, nothing is scaled.
    low, centre, high = np.quantile(decision, [0.25, 0.5, 0.75])
    if centred:
        centre = 0.0
    spread = 1.0
    for candidate in (float(np.std(decision)), float(high - low)):
        if candidate > 1e-9 * abs(centre):
            spread = candidate
    z = np.clip((decision - centre) / spread, -100.0, 100.0)
    target = targets(y)

    def cost(parameters: Array) -> tuple[float, Array]:
        """Return the cross-entropy of slope and intercept, and its gradient."""
        logit = parameters[0] * z + parameters[1]
        error = expit(logit) - target
        likelihood = float(np.sum(np.logaddexp(0.0, logit) - target * logit))
        return likelihood, np.array([error @ z, error.sum()])

    start = np.array([1.0, 0.0])
    bounds = [(SMALLEST_SLOPE, None), (0.0, 0.0) if centred else (None, None)]
    slope, intercept = minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds).x
    return float(slope / spread), float(intercept - slope * centre / spread)


def isotonic(decision: Array, y: Array) -> Steps:
    """Return the centred isotonic regression of labels on decisions.

    Args:
        decision: shape (B,).
        y: True for a reflector, shape (B,).
    """
    order = np.argsort(decision, kind="stable")
    values, starts = np.unique(decision[order], return_index=True)
    # Equal decisions are one point, of the weight of all its rows.
    count = np.diff(np.append(starts, len(order))).astype(float)
    target = targets(np.asarray(y).astype(bool))[order]
    found = isotonic_regression(np.add.reduceat(target, starts) / count, weights=count)
    # Pools that differ by rounding are one.
    pools = found.blocks[:-1]
    pools = pools[np.append(True, np.diff(found.x[pools]) > ROUNDING)]
    centre = np.add.reduceat(count * values, pools) / np.add.reduceat(count, pools)
    return Steps(tuple(centre.tolist()), tuple(found.x[pools].tolist()))


def plain_calibration(fitted: Calibrated) -> dict[str, Any]:
    """Return a calibration as plain containers."""
    mapping = fitted.mapping
    if isinstance(mapping, Sigmoid):
        return {"slope": mapping.slope, "intercept": mapping.intercept}
    pairs = zip(mapping.decision, mapping.confidence, strict=True)
    return {"knots": [list(pair) for pair in pairs]}
