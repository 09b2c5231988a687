"""Gradient-boosted trees on binned columns (Friedman 2001; scikit-learn's histogram version).

    d(x) = d_0 + sum_t v_t[leaf of x in tree t],     a logit

Trees need no scaling and judge any mixture of units; they stop growing in number when the
validation loss does.
The scorer walks all trees at once: one node index per row and tree, moved `depth` times by gathers.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from sklearn.ensemble import HistGradientBoostingClassifier
from torch.nn.functional import embedding

from echolearn.acoustics.types import Array
from echolearn.checks import check_number, check_whole
from echolearn.classifiers.inputs import FEATURES, Inputs, as_input, check_inputs, check_labels


@dataclass
class Trees:
    """Histogram gradient boosting.

    Attributes:
        inputs: column names.
        iterations: at most this many trees.
        learning_rate: shrinkage of each tree.
        leaves: at most this many per tree.
        depth: of a tree, at most.
        min_leaf: rows in a leaf, at least.
        l2: ridge penalty on the leaves' values.
        patience: stop when the validation loss has not fallen for this many trees.
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

    def __post_init__(self) -> None:
        self.inputs = check_inputs(self.inputs)
        check_whole("classifier.iterations", self.iterations, low=1, high=5000)
        check_number("classifier.learning_rate", self.learning_rate, low=1e-4, high=1.0)
        check_whole("classifier.leaves", self.leaves, low=2, high=1000)
        check_whole("classifier.depth", self.depth, low=1, high=20)
        check_whole("classifier.min_leaf", self.min_leaf, low=1)
        check_number("classifier.l2", self.l2, low=0.0, high=1e6)
        check_whole("classifier.patience", self.patience, low=1, high=5000)

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
        """Add trees until the validation loss stops falling; see `Classifier.fit`."""
        x = as_input(x, self.inputs).astype(float)
        self.model = HistGradientBoostingClassifier(
            max_iter=self.iterations,
            learning_rate=self.learning_rate,
            max_leaf_nodes=self.leaves,
            max_depth=self.depth,
            min_samples_leaf=self.min_leaf,
            l2_regularization=self.l2,
            early_stopping=True,
            n_iter_no_change=self.patience,
            random_state=seed,
        )
        x_validation, y_validation = (
            as_input(validation[0], self.inputs).astype(float),
            np.asarray(validation[1]),
        )
        self.model.fit(
            x, check_labels(y, len(x)), X_val=x_validation, y_val=y_validation.astype(bool)
        )
        return self

    def decision(self, x: Inputs) -> Array:
        """Return the logit, shape (B,)."""
        logit: Array = self.model.decision_function(as_input(x, self.inputs).astype(float))
        return logit

    def scorer(self) -> torch.nn.Module:
        """Return the trees as a torch module."""
        return Forest(
            [round_[0].nodes for round_ in self.model._predictors],
            float(self.model._baseline_prediction[0, 0]),
        )


class Forest(torch.nn.Module):
    """Binary trees, all walked together; a leaf is a node whose children are itself."""

    def __init__(self, trees: list[Any], baseline: float) -> None:
        super().__init__()
        self.depth = max(int(nodes["depth"].max()) for nodes in trees)
        starts = np.cumsum([0] + [len(nodes) for nodes in trees])
        nodes = np.concatenate(trees)
        leaf, here = nodes["is_leaf"].astype(bool), np.arange(len(nodes))
        first = np.repeat(starts[:-1], np.diff(starts))
        children = np.where(
            leaf[:, None],
            here[:, None],
            first[:, None] + np.stack([nodes["left"], nodes["right"]], axis=1),
        )
        self.register_buffer("root", torch.tensor(starts[None, :-1]))
        self.register_buffer("child", torch.tensor(children.reshape(-1, 1)))
        self.register_buffer(
            "feature", torch.tensor(np.where(leaf, 0, nodes["feature_idx"])[:, None])
        )
        self.register_buffer(
            "limit", torch.tensor(np.where(leaf, 0.0, nodes["num_threshold"])[:, None])
        )
        self.register_buffer("value", torch.tensor(np.where(leaf, nodes["value"], 0.0)[:, None]))
        self.register_buffer("baseline", torch.tensor(baseline, dtype=torch.float64))

    def look_up(self, table: str, node: torch.Tensor) -> torch.Tensor:
        """Return the entries of a table at nodes (B, T); an embedding, because that exports to one
        plain gather.
        """
        return embedding(node, self.get_buffer(table)).squeeze(2)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, K) to (B,)."""
        x = x.double()
        node = self.get_buffer("root") + torch.zeros_like(x[:, :1], dtype=torch.int64)
        for _ in range(self.depth):
            right = x.gather(1, self.look_up("feature", node)) > self.look_up("limit", node)
            node = self.look_up("child", 2 * node + right.long())
        return self.look_up("value", node).sum(dim=1) + self.get_buffer("baseline")
