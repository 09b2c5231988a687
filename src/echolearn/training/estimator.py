"""A classifier as an estimator of scikit-learn's kind, for its cross-validation, searches, plots.

    X, y --a fifth held out, whole groups--> fit on the rest --> Platt's sigmoid on that fifth

That is what `train` does on the parts of a set. `decision_function` is the log-odds of the
confidence, so that `predict` is true from one half on; the cut of a run is another (`threshold_`).
"""

from copy import deepcopy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Self

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.model_selection import StratifiedGroupKFold
from sklearn.utils.multiclass import type_of_target
from sklearn.utils.validation import check_is_fitted, validate_data

from echolearn.acoustics.types import Array
from echolearn.checks import check
from echolearn.classifiers.calibration import Calibrated, calibrate
from echolearn.classifiers.classifier import Classifier, Examples

HELD = 5
"""One part in so many is held out for early stopping and calibration."""


class Filter(ClassifierMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """A classifier of echoes that scikit-learn can handle.

    Attributes:
        classifier: unfitted; it is copied before it learns.
        seed: of everything random.
        any_columns: learn on whatever columns X has, rather than on those of the classifier.
        classes_: both labels, the true one last; there after `fit`, as all that follows.
        calibrated_: the fitted classifier with confidence and cut.
    """

    def __init__(self, classifier: Classifier, *, seed: int = 0, any_columns: bool = False) -> None:
        self.classifier = classifier
        self.seed = seed
        self.any_columns = any_columns

    def __sklearn_tags__(self) -> Any:
        """Tell scikit-learn that there are two classes."""
        tags = super().__sklearn_tags__()
        tags.classifier_tags.multi_class = False
        return tags

    def fit(self, X: Any, y: Any, *, groups: Any = None) -> Self:  # noqa: N803
        """Learn from labelled columns.

        Args:
            X: columns, shape (B, K), in the classifier's order, or a table with columns of these
                names.
            y: labels of two kinds, shape (B,); the larger one is a reflector.
            groups: positions of which no rows part, shape (B,); None takes each row for itself.

        Raises:
            BadValue: not two labels, or fewer than two rows of one.
        """
        x, y = validate_data(self, self._columns(X), y)
        kind = type_of_target(y, input_name="y", raise_unknown=True)
        if kind != "binary":
            reason = "Only binary classification is supported. The type of the target is"
            raise ValueError(f"{reason} {kind}.")
        self.classes_, truth = np.unique(y, return_inverse=True)
        least = int(np.bincount(truth, minlength=2).min())
        allowed = "must be two or more of each of two classes"
        check(
            least > 1,
            "labels",
            f"{least} of a class",
            allowed=allowed,
            hint="one class teaches nothing",
        )

        # Of one position no row may tell of another that is held out.
        groups = np.arange(len(y)) if groups is None else np.asarray(groups)
        parts = StratifiedGroupKFold(min(HELD, least), shuffle=True, random_state=self.seed)
        taught, held = next(parts.split(x, truth, groups))
        self.calibrated_ = self._fitted(x, truth > 0, taught=taught, held=held, groups=groups)
        return self

    def _fitted(
        self, x: Array, y: Array, *, taught: Array, held: Array, groups: Array
    ) -> Calibrated:
        """Return the classifier, fitted and calibrated.

        Args:
            x: columns, shape (B, K).
            y: true of a reflector, shape (B,).
            taught, held: numbers of the rows to learn from, and of those held out.
            groups: positions, shape (B,).
        """
        model = deepcopy(self.classifier)
        if self.any_columns:
            model.inputs = tuple(f"x{index}" for index in range(x.shape[1]))
        with TemporaryDirectory() as folder:
            about: Any = {"folder": Path(folder), "seed": self.seed}
            unseen = (x[held], y[held])
            model.fit(Examples(x[taught], y[taught], groups[taught], unseen, **about))
        return calibrate(model, x[held], y[held])

    @property
    def threshold_(self) -> float:
        """Confidence from which a run would keep an echo."""
        check_is_fitted(self)
        return self.calibrated_.threshold

    def decision_function(self, X: Any) -> Array:  # noqa: N803
        """Return the log-odds of a reflector, shape (B,)."""
        check_is_fitted(self)
        x = validate_data(self, self._columns(X), reset=False)
        # The default of `calibrate`, so there are no steps of isotonic regression.
        sigmoid: Any = self.calibrated_.mapping
        decision: Array = self.calibrated_.classifier.decision(x)
        return sigmoid.slope * decision + sigmoid.intercept

    def predict_proba(self, X: Any) -> Array:  # noqa: N803
        """Return the confidences of both classes, shape (B, 2)."""
        confidence = 1 / (1 + np.exp(-self.decision_function(X)))
        return np.stack([1 - confidence, confidence], axis=1)

    def predict(self, X: Any) -> Array:  # noqa: N803
        """Return the likelier label, shape (B,)."""
        likely = self.decision_function(X) > 0
        return self.classes_[likely.astype(int)]

    def _columns(self, table: Any) -> Any:
        """Return the classifier's columns of a table that names its own."""
        named = hasattr(table, "columns") and not self.any_columns
        return table[list(self.classifier.inputs)] if named else table
