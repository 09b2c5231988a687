"""Any estimator of scikit-learn's kind: `fit`, and `decision_function` or `predict_proba`.

    d(x) = decision_function(z), or the probability of a reflector where there is no such function,
    z = (x - mean) / deviation clipped as in `standardise`

A run is stored as one ONNX file of plain operators, which a robot takes from strangers, and that
file must compute what the estimator does on extreme inputs, too (`onnx_export`). So an estimator is
taken only if its function can be written down (`formula`): linear models, trees, forests, boosting,
perceptrons of several layers. Converters write trees as operators of a domain of their own, which
robots refuse, and others in float32, which is not the same function.
"""

from dataclasses import dataclass, field
from functools import partial, singledispatch
from typing import Any, Self

import numpy as np
import torch
from sklearn.base import BaseEstimator, clone
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import (
    ExtraTreesClassifier,
    GradientBoostingClassifier,
    HistGradientBoostingClassifier,
    RandomForestClassifier,
)
from sklearn.linear_model import LogisticRegression, RidgeClassifier, SGDClassifier
from sklearn.neural_network import MLPClassifier
from sklearn.svm import LinearSVC
from sklearn.tree import DecisionTreeClassifier
from sklearn.utils._param_validation import InvalidParameterError

from echolearn.acoustics.types import Array
from echolearn.checks import BadValue, check
from echolearn.classifiers.classifier import Examples
from echolearn.classifiers.constants import Formula
from echolearn.classifiers.inputs import Inputs, as_input, check_inputs
from echolearn.classifiers.methods.trees import forest
from echolearn.classifiers.standardise import standardiser

NODE = [(name, float) for name in ("left", "right", "feature_idx", "num_threshold", "value")]
NODE += [("is_leaf", float), ("depth", float)]
"""What `trees.forest` wants to know of a node."""


@dataclass
class Sklearn:
    """An estimator of scikit-learn's kind.

    Attributes:
        inputs: names of the columns.
        estimator: unfitted; its `random_state`, if it has one, becomes the run's seed.
    """

    inputs: tuple[str, ...]
    estimator: BaseEstimator
    model: Any = field(init=False, repr=False)
    scale: torch.nn.Module = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.inputs = check_inputs(self.inputs)
        name = type(self.estimator).__name__
        answers = any(
            hasattr(self.estimator, key) for key in ("decision_function", "predict_proba")
        )
        allowed = "must have decision_function or predict_proba"
        check(
            answers, "classifier.estimator", name, allowed=allowed, hint="this one tells no belief"
        )

        writable = formula.dispatch(type(self.estimator)) is not formula.dispatch(object)
        known = ", ".join(sorted(each.__name__ for each in formula.registry if each is not object))
        hint = "the function of this one cannot be written as an ONNX file that robots accept"
        allowed = f"must be one of {known}"
        check(writable, "classifier.estimator", name, allowed=allowed, hint=hint)
        try:
            self.estimator._validate_params()
        except InvalidParameterError as error:
            raise BadValue(f"classifier.estimator: {' '.join(str(error).split())}") from None

    def fit(self, examples: Examples) -> Self:
        """Fit the estimator to the training rows; it does not see those for validation."""
        x = as_input(examples.x, self.inputs)
        # Clipped, so that of sums of strange inputs more is left than their rounding.
        self.scale = standardiser(x)
        # The user's own object stays as it is: folds and seeds share it.
        self.model = clone(self.estimator)
        if "random_state" in self.model.get_params():
            self.model.set_params(random_state=examples.seed)
        self.model.fit(self._scaled(x), examples.y)
        return self

    def decision(self, x: Inputs) -> Array:
        """Return the decision or the probability, shape (B,)."""
        columns = self._scaled(as_input(x, self.inputs))
        if hasattr(self.model, "decision_function"):
            decision: Array = self.model.decision_function(columns)
            return decision
        probability: Array = self.model.predict_proba(columns)[:, 1]
        return probability

    def scorer(self) -> torch.nn.Module:
        """Return scaler and estimator as one torch module."""
        return torch.nn.Sequential(self.scale, formula(self.model))

    def _scaled(self, x: Array) -> Array:
        """Return columns (B, K) as the estimator sees them."""
        with torch.no_grad():
            scaled: Array = self.scale(torch.from_numpy(x)).numpy()
        return scaled.astype(float)


