"""Support vector machine with a radial basis function, the paper's classifier.

    d(x) = sum_i alpha_i exp(-gamma |z - z_i|^2) + rho,     z = (x - mean) / deviation

C and gamma are those with the best cross-validated area under the ROC curve on a grid. Folds are disjoint in
positions: neighbouring rows of one position in two folds would reward memory. The paper says five folds and leaves
the grid open; scikit-learn (libsvm) does the fitting, and the scorer writes out the sum above.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from sklearn.model_selection import GridSearchCV, StratifiedGroupKFold
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVC

from echolearn.classify.inputs import FEATURES, Inputs, as_input, check_inputs, check_labels
from echolearn.types import Array, check, check_number, check_whole


@dataclass
class Svm:
    """RBF-SVM on standardised columns.

    Attributes:
        inputs: column names.
        c_grid: candidates for C, the price of a training error.
        gamma_grid: candidates for gamma, per squared standard deviation.
        folds: of the cross-validation that chooses among them.
        search_rows: the search looks at no more rows than this (whole positions, drawn at random); the final fit
            takes all. Its cost grows with the cube of the rows, its verdict hardly changes.
        n_jobs: processes of the search.
        cross_validation: after `fit`, mean and standard deviation over folds of the chosen pair's AUC, C, gamma.
    """

    inputs: tuple[str, ...]
    c_grid: Sequence[float] = (0.1, 1.0, 10.0)
    gamma_grid: Sequence[float] = (0.01, 0.1, 1.0, 10.0, 100.0)
    folds: int = 5
    search_rows: int = 2000
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
        check_whole("classifier.search_rows", self.search_rows, low=50)
        check_whole("classifier.n_jobs", self.n_jobs, low=1, high=256)

    @property
    def view(self) -> str:
        """Return "features"."""
        return FEATURES

    def fit(
        self, x: Inputs, y: Array, *, groups: Array, validation: tuple[Inputs, Array], folder: Path, seed: int
    ) -> Self:
        """Choose C and gamma, then fit on all rows; see `Classifier.fit`."""
        x = as_input(x, self.inputs).astype(float)
        y = check_labels(y, len(x))
        rows = some_positions(np.asarray(groups), self.search_rows, seed)
        self.cross_validation = self.search(x[rows], y[rows], np.asarray(groups)[rows], seed)
        chosen = {"svm__C": self.cross_validation["c"], "svm__gamma": self.cross_validation["gamma"]}
        self.pipeline = machine().set_params(**chosen).fit(x, y)
        return self

    def search(self, x: Array, y: Array, groups: Array, seed: int) -> dict[str, float]:
        """Return the best pair of the grid, `c` and `gamma`, and its cross-validated `auc` and `auc_sd`."""
        fewest = min(len(np.unique(groups[y])), len(np.unique(groups[~y])))
        check(
            fewest >= 2, "positions", fewest, allowed="at least 2 of each class to cross-validate", hint="use more rows"
        )
        search = GridSearchCV(
            machine(),
            {"svm__C": list(self.c_grid), "svm__gamma": list(self.gamma_grid)},
            scoring="roc_auc",
            cv=StratifiedGroupKFold(min(self.folds, fewest), shuffle=True, random_state=seed),
            n_jobs=self.n_jobs,
            refit=False,
            error_score="raise",
        ).fit(x, y, groups=groups)
        best = search.best_index_
        return {
            "auc": float(search.cv_results_["mean_test_score"][best]),
            "auc_sd": float(search.cv_results_["std_test_score"][best]),
            "c": float(search.best_params_["svm__C"]),
            "gamma": float(search.best_params_["svm__gamma"]),
        }

    def decision(self, x: Inputs) -> Array:
        """Return the signed margin, shape (B,)."""
        margin: Array = self.pipeline.decision_function(as_input(x, self.inputs).astype(float))
        return margin

    def scorer(self) -> torch.nn.Module:
        """Return the kernel expansion as a torch module."""
        return KernelSum(self.pipeline["scaler"], self.pipeline["svm"])


def machine() -> Pipeline:
    """Return an unfitted scaler and SVM."""
    return Pipeline([("scaler", StandardScaler()), ("svm", SVC(kernel="rbf", cache_size=200))])


def some_positions(groups: Array, rows: int, seed: int) -> Array:
    """Return indices of about `rows` rows that keep whole positions together, all rows if there are fewer."""
    if len(groups) <= rows:
        return np.arange(len(groups))
    ids = np.random.default_rng(seed).permutation(np.unique(groups))
    share = max(2, round(len(ids) * rows / len(groups)))
    return np.flatnonzero(np.isin(groups, ids[:share]))


class KernelSum(torch.nn.Module):
    """A fitted RBF-SVM in float64 (in float32 the kernel's large sums would lose the last digits).

    Standardised inputs are clamped to +-1e5: no training row is further out, so such a row is at distance
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
            self.register_buffer(name, torch.tensor(np.ascontiguousarray(value), dtype=torch.float64))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, K) to (B,)."""
        z = ((x.double() - self.get_buffer("mean")) / self.get_buffer("scale")).clamp(-1e5, 1e5)
        distance = (z * z).sum(dim=1, keepdim=True) - 2.0 * (z @ self.get_buffer("support")) + self.get_buffer("square")
        kernel = torch.exp(-self.gamma * distance.clamp(min=0.0))
        return kernel @ self.get_buffer("weight") + self.get_buffer("offset")
