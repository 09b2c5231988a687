"""A recipe for `Network`: attention of one echo to all others of its pose.

The tensor is `localization.candidates`: an echo, then those that were estimated beside it.

    h_q = phi(z_q),    a_q = softmax_q(w . tanh(U h_0 + V h_q)),
    logit = rho(h_0, sum_q a_q h_q, max_q h_q)

over the candidates q that there are. All pass the same layers phi, and the sum and the maximum have
no order (Zaheer et al., "Deep Sets", NeurIPS 2017; weights as in Bahdanau, Cho and Bengio,
ICLR 2015): so the network may learn that an echo is a second reflection of a
stronger one, that four walls agree on a room, or that all candidates of a recording are equally
weak, which none of them tells by itself. A candidate that is not there weighs nothing, and with one
echo a pose what is left is a network on columns.
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from echolearn.checks import check, check_fields
from echolearn.classifiers.inputs import Inputs
from echolearn.classifiers.standardise import standardiser

RANGES = {"width": (1, 1024), "dropout": (0.0, 0.95)}
"""Least and largest value of each setting that is a number."""


@dataclass(frozen=True)
class PoseNet:
    """An echo and its attention to the others of its pose.

    Attributes:
        width: units of every layer.
        dropout: share of hidden units silenced in training.
    """

    width: int = 48
    dropout: float = 0.1

    def __post_init__(self) -> None:
        check_fields("net", self, ranges=RANGES)

    def __call__(self, shape: tuple[int, ...]) -> nn.Module:
        """Return the network for rows of `shape`, (candidates, K)."""
        allowed = "PoseNet is for candidates; take Mlp for columns"
        check(len(shape) == 2, "net", "PoseNet", allowed=allowed)
        return Attending(shape[1], width=self.width, dropout=self.dropout)

    def scale(self, x: Inputs, *, rows: int = 4000) -> nn.Module:
        """Return the map to standardised inputs: a column is scaled alike at every candidate.

        Args:
            x: training inputs, shape (B, candidates, K).
            rows: at most this many, evenly spread, are looked at.
        """
        some = np.asarray(x[:: -(-len(x) // rows)])
        there = some[..., 0] > 0.5
        there[:, 0] = True
        return Present(standardiser(some[there], rows=some.size))


class Present(nn.Module):
    """Standardisation of the candidates that there are; of the others zeros are left."""

    def __init__(self, scale: nn.Module) -> None:
        super().__init__()
        self.scale = scale

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, candidates, K) to the same shape; the first entry stays 0 or 1."""
        # The echo itself is there whatever it says, so that there is something to attend to.
        itself = torch.ones_like(x[:, :1, :1])
        there = torch.cat([itself, (x[:, 1:, :1] > 0.5).float()], dim=1)
        return torch.cat([there, self.scale(x)[..., 1:] * there], dim=-1)


class Attending(nn.Module):
    """See `PoseNet`."""

    def __init__(self, columns: int, *, width: int, dropout: float) -> None:
        """Make one.

        Args:
            columns: numbers that tell of a candidate.
            width: units of every layer.
            dropout: share of hidden units silenced in training.
        """
        super().__init__()
        hidden = [nn.Linear(columns, width), nn.GELU(), nn.Dropout(dropout)]
        self.each = nn.Sequential(*hidden, nn.Linear(width, width), nn.GELU())
        self.own = nn.Linear(width, width)
        self.other = nn.Linear(width, width)
        self.weight = nn.Linear(width, 1)
        joined = [nn.Dropout(dropout), nn.Linear(3 * width, width), nn.GELU(), nn.Dropout(dropout)]
        self.head = nn.Sequential(*joined, nn.Linear(width, 1), nn.Flatten(0))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, candidates, K) to logits (B,)."""
        there = x[..., :1] > 0.5
        each = self.each(x)
        own = each[:, 0]
        pairs = torch.tanh(self.own(own)[:, None] + self.other(each))
        # Far below any score, so that what is not there weighs exactly nothing.
        scores = torch.where(there, self.weight(pairs), torch.full_like(pairs[..., :1], -1e9))
        attended = (torch.softmax(scores, dim=1) * each).sum(dim=1)
        highest = torch.where(there, each, torch.full_like(each, -1e9)).amax(dim=1)
        logit: torch.Tensor = self.head(torch.cat([own, attended, highest], dim=1))
        return logit
