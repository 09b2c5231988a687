"""Support vector machine with a radial basis function, the paper's classifier.

    d(x) = sum_i alpha_i exp(-gamma |z - z_i|^2) + rho,     z = (x - mean) / deviation

C and gamma are those with the best cross-validated area under the ROC curve on a grid. Folds are
disjoint in
positions: neighbouring rows of one position in two folds would reward memory. The paper says five
    folds and leaves
the grid open; scikit-learn (libsvm) does the fitting, and the scorer writes out the sum above.

A fit costs between the square and the cube of its rows. So the search looks at `search_rows` only,
and computes the
distances |z_i - z_j|^2 of a fold once for the whole grid; beyond `fit_rows` the fit takes a random part of the
positions. Both numbers stand in the run's metrics.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from scipy.spatial.distance import cdist
from sklearn import config_context
from sklearn.metrics import roc_auc_score
from sklearn.model_selection import StratifiedGroupKFold
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC
from sklearn.utils.parallel import Parallel, delayed

from echolearn.acoustics.types import Array
from echolearn.checks import check, check_number, check_whole
from echolearn.classifiers.inputs import FEATURES, Inputs, as_input, check_inputs, check_labels


@dataclass
class Svm:
    """RBF-SVM on standardised columns.

    Attributes:
        inputs: column names.
        c_grid: candidates for C, the price of a training error.
        gamma_grid: candidates for gamma, per squared standard deviation.
        folds: of the cross-validation that chooses among them.
        search_rows: the search looks at about this many rows at most, whole positions drawn at
            random.
        fit_rows: the same for the final fit; positions of the search are among them.
        n_jobs: processes of the search.
        cross_validation: after `fit`, mean and standard deviation over folds of the chosen pair's
            AUC, C, gamma, and the rows that search and fit have seen.
    """

    inputs: tuple[str, ...]
    c_grid: Sequence[float] = (0.1, 1.0, 10.0)
    gamma_grid: Sequence[float] = (0.01, 0.1, 1.0, 10.0, 100.0)
    folds: int = 5
    search_rows: int = 2000
    fit_rows: int = 10_000
    n_jobs: int = 1
    cross_validation: dict[str, float] = field(init=False, repr=False)
    pipeline: Pipeline = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.inputs = check_inputs(self.inputs)
        for name, grid in (("c_grid", self.c_grid), ("gamma_grid", self.gamma_grid)):
            listed = isinstance(grid, Sequence) and not isinstance(grid, str) and len(grid) > 0
            check(listed, f"classifier.{name}", grid, allowed="a list of positive numbers")
            for value in grid:
                check_number(f"classifier.{name}", value, low=1e-6, high=1e6)
        check_whole("classifier.folds", self.folds, low=2, high=20)
        check_whole("classifier.search_rows", self.search_rows, low=50, high=10_000)
        check_whole("classifier.fit_rows", self.fit_rows, low=50, high=1_000_000)
        check_whole("classifier.n_jobs", self.n_jobs, low=1, high=256)

    @property
    def view(self) -> str:
        """Return "features"."""
        return FEATURES

    def fit(
        self,
        x: Inputs,
        y: Array,
        *,
        groups: Array,
        validation: tuple[Inputs, Array],
        folder: Path,
        seed: int,
    ) -> Self:
        """Choose C and gamma, then fit; see `Classifier.fit`."""
        x, groups = as_input(x, self.inputs).astype(float), np.asarray(groups)
        y = check_labels(y, len(x))
        seen, rows = (
            some_positions(groups, count, seed) for count in (self.search_rows, self.fit_rows)
        )
        check_labels(y[rows], len(rows))
        found = self.search(x[seen], y[seen], groups[seen], seed)
        self.cross_validation = found | {"search_rows": len(seen), "fit_rows": len(rows)}
        self.pipeline = machine(C=found["c"], gamma=found["gamma"]).fit(x[rows], y[rows])
        return self

    def search(self, x: Array, y: Array, groups: Array, seed: int) -> dict[str, float]:
        """Return the best pair of the grid, `c` and `gamma`, and its cross-validated `auc` and
        `auc_sd`.
        """
        fewest = min(len(np.unique(groups[y])), len(np.unique(groups[~y])))
        check(
            fewest >= 2,
            "positions",
            fewest,
            allowed="at least 2 of each class to cross-validate",
            hint="use more rows",
        )
        folds = StratifiedGroupKFold(
            min(self.folds, fewest), shuffle=True, random_state=seed
        ).split(x, y, groups)
        jobs = (delayed(fold_scores)(x, y, rows, self.c_grid, self.gamma_grid) for rows in folds)
        scores = np.array(Parallel(self.n_jobs)(jobs))
        best = np.unravel_index(scores.mean(axis=0).argmax(), scores.shape[1:])
        return {
            "auc": float(scores.mean(axis=0)[best]),
            "auc_sd": float(scores.std(axis=0)[best]),
            "c": float(self.c_grid[best[0]]),
            "gamma": float(self.gamma_grid[best[1]]),
        }

    def decision(self, x: Inputs) -> Array:
        """Return the signed margin, shape (B,)."""
        margin: Array = self.pipeline.decision_function(as_input(x, self.inputs).astype(float))
        return margin

    def scorer(self) -> torch.nn.Module:
        """Return the kernel expansion as a torch module."""
        return KernelSum(self.pipeline["scaler"], self.pipeline["svm"])


def machine(**settings: Any) -> Pipeline:
    """Return an unfitted scaler and SVM."""
    return Pipeline(
        [("scaler", StandardScaler()), ("svm", SVC(kernel="rbf", cache_size=200, **settings))]
    )


def fold_scores(
    x: Array,
    y: Array,
    rows: tuple[Array, Array],
    c_grid: Sequence[float],
    gamma_grid: Sequence[float],
) -> Array:
    """Return the area under the ROC curve for every pair of the grid, shape (C, gammas), in one
    fold.

    Args:
        x: columns, shape (B, K).
        y: True for a reflector, shape (B,).
        rows: to fit on, and to judge on.
        c_grid: candidates for C.
        gamma_grid: candidates for gamma.
    """
    scaler = StandardScaler().fit(x[rows[0]])
    known, held = (scaler.transform(x[part]) for part in rows)
    near, far = cdist(known, known, "sqeuclidean"), cdist(held, known, "sqeuclidean")
    scores = np.empty((len(c_grid), len(gamma_grid)))
    for column, gamma in enumerate(gamma_grid):
        kernel, other = np.exp(-gamma * near), np.exp(-gamma * far)
        for row, c in enumerate(c_grid):
            with config_context(
                assume_finite=True, skip_parameter_validation=True
            ):  # checks as long as the fit
                svm = SVC(kernel="precomputed", C=c, cache_size=200).fit(kernel, y[rows[0]])
                scores[row, column] = roc_auc_score(
                    y[rows[1]], other[:, svm.support_] @ svm.dual_coef_[0]
                )
    return scores


def some_positions(groups: Array, rows: int, seed: int) -> Array:
    """Return indices of about `rows` rows that keep whole positions together, all rows if there are
    fewer.
    """
    if len(groups) <= rows:
        return np.arange(len(groups))
    ids = np.random.default_rng(seed).permutation(np.unique(groups))
    share = max(2, round(len(ids) * rows / len(groups)))
    return np.flatnonzero(np.isin(groups, ids[:share]))


class KernelSum(torch.nn.Module):
    """A fitted RBF-SVM in float64 (in float32 the kernel's large sums would lose the last digits).

    Standardised inputs are clamped to +-1e5: no training row is further out, so such a row is at
    distance
    infinity either way, and |z|^2 - 2 z.z_i + |z_i|^2 stays finite.
    """

    def __init__(self, scaler: StandardScaler, svm: SVC) -> None:
        super().__init__()
        self.gamma = float(svm.gamma)
        support: Any = svm.support_vectors_
        values = {
            "mean": scaler.mean_,
            "scale": scaler.scale_,
            "support": support.T,
            "square": (support**2).sum(axis=1),
            "weight": svm.dual_coef_[0],
            "offset": svm.intercept_,
        }
        for name, value in values.items():
            self.register_buffer(
                name, torch.tensor(np.ascontiguousarray(value), dtype=torch.float64)
            )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, K) to (B,)."""
        z = ((x.double() - self.get_buffer("mean")) / self.get_buffer("scale")).clamp(-1e5, 1e5)
        distance = (
            (z * z).sum(dim=1, keepdim=True)
            - 2.0 * (z @ self.get_buffer("support"))
            + self.get_buffer("square")
        )
        kernel = torch.exp(-self.gamma * distance.clamp(min=0.0))
        return kernel @ self.get_buffer("weight") + self.get_buffer("offset")
