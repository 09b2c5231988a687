"""Support vector machine with a radial basis function, the paper's classifier.

    d(x) = sum_i alpha_i exp(-gamma |z - z_i|^2) + rho,     z = (x - mean) / deviation

C and gamma are those with the best cross-validated area under the ROC curve on a grid. Folds are
disjoint in positions: neighbouring rows of one position in two folds would reward memory. The paper
says five folds and leaves the grid open; scikit-learn (libsvm) does the fitting, and the scorer
writes out the sum above.

A fit costs between the square and the cube of its rows. So the search looks at `search_rows` only,
and computes the distances |z_i - z_j|^2 of a fold once for the whole grid; beyond `fit_rows` the
fit takes a random part of the positions. Both numbers stand in the run's metrics.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Self

import numpy as np
import torch
from scipy.spatial.distance import cdist
from sklearn import config_context
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import StratifiedGroupKFold
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from sklearn.utils.parallel import Parallel, delayed

from echolearn.acoustics.types import Array
from echolearn.checks import check, check_fields, check_list, check_number
from echolearn.classifiers.classifier import Examples
from echolearn.classifiers.constants import Formula
from echolearn.classifiers.inputs import Inputs, as_input, check_inputs, check_labels

RANGES = {
    "folds": (2, 20),
    "search_rows": (50, 10_000),
    "fit_rows": (50, 1_000_000),
    "n_jobs": (1, 256),
}
"""Least and largest value of each setting that is a number."""


@dataclass
class Svm:
    """RBF-SVM on standardised columns.

    Attributes:
        inputs: names of the columns.
        c_grid: candidates for C, the price of a training error.
        gamma_grid: candidates for gamma, per squared standard deviation.
        folds: folds of the cross-validation that chooses among them.
        search_rows: rows that the search looks at, about and at most: whole positions at random.
        fit_rows: the same for the final fit; positions of the search are among them.
        n_jobs: processes of the search.
        cross_validation: after `fit`, mean and standard deviation over folds of the chosen pair's
            AUC, C, gamma, and the rows that search and fit have seen.
        curves: after `fit`, mean AUC over `c_grid` for each gamma.
    """

    inputs: tuple[str, ...]
    c_grid: Sequence[float] = (0.1, 1.0, 10.0)
    gamma_grid: Sequence[float] = (0.01, 0.1, 1.0, 10.0, 100.0)
    folds: int = 5
    search_rows: int = 2000
    fit_rows: int = 10_000
    n_jobs: int = 1
    cross_validation: dict[str, float] = field(init=False, repr=False)
    curves: dict[str, list[float]] = field(init=False, repr=False)
    pipeline: Pipeline = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.inputs = check_inputs(self.inputs)
        for name in ("c_grid", "gamma_grid"):
            key = f"classifier.{name}"
            grid = getattr(self, name)
            check_list(key, grid, allowed="must be a list of positive numbers, [0.1,1]")
            check(len(grid) > 0, key, "[]", allowed="must have at least one number")
            for value in grid:
                check_number(key, value, low=1e-6, high=1e6)
        check_fields("classifier", self, ranges=RANGES)

    def fit(self, examples: Examples) -> Self:
        """Choose C and gamma by cross-validation, then fit with them."""
        x = as_input(examples.x, self.inputs).astype(float)
        y = examples.y
        groups = examples.groups
        seed = examples.seed
        seen = some_positions(groups, rows=self.search_rows, seed=seed)
        rows = some_positions(groups, rows=self.fit_rows, seed=seed)
        check_labels(y[rows], len(rows))
        found = self.search(x[seen], y[seen], groups=groups[seen], seed=seed)
        self.cross_validation = found | {"search_rows": len(seen), "fit_rows": len(rows)}

        # Fitted once more, to more rows than the search could afford.
        svm = SVC(cache_size=200, C=found["c"], gamma=found["gamma"])
        self.pipeline = make_pipeline(StandardScaler(), svm).fit(x[rows], y[rows])
        return self

    def search(self, x: Array, y: Array, *, groups: Array, seed: int) -> dict[str, float]:
        """Return the best pair of the grid, `c` and `gamma`, and its `auc` and `auc_sd` over folds.

        Args:
            x: columns, shape (B, K).
            y: True for a reflector, shape (B,).
            groups: position of each row, shape (B,).
            seed: seed of the division into folds.
        """
        # A fold without both classes has no ROC curve.
        fewest = min(len(np.unique(groups[y])), len(np.unique(groups[~y])))
        allowed = "must be at least 2 of each class to cross-validate"
        check(fewest >= 2, "positions", fewest, allowed=allowed, hint="use more rows")
        count = min(self.folds, fewest)
        folds = StratifiedGroupKFold(count, shuffle=True, random_state=seed)

        jobs = [
            delayed(self.fold_scores)(x, y, fold=fold, held=held)
            for fold, held in folds.split(x, y, groups)
        ]
        scores = np.array(Parallel(self.n_jobs)(jobs))
        mean = scores.mean(axis=0)
        best = np.unravel_index(mean.argmax(), mean.shape)
        names = [f"search/gamma={gamma:g}" for gamma in self.gamma_grid]
        self.curves = dict(zip(names, mean.T.tolist(), strict=True))
        return {
            "auc": float(mean[best]),
            "auc_sd": float(scores.std(axis=0)[best]),
            "c": float(self.c_grid[best[0]]),
            "gamma": float(self.gamma_grid[best[1]]),
        }

    def fold_scores(self, x: Array, y: Array, *, fold: Array, held: Array) -> Array:
        """Return the area under the ROC curve of every pair of the grid, shape (C, gammas).

        Args:
            x: columns, shape (B, K).
            y: True for a reflector, shape (B,).
            fold: rows to fit on.
            held: rows to score.
        """
        scaler = StandardScaler().fit(x[fold])
        known = scaler.transform(x[fold])
        near = cdist(known, known, "sqeuclidean")
        far = cdist(scaler.transform(x[held]), known, "sqeuclidean")
        scores = np.empty((len(self.c_grid), len(self.gamma_grid)))
        for column, gamma in enumerate(self.gamma_grid):
            kernel = np.exp(-gamma * near)
            other = np.exp(-gamma * far)
            for row, c in enumerate(self.c_grid):
                # The checks of scikit-learn would take as long as the fit.
                with config_context(assume_finite=True, skip_parameter_validation=True):
                    svm = SVC(kernel="precomputed", C=c, cache_size=200).fit(kernel, y[fold])
                    decision = other[:, svm.support_] @ svm.dual_coef_[0]
                    scores[row, column] = roc_auc_score(y[held], decision)
        return scores

    def decision(self, x: Inputs) -> Array:
        """Return the signed margin, shape (B,)."""
        margin: Array = self.pipeline.decision_function(as_input(x, self.inputs).astype(float))
        return margin

    def scorer(self) -> torch.nn.Module:
        """Return the kernel expansion as a torch module."""
        scaler, svm = self.pipeline
        support = svm.support_vectors_
        return Formula(
            partial(kernel_sum, gamma=float(svm.gamma)),
            mean=scaler.mean_,
            scale=scaler.scale_,
            support=support.T,
            square=(support**2).sum(axis=1),
            weight=svm.dual_coef_[0],
            offset=svm.intercept_,
        )


def some_positions(groups: Array, *, rows: int, seed: int) -> Array:
    """Return indices of about `rows` rows, whole positions; all rows if there are fewer.

    Args:
        groups: position of each row, shape (B,).
        rows: number wanted.
        seed: seed of the order in which positions are taken, which is the same for any number.
    """
    if len(groups) <= rows:
        return np.arange(len(groups))
    ids = np.random.default_rng(seed).permutation(np.unique(groups))
    share = max(2, round(len(ids) * rows / len(groups)))
    return np.flatnonzero(np.isin(groups, ids[:share]))


def kernel_sum(
    x: torch.Tensor,
    *,
    gamma: float,
    mean: torch.Tensor,
    scale: torch.Tensor,
    support: torch.Tensor,
    square: torch.Tensor,
    weight: torch.Tensor,
    offset: torch.Tensor,
) -> torch.Tensor:
    """Return d, shape (B,), in float64: in float32 its large sums would lose the last digits.

    Args:
        x: columns, shape (B, K).
        gamma: width of the kernel, per squared standard deviation.
        mean, scale: of each column, shape (K,).
        support, square: z_i, shape (K, I), and |z_i|^2, shape (I,).
        weight, offset: alpha_i, shape (I,), and rho.
    """
    # No training row is beyond 1e5 deviations, so a row out there is at distance infinity either
    # way; clamped, |z|^2 - 2 z.z_i + |z_i|^2 stays finite.
    z = ((x.double() - mean) / scale).clamp(-1e5, 1e5)
    distance = (z * z).sum(dim=1, keepdim=True) - 2.0 * (z @ support) + square

    # Rounding leaves squares of distances slightly below zero.
    return torch.exp(-gamma * distance.clamp(min=0.0)) @ weight + offset
