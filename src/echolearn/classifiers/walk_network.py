"""A recipe for `Network`: all wall hypotheses of a walk together.

The tensor is `strips` (`dataset.hypothesis_records`): what each of N poses heard around a
hypothesis, J over lags and directions, and a mark of the walk it is of.

    h_p = convolutions over the lags of pose p, then over neighbouring poses    a bright line?
    e_w = sum_p (max_|l|<=w J_p(l) - m_w) / sqrt(N)                             evidence
    t   = (e, sum_p a_p h_p, sum_p h_p / sqrt(N), max_p h_p),  a = softmax(w . h)
    t_k = t_k + sum_l softmax_l(q_k . k_l / sqrt(d)) v_l,   l of the walk of k  its rivals
    logit_k = rho(t_k)

- *A pose's lags are shifted by its error*, so what looks at them must not mind where the line is:
  convolutions, in which directions are channels.
- *Evidence* is handed on beside them, as thresholds and trees have it (`walls.evidence`): it takes
  many walks to learn a sum that is known.
- *Neighbouring poses err alike* where odometry drifts, and a wall goes on from one to the next.
- *Any number of poses*: of those that have the hypothesis in their window; a pose that has not is
  all zeros and weighs nothing.
- *Hypotheses attend to those of their own walk* (Vaswani et al., NeurIPS 2017, without places,
  since they have no order): a walk's noise, its reverberation and its odometry are shared, one
  wall leaves several hypotheses, and the strongest tell what a wall sounds like here. Where they
  lie is not told: that would be the leak of `walls.strips`.

Rows of other walks in a batch change nothing, whatever their number. In training, a part of the
poses is left out anew each time, and directions are turned round: a walk of fewer poses, and the
mirror image of a walk, are walks as well.
"""

from dataclasses import dataclass

import torch
from torch import nn

from echolearn.checks import check, check_fields
from echolearn.classifiers.inputs import Inputs
from echolearn.localization.columns import STRIP_DIRECTIONS, STRIP_ENTRIES, STRIP_LAGS

RANGES = {
    "channels": (1, 64),
    "width": (4, 256),
    "heads": (1, 4),
    "rounds": (0, 4),
    "dropout": (0.0, 0.95),
    "left_out": (0.0, 0.95),
}
"""Least and largest value of each setting that is a number."""

LOUDEST = 16.0
"""J beyond which all is as loud; the matched filters of a pose rarely reach 12."""

WIDTHS = {0: 0.0, 2: 0.9, 6: 1.5, 12: 1.9}
"""Lags within which evidence looks for an echo, and what noise has there, to begin with."""

NOWHERE = -1e9
"""Score of what must not weigh: far below any other."""


@dataclass(frozen=True)
class WalkNet:
    """Convolutions on strips, attention over poses, attention over the hypotheses of a walk.

    Attributes:
        channels: channels of the convolutions over lags.
        width: numbers that tell of a pose, and of a hypothesis.
        heads: ways in which hypotheses attend to each other at once; they share `width`.
        rounds: how often they attend; 0 looks at each hypothesis by itself.
        dropout: share of hidden units silenced in training.
        left_out: share of the poses left out in training, at most.
    """

    channels: int = 8
    width: int = 32
    heads: int = 4
    rounds: int = 2
    dropout: float = 0.2
    left_out: float = 0.5

    def __post_init__(self) -> None:
        check_fields("net", self, ranges=RANGES)
        allowed = f"must be a multiple of heads={self.heads}, which share it"
        check(self.width % self.heads == 0, "net.width", self.width, allowed=allowed)

    def __call__(self, shape: tuple[int, ...]) -> nn.Module:
        """Return the network for rows of `shape`, (poses, `STRIP_ENTRIES`)."""
        allowed = "WalkNet is for strips; take Mlp for columns"
        check(len(shape) == 2 and shape[1] == STRIP_ENTRIES, "net", "WalkNet", allowed=allowed)
        return Judging(self)

    def scale(self, x: Inputs) -> nn.Module:
        """Return the map to standardised inputs: J is in units of its pose as it comes."""
        return nn.Identity()


