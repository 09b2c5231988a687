"""Gradient-boosted trees on binned columns (Friedman 2001; scikit-learn's histogram version).

    d(x) = d_0 + sum_t v_t[leaf of x in tree t],     a logit

Trees need no scaling and take any mixture of units; they stop growing in number when the validation
loss stops falling. The scorer walks all trees at once: one node index per row and tree, moved
`depth` times by gathers.
"""

from dataclasses import dataclass, field
from functools import partial
from typing import Any, Self

import numpy as np
import torch
from sklearn.ensemble import HistGradientBoostingClassifier

from echolearn.acoustics.types import Array
from echolearn.checks import check_fields
from echolearn.classifiers.classifier import Examples
from echolearn.classifiers.constants import Formula
from echolearn.classifiers.inputs import Inputs, as_input, check_inputs

RANGES = {
    "iterations": (1, 5000),
    "learning_rate": (1e-4, 1.0),
    "leaves": (2, 1000),
    "depth": (1, 20),
    "min_leaf": (1, 10**9),
    "l2": (0.0, 1e6),
    "patience": (1, 5000),
}
"""Least and largest value of each setting that is a number."""


@dataclass
class Trees:
    """Histogram gradient boosting.

    Attributes:
        inputs: names of the columns.
        iterations: number of trees, at most.
        learning_rate: shrinkage of each tree.
        leaves: leaves of a tree, at most.
        depth: depth of a tree, at most.
        min_leaf: rows in a leaf, at least.
        l2: ridge penalty on the leaves' values.
        patience: number of trees without a lower validation loss before stopping.
        curves: after `fit`, losses of both parts after each tree, the first before any.
    """

    inputs: tuple[str, ...]
    iterations: int = 300
    learning_rate: float = 0.06
    leaves: int = 12
    depth: int = 6
    min_leaf: int = 20
    l2: float = 1.0
    patience: int = 30
    model: HistGradientBoostingClassifier = field(init=False, repr=False)
    curves: dict[str, list[float]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self.inputs = check_inputs(self.inputs)
        check_fields("classifier", self, ranges=RANGES)

    def fit(self, examples: Examples) -> Self:
        """Add trees until the validation loss stops falling."""
        x = as_input(examples.x, self.inputs).astype(float)
        unseen = as_input(examples.validation[0], self.inputs).astype(float)
        self.model = HistGradientBoostingClassifier(
            max_iter=self.iterations,
            learning_rate=self.learning_rate,
            max_leaf_nodes=self.leaves,
            max_depth=self.depth,
            min_samples_leaf=self.min_leaf,
            l2_regularization=self.l2,
            early_stopping=True,
            n_iter_no_change=self.patience,
            random_state=examples.seed,
        )
        self.model.fit(x, examples.y, X_val=unseen, y_val=examples.validation[1])
        # scikit-learn's scores are losses with the other sign.
        losses = {"train/loss": self.model.train_score_, "val/loss": self.model.validation_score_}
        self.curves = {tag: (-values).tolist() for tag, values in losses.items()}
        return self

    def decision(self, x: Inputs) -> Array:
        """Return the logit, shape (B,)."""
        logit: Array = self.model.decision_function(as_input(x, self.inputs).astype(float))
        return logit

    def scorer(self) -> torch.nn.Module:
        """Return the trees as a torch module."""
        trees = [iteration[0].nodes for iteration in self.model._predictors]
        return forest(trees, float(self.model._baseline_prediction[0, 0]))


def forest(trees: list[Any], baseline: float) -> Formula:
    """Return binary trees as one table of nodes; a leaf is a node whose children are itself.

    Args:
        trees: nodes of each tree, as scikit-learn's predictors have them.
        baseline: logit to which the trees add.
    """
    nodes = np.concatenate(trees)
    leaf = nodes["is_leaf"].astype(bool)

    # Children are numbered within their tree: in the table they follow its first node.
    sizes = [len(tree) for tree in trees]
    root = np.cumsum([0, *sizes[:-1]])
    children = np.stack([nodes["left"], nodes["right"]], axis=1).astype(np.int64)
    children += np.repeat(root, sizes)[:, None]

    # A row that has reached a leaf stays there while others still descend.
    children[leaf] = np.flatnonzero(leaf)[:, None]
    return Formula(
        partial(walk, depth=int(nodes["depth"].max())),
        root=root[None],
        child=children.ravel(),
        feature=np.where(leaf, 0, nodes["feature_idx"]).astype(np.int64),
        limit=np.where(leaf, 0.0, nodes["num_threshold"]),
        value=np.where(leaf, nodes["value"], 0.0),
        baseline=baseline,
    )


def walk(
    x: torch.Tensor,
    *,
    depth: int,
    root: torch.Tensor,
    child: torch.Tensor,
    feature: torch.Tensor,
    limit: torch.Tensor,
    value: torch.Tensor,
    baseline: torch.Tensor,
) -> torch.Tensor:
    """Return the logits, shape (B,): all trees are walked together.

    Args:
        x: columns, shape (B, K).
        depth: steps from the root to the farthest leaf.
        root: first node of each tree, shape (1, trees).
        child: node to the left and to the right of each, shape (2 nodes,).
        feature, limit, value: column that a node asks for, the largest number that goes left, and
            what a leaf adds; each of shape (nodes,).
        baseline: logit to which the trees add.
    """
    x = x.double()
    node = root + torch.zeros_like(x[:, :1], dtype=torch.int64)
    for _ in range(depth):
        right = x.gather(1, feature[node]) > limit[node]
        node = child[2 * node + right.long()]
    return value[node].sum(dim=1) + baseline
