"""Do confidences mean what they say: of the echoes believed with 0.8, are 80 % true?

    error = sum_k n_k / n |mean confidence_k - share of true ones_k|,  k ten bins of equal count

Bins of equal count say something of every band of SNR, where bins of equal width hold all rows in
two of them (Nixon et al., Measuring Calibration in Deep Learning, CVPR workshops 2019). Even a
perfect confidence has an error, since shares of few rows vary: beside it stands the value to be
expected if each row were true with the chance that is claimed, for itself (Broecker, Smith, Weather
and Forecasting 22, 2007), by the normal approximation of each bin,

    perfect = sum_k n_k / n sqrt(2 / pi) sd_k,    sd_k^2 = sum p (1 - p) / n_k^2

Conventions are those of `metrics`.
"""

from typing import NamedTuple

import numpy as np

from echolearn.acoustics.types import Array
from echolearn.evaluation.metrics import each_weight, ratio, validate

BINS = 10

BANDS_DB = tuple((low, low + 10) for low in range(-40, 40, 10))
"""dB, from and to, of the bands in which confidences are judged."""


def equal_count(confidence: Array) -> Array:
    """Return which of ten bins of about equal count each row falls into, shape (B, 10), 0 and 1.

    Rows of one confidence are in one bin, so that no order of the rows decides.
    """
    edges = np.quantile(confidence, np.arange(1, BINS) / BINS) if len(confidence) else np.empty(0)
    member: Array = np.eye(BINS)[np.searchsorted(edges, confidence, side="right")]
    return member


def calibration_error(
    reference: Array, confidence: Array, *, weights: Array | None = None
) -> Array:
    """Return the mean over rows of |mean confidence - share of true ones| in the row's bin.

    Args:
        reference: shape (B,), bool.
        confidence: shape (B,), 0 to 1.
        weights: shape (..., B); the bins are those of the unweighted rows.
    """
    validate(reference, confidence, weights=weights)
    each = each_weight(reference, weights)
    surplus = each @ (equal_count(confidence) * (confidence - reference)[:, None])
    return ratio(np.abs(surplus).sum(axis=-1), each.sum(axis=-1))


def perfect_error(confidence: Array) -> float:
    """Return the calibration error that rows (B,) are expected to have if all is as claimed."""
    variance = (confidence * (1.0 - confidence)) @ equal_count(confidence)
    return float(np.sqrt(2.0 / np.pi) * np.sqrt(variance).sum() / max(1, len(confidence)))


class Curve(NamedTuple):
    """Belief and truth, bin by bin; bins without rows are left out.

    Attributes:
        confidence: mean belief, shape (K,).
        share: share of true ones, shape (K,).
        deviation: standard deviation of that share if all is as claimed, shape (K,).
    """

    confidence: Array
    share: Array
    deviation: Array


def curve(reference: Array, confidence: Array) -> Curve:
    """Return what a reliability diagram shows of rows (B,)."""
    validate(reference, confidence)
    member = equal_count(confidence)
    member = member[:, member.any(axis=0)]
    count = member.sum(axis=0)
    deviation = np.sqrt((confidence * (1.0 - confidence)) @ member) / count
    return Curve(confidence @ member / count, reference @ member / count, deviation)


def evaluate_calibration(
    reference: Array, confidence: Array, *, weights: Array | None = None
) -> dict[str, Array]:
    """Return the error by its name, and without weights the perfect one beside it.

    Args:
        reference: shape (B,), bool.
        confidence: shape (B,), 0 to 1.
        weights: shape (..., B).
    """
    found = {"calibration_error": calibration_error(reference, confidence, weights=weights)}
    perfect = {"calibration_error_perfect": np.array(perfect_error(confidence))}
    return found if weights is not None else found | perfect