class Judging(nn.Module):
    """See `WalkNet`."""

    def __init__(self, net: WalkNet) -> None:
        super().__init__()
        self.left_out = net.left_out
        self.evidence = PoseSums()
        self.poses = PoseEncoder(net)
        self.pooled = PosePooling(net)
        self.rounds = nn.ModuleList(AmongWalk(net) for _ in range(net.rounds))
        self.head = nn.Sequential(nn.LayerNorm(net.width), nn.Linear(net.width, 1), nn.Flatten(0))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, poses, entries) to logits (B,)."""
        strip = x[..., 1:].clamp(-LOUDEST, LOUDEST)
        seen = (strip != 0.0).any(dim=2, keepdim=True).to(strip.dtype)
        if self.training:
            # Poses that see nothing of any of these stand last: they need not be computed.
            last = int(seen.amax(dim=(0, 2)).nonzero().max()) + 1 if bool(seen.any()) else 1
            strip, seen = self._varied(strip[:, :last], seen[:, :last])
        evidence = self.evidence(strip, seen)
        found = self.pooled(self.poses(strip, seen), seen, evidence=evidence)

        # The walk's number is written into the first two poses; where it changes, a walk ends.
        mark = x[:, :2, 0]
        before = torch.cat([mark[:1], mark[:-1]])
        walk = (mark != before).any(dim=1).to(torch.int64).cumsum(dim=0)
        same = walk[:, None] == walk[None]
        for attend in self.rounds:
            found = attend(found, same)
        logit: torch.Tensor = self.head(found)
        return logit

    def _varied(self, strip: torch.Tensor, seen: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return strips and what is seen of them, as another walk might have had them."""
        share = self.left_out * torch.rand(len(strip), 1, 1)
        kept = (torch.rand(seen.shape) >= share).to(seen)
        sides = strip.reshape(*strip.shape[:2], STRIP_LAGS, STRIP_DIRECTIONS)
        turned = (torch.rand(len(strip), 1, 1) < 0.5).to(strip.device)
        strip = torch.where(turned, sides.flip(3).flatten(2), strip)
        return strip * kept, seen * kept


class PoseSums(nn.Module):
    """The sums over poses that thresholds go by: for each width and direction."""

    def __init__(self) -> None:
        super().__init__()
        self.floor = nn.Parameter(torch.tensor([[floor] for floor in WIDTHS.values()]))

    def forward(self, strip: torch.Tensor, seen: torch.Tensor) -> torch.Tensor:
        """Map (B, poses, lags * directions) to (B, widths * directions).

        Args:
            strip: J, 0 where a pose has nothing.
            seen: 1 where it has something, shape (B, poses, 1).
        """
        sides = strip.reshape(*strip.shape[:2], STRIP_LAGS, STRIP_DIRECTIONS)
        middle = STRIP_LAGS // 2
        near = [sides[:, :, middle - w : middle + w + 1].amax(dim=2) for w in WIDTHS]
        over = (torch.stack(near, dim=2) - self.floor) * seen[..., None]
        poses = seen.sum(dim=1)[..., None].clamp(min=1.0)
        total = (over.sum(dim=1) / poses.sqrt()).flatten(1)
        # asinh, written out for ONNX: walls of a loud walk are a hundred times above faint ones.
        size = torch.log(total.abs() + (total.square() + 1.0).sqrt())
        return torch.sign(total) * size


