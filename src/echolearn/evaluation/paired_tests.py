"""Two classical tests of a difference: McNemar over rows, Nadeau and Bengio over folds.

*McNemar* (Psychometrika 12, 1947; recommended by Dietterich, Neural Computation 10, 1998, where
each model is trained once). Only rows on which one model is right and the other wrong tell
anything: b where the first is right, c where the second is. Under the null hypothesis b ~
B(b + c, 1/2), binomial. Rows of one cluster are not independent; with d_k = b_k - c_k of cluster k

    X^2 = (sum_k d_k)^2 / sum_k d_k^2  ~  chi^2 with one degree of freedom

(Durkalski et al., Statistics in Medicine 22, 2003, for clusters of one size), which is McNemar's
own (b - c)^2 / (b + c) if no cluster holds two such rows; then the exact binomial test is taken.

*Nadeau and Bengio* (Machine Learning 52, 2003). Training parts of folds overlap, so the variance
over J folds is too small for the variance of their mean. With n_1 rows for training and n_2 for
testing in each,

    t = mean / sqrt((1/J + n_2/n_1) s^2),    J - 1 degrees of freedom.

The same holds for folds of several seeds, all J of them together (Bouckaert and Frank, PAKDD 2004).
"""

import math

import numpy as np
from scipy.stats import binomtest, chi2
from scipy.stats import t as student

from echolearn.acoustics.types import Array
from echolearn.checks import check, check_number
from echolearn.evaluation.stats import LEVEL, Interval, numbered


def mcnemar(first: Array, second: Array, *, groups: Array) -> float:
    """Return the p value of McNemar's test that two models are right equally often.

    Args:
        first, second: where each of them is right, shape (B,), bool.
        groups: cluster of each row, shape (B,).

    Raises:
        BadValue: no rows.
    """
    member, clusters = numbered(groups)
    differs = np.asarray(first, dtype=float) - np.asarray(second, dtype=float)
    each = np.bincount(member, weights=differs, minlength=clusters)
    discordant = np.bincount(member, weights=np.abs(differs), minlength=clusters)

    # Two models that are right about the same rows give no evidence at all.
    if not differs.any():
        return 1.0
    if discordant.max() <= 1:
        better = int((differs > 0).sum())
        return float(binomtest(better, int(discordant.sum())).pvalue)
    # Clusters may cancel within themselves; if all do, their sum is 0 as well.
    spread = float(np.square(each).sum())
    return float(chi2.sf(each.sum() ** 2 / spread, 1)) if spread else 1.0


def corrected_t(differences: Array, *, test_to_training: float) -> tuple[Interval, float]:
    """Return the mean difference over folds with its interval, and the p value of no difference.

    Args:
        differences: of a metric, fold by fold, shape (J,).
        test_to_training: rows of a fold's test part over those that it is trained on.

    Raises:
        BadValue: fewer than two folds, or a ratio out of range.
    """
    folds = len(differences)
    check(folds > 1, "folds", folds, allowed="must be at least two, to tell how they differ")
    check_number("test_to_training", test_to_training, low=0.0, high=100.0)
    mean = float(np.mean(differences))
    error = math.sqrt((1 / folds + test_to_training) * float(np.var(differences, ddof=1)))

    half = float(student.ppf((1 + LEVEL) / 2, folds - 1)) * error
    found = Interval(mean, mean - half, mean + half)
    if error == 0.0:
        # Equal in every fold: no difference, or one without any spread.
        return found, 1.0 if mean == 0.0 else 0.0
    return found, float(2 * student.sf(abs(mean) / error, folds - 1))
