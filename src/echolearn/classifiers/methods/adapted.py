"""Logistic regression on columns and, where there is one, on the logit of an earlier filter.

    d(x) = w . z + v f g + b,    z = standardised columns,  g = standardised logit,  f = `FREE`

minimises the cross-entropy of the training rows plus p (|w|^2 + v^2) / 2 (Hastie and others, The
Elements of Statistical Learning, 4.4). The penalty p is the one of `penalties` with which the
cross-entropy of validation rows, which are of other places, is lowest.

The logit comes multiplied by f, so that its weight costs f^2 times less than a column's of the same
effect: few recordings call for a large penalty, and what is left then is the earlier filter, its
scale adapted. Of a filter that sees a tensor the logit alone is looked at.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
import torch
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import log_loss

from echolearn.acoustics.types import Array
from echolearn.checks import check, check_list, is_number
from echolearn.classifiers.classifier import Examples
from echolearn.classifiers.constants import Formula
from echolearn.classifiers.earlier import EarlierFilter
from echolearn.classifiers.inputs import Inputs, as_input, check_inputs, is_tensor
from echolearn.classifiers.methods.sklearn import plane
from echolearn.classifiers.standardise import standardiser

FREE = 10.0
"""Factor on the standardised logit."""


@dataclass
class Adapted:
    """A plane in columns and a logit.

    Attributes:
        inputs: names of the columns; with an earlier filter also those that it sees.
        penalties: strengths of the penalty to choose from.
        earlier: filter whose logit is looked at, too, if there is one.
        cross_validation: what the search over `penalties` has found, after `fit`.
    """

    inputs: tuple[str, ...]
    penalties: Sequence[float] = (0.1, 1.0, 10.0, 100.0, 1000.0, 10_000.0)
    earlier: EarlierFilter | None = field(default=None, init=False, repr=False)
    cross_validation: dict[str, Any] = field(init=False, repr=False)
    scale: torch.nn.Module = field(init=False, repr=False)
    weight: Array = field(init=False, repr=False)
    bias: float = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.inputs = check_inputs(self.inputs)
        check_list("classifier.penalties", self.penalties)
        positive = all(is_number(each) and each > 0 for each in self.penalties)
        shown, allowed = list(self.penalties), "must be one positive number at least"
        check(positive and len(shown) > 0, "classifier.penalties", shown, allowed=allowed)

    def begin(self, earlier: EarlierFilter) -> Self:
        """Look at the logit of an earlier filter, too, and so at what that sees."""
        self.earlier = earlier
        both = dict.fromkeys((*earlier.inputs, *self.inputs))
        self.inputs = earlier.inputs if is_tensor(earlier.inputs) else tuple(both)
        return self

    @property
    def seen(self) -> int:
        """Number of what the plane lies in: columns, and the logit."""
        tensor = is_tensor(self.inputs)
        return (0 if tensor else len(self.inputs)) + (self.earlier is not None)

    def fit(self, examples: Examples) -> Self:
        """Fit a plane for each penalty, and keep the one that does best on validation rows."""
        x = self._seen(examples.x)
        self.scale = standardiser(x)
        held, labels = examples.validation
        scaled, unseen = self._scaled(x), self._scaled(self._seen(held))

        # From the strongest penalty on, so that of equal ones the simplest plane is kept.
        losses: dict[float, float] = {}
        for penalty in sorted(self.penalties, reverse=True):
            model = LogisticRegression(C=1.0 / penalty, max_iter=2000).fit(scaled, examples.y)
            lowest = min(losses.values(), default=np.inf)
            losses[penalty] = float(log_loss(labels, model.predict_proba(unseen)[:, 1]))
            if losses[penalty] < lowest:
                self.weight = self._factors() * model.coef_[0]
                self.bias = float(model.intercept_[0])
        best = min(losses, key=losses.__getitem__)
        self.cross_validation = {"penalty": best, "log_loss": losses[best]}
        return self

    def decision(self, x: Inputs) -> Array:
        """Return the logit, shape (B,)."""
        with torch.no_grad():
            return np.asarray(self.scorer()(torch.from_numpy(self._seen(x))))

    def scorer(self) -> torch.nn.Module:
        """Return scaler and plane as one torch module, of columns and logit (B, `seen`)."""
        return torch.nn.Sequential(self.scale, Formula(plane, weight=self.weight, bias=self.bias))

    def _seen(self, x: Inputs) -> Array:
        """Return columns and logit side by side, float32, shape (B, `seen`)."""
        whole = as_input(x, self.inputs)
        if self.earlier is None:
            return whole
        if is_tensor(self.inputs):
            return self.earlier.logit(whole)[:, None]
        # Columns of the earlier filter come first.
        logit = self.earlier.logit(whole[:, : len(self.earlier.inputs)])
        return np.concatenate([whole, logit[:, None]], axis=1)

    def _scaled(self, x: Array) -> Array:
        """Return columns and logit (B, `seen`) as the plane sees them."""
        with torch.no_grad():
            return self._factors() * self.scale(torch.from_numpy(x)).double().numpy()

    def _factors(self) -> Array:
        """Return what standardised columns and the logit are multiplied by, shape (`seen`,)."""
        factors = np.ones(self.seen)
        factors[self.seen - (self.earlier is not None) :] = FREE
        return factors