class PoseEncoder(nn.Module):
    """What each pose heard, and its neighbours: `width` numbers a pose."""

    def __init__(self, net: WalkNet) -> None:
        super().__init__()
        channels = net.channels
        self.first = nn.Conv1d(STRIP_DIRECTIONS, channels, 5, stride=2, padding=2)
        self.second = nn.Conv1d(channels, 2 * channels, 5, stride=2, padding=2)
        left = (STRIP_LAGS + 3) // 4
        self.joined = nn.Linear(2 * channels * left, net.width)
        self.beside = nn.Conv1d(net.width, net.width, 5, padding=2)
        self.dropout = nn.Dropout(net.dropout)

    def forward(self, strip: torch.Tensor, seen: torch.Tensor) -> torch.Tensor:
        """Map strips (B, poses, lags * directions) to (B, poses, width).

        Args:
            strip: J, 0 where a pose has nothing.
            seen: 1 where it has something, shape (B, poses, 1).
        """
        rows, poses = strip.shape[:2]
        lags = strip.reshape(-1, STRIP_LAGS, STRIP_DIRECTIONS).transpose(1, 2)
        lags = nn.functional.gelu(self.first(lags))
        lags = nn.functional.gelu(self.second(lags)).flatten(1)
        each = nn.functional.gelu(self.joined(lags)).reshape(rows, poses, -1) * seen
        beside = self.beside(each.transpose(1, 2)).transpose(1, 2)
        found: torch.Tensor = self.dropout(each + nn.functional.gelu(beside)) * seen
        return found


class PosePooling(nn.Module):
    """What the poses that have a hypothesis in their window say together."""

    def __init__(self, net: WalkNet) -> None:
        super().__init__()
        self.weight = nn.Linear(net.width, 1)
        told = 3 * net.width + len(WIDTHS) * STRIP_DIRECTIONS
        joined = [nn.Linear(told, net.width), nn.GELU(), nn.Dropout(net.dropout)]
        self.joined = nn.Sequential(*joined, nn.Linear(net.width, net.width))

    def forward(
        self, each: torch.Tensor, seen: torch.Tensor, *, evidence: torch.Tensor
    ) -> torch.Tensor:
        """Map (B, poses, width) to (B, width).

        Args:
            each: what poses say, 0 where they have nothing.
            seen: 1 where they have something, shape (B, poses, 1).
            evidence: their sums, shape (B, widths * directions).
        """
        there = seen > 0.5
        scores = torch.where(there, self.weight(each), torch.full_like(seen, NOWHERE))
        attended = (torch.softmax(scores, dim=1) * each).sum(dim=1)
        total = each.sum(dim=1) / seen.sum(dim=1).clamp(min=1.0).sqrt()
        highest = torch.where(there, each, torch.full_like(each, NOWHERE)).amax(dim=1)
        highest = highest * seen.amax(dim=1)
        found: torch.Tensor = self.joined(torch.cat([evidence, attended, total, highest], dim=1))
        return found


class AmongWalk(nn.Module):
    """One round in which hypotheses look at those of their own walk."""

    def __init__(self, net: WalkNet) -> None:
        super().__init__()
        self.heads = net.heads
        self.before = nn.LayerNorm(net.width)
        self.asked = nn.Linear(net.width, 3 * net.width)
        self.told = nn.Linear(net.width, net.width)
        hidden = [nn.LayerNorm(net.width), nn.Linear(net.width, 2 * net.width), nn.GELU()]
        self.after = nn.Sequential(
            *hidden, nn.Dropout(net.dropout), nn.Linear(2 * net.width, net.width)
        )

    def forward(self, found: torch.Tensor, same: torch.Tensor) -> torch.Tensor:
        """Map (B, width) to the same shape.

        Args:
            found: what is known of each hypothesis.
            same: whether two are of one walk, shape (B, B).
        """
        rows, width = found.shape
        parts = self.asked(self.before(found)).reshape(rows, 3, self.heads, -1)
        query, key, value = parts.permute(1, 2, 0, 3)
        scores = query @ key.transpose(1, 2) / (width / self.heads) ** 0.5
        scores = torch.where(same, scores, torch.full_like(scores, NOWHERE))
        heard = (torch.softmax(scores, dim=2) @ value).transpose(0, 1).reshape(rows, -1)
        found = found + self.told(heard)
        result: torch.Tensor = found + self.after(found)
        return result