@singledispatch
def formula(model: Any) -> Formula:
    """Return the function of a fitted estimator as a torch module.

    Raises:
        BadValue: it is of another kind than those below.
    """
    raise BadValue(f"classifier.estimator={type(model).__name__}: cannot be written as torch")


@formula.register(LinearDiscriminantAnalysis)
@formula.register(LinearSVC)
@formula.register(LogisticRegression)
@formula.register(RidgeClassifier)
@formula.register(SGDClassifier)
def _(model: Any) -> Formula:
    return Formula(plane, weight=np.ravel(model.coef_), bias=float(np.ravel(model.intercept_)[0]))


@formula.register(HistGradientBoostingClassifier)
def _(model: Any) -> Formula:
    trees = [iteration[0].nodes for iteration in model._predictors]
    return forest(trees, float(model._baseline_prediction[0, 0]))


@formula.register(GradientBoostingClassifier)
def _(model: Any) -> Formula:
    trees = [nodes_of(each.tree_, 0) for each in model.estimators_[:, 0]]
    for nodes in trees:
        nodes["value"] *= model.learning_rate
    return forest(trees, float(model._raw_predict_init(np.zeros((1, model.n_features_in_)))[0, 0]))


@formula.register(ExtraTreesClassifier)
@formula.register(RandomForestClassifier)
def _(model: Any) -> Formula:
    trees = [nodes_of(each.tree_, 1) for each in model.estimators_]
    for nodes in trees:
        nodes["value"] /= len(trees)
    return forest(trees, 0.0)


@formula.register(DecisionTreeClassifier)
def _(model: Any) -> Formula:
    return forest([nodes_of(model.tree_, 1)], 0.0)


@formula.register(MLPClassifier)
def _(model: Any) -> Formula:
    layers: dict[str, Array] = {}
    for index, (weight, bias) in enumerate(zip(model.coefs_, model.intercepts_, strict=True)):
        layers |= {f"weight_{index}": weight, f"bias_{index}": bias}
    return Formula(partial(perceptron, activation=model.activation), **layers)


def nodes_of(tree: Any, output: int) -> Array:
    """Return the nodes of a tree of scikit-learn's older kind; `output` is which value it adds."""
    nodes = np.zeros(tree.node_count, dtype=NODE)
    nodes["left"] = tree.children_left
    nodes["right"] = tree.children_right
    nodes["is_leaf"] = tree.children_left < 0
    nodes["feature_idx"] = tree.feature
    nodes["num_threshold"] = tree.threshold
    nodes["value"] = tree.value[:, 0, output]
    nodes["depth"] = tree.max_depth
    return nodes


def plane(x: torch.Tensor, *, weight: torch.Tensor, bias: torch.Tensor) -> torch.Tensor:
    """Return w . x + b, shape (B,).

    Args:
        x: columns, shape (B, K).
        weight, bias: of the plane, shape (K,) and a number.
    """
    return x.double() @ weight + bias


def perceptron(x: torch.Tensor, *, activation: str, **layers: torch.Tensor) -> torch.Tensor:
    """Return the probability that a network of fully connected layers gives, shape (B,).

    Args:
        x: columns, shape (B, K).
        activation: of all layers but the last, as scikit-learn names it.
        layers: weight_0 (K, any), bias_0 (any,), and so on.
    """
    between = {"relu": torch.relu, "tanh": torch.tanh, "logistic": torch.sigmoid}
    value = x.double()
    last = len(layers) // 2 - 1
    for index in range(last):
        value = value @ layers[f"weight_{index}"] + layers[f"bias_{index}"]
        value = between.get(activation, torch.nn.Identity())(value)
    # The last layer has no activation of the user's choice.
    logit = value @ layers[f"weight_{last}"] + layers[f"bias_{last}"]
    return torch.sigmoid(logit[:, 0])
