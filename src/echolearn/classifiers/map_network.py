"""A recipe for `Network`: convolutions on the map of J(tau, phi) about an echo.

The tensor is `localization.correlation_map`: `MAP_SECTORS` rows of azimuth with the echo in the
first of them and in the middle of their lags, the array's axis, and M microphones aligned at it.

- *Azimuth goes round.* Convolutions over (sector, lag) take the last sector for the first one's
  neighbour: the map is padded with itself. An echo that is seen in front of the robot and one
  behind it are then the same picture, turned.
- *The axis has no azimuth.* What arrives from above at a lag is a second channel at all sectors.
- *Microphones have no order.* All pass the same convolutions over lags; their mean and their
  variance go on. For a plane wave the variance is small: agreement, learned in place of a column.
- *The echo lies in the middle.* So each branch hands on what it finds there, beside the mean and
  the maximum over the whole map, which speak of the competitors.

Maps of other numbers of microphones or lags need no other settings.
"""

from dataclasses import dataclass

import torch
from torch import nn

from echolearn.checks import check, check_fields
from echolearn.localization.columns import MAP_SECTORS

RANGES = {"channels": (1, 256), "hidden": (1, 4096), "dropout": (0.0, 0.95)}
"""Least and largest value of each setting that is a number."""


@dataclass(frozen=True)
class MapNet:
    """Circular convolutions on a correlation map, and shared ones on its microphones.

    Attributes:
        channels: number of channels after the first convolutions; twice as many after the second.
        hidden: units of the layer that joins the branches.
        dropout: share of its inputs silenced in training.
    """

    channels: int = 8
    hidden: int = 64
    dropout: float = 0.2

    def __post_init__(self) -> None:
        check_fields("net", self, ranges=RANGES)

    def __call__(self, shape: tuple[int, ...]) -> nn.Module:
        """Return the network for rows of `shape`, (`MAP_SECTORS` + 1 + M, lags)."""
        allowed = "MapNet is for correlation_map; take Mlp for columns"
        fits = len(shape) == 2 and shape[0] > MAP_SECTORS + 1
        check(fits, "net", "MapNet", allowed=allowed)
        joined = nn.Linear(14 * self.channels, self.hidden)
        hidden = [nn.Dropout(self.dropout), joined, nn.GELU(), nn.Dropout(self.dropout)]
        head = nn.Sequential(*hidden, nn.Linear(self.hidden, 1), nn.Flatten(0))
        return Joined(Round(self.channels), Together(self.channels), head=head)


class Joined(nn.Module):
    """Both branches of a map, and a network on top."""

    def __init__(self, around: nn.Module, microphones: nn.Module, *, head: nn.Module) -> None:
        """Join both.

        Args:
            around: branch of azimuths.
            microphones: branch of microphones.
            head: from what both find to logits.
        """
        super().__init__()
        self.around = around
        self.microphones = microphones
        self.head = head

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, `MAP_SECTORS` + 1 + M, lags) to logits (B,)."""
        level = x[:, :MAP_SECTORS]
        axis = x[:, MAP_SECTORS : MAP_SECTORS + 1].expand_as(level)
        found = [
            self.around(torch.stack([level, axis], dim=1)),
            self.microphones(x[:, MAP_SECTORS + 1 :]),
        ]
        logit: torch.Tensor = self.head(torch.cat(found, dim=1))
        return logit


class Round(nn.Module):
    """Convolutions over (sector, lag), round in azimuth."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        wide = 2 * channels
        self.first = nn.Conv2d(2, channels, (3, 5), stride=(1, 2), padding=(0, 2))
        self.second = nn.Conv2d(channels, wide, 3, stride=2, padding=(0, 1))
        self.third = nn.Conv2d(wide, wide, 3, padding=(0, 1))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, 2, sectors, lags) to (B, 8 * channels): the echo, its sector, mean, maximum."""
        for layer in (self.first, self.second, self.third):
            x = nn.functional.gelu(layer(goes_round(x)))
        # Strides keep the echo in the middle of the lags and in the first sector.
        middle = x.shape[3] // 2
        parts = [x[:, :, 0, middle], x[:, :, 0].amax(dim=2), x.mean(dim=(2, 3)), x.amax(dim=(2, 3))]
        return torch.cat(parts, dim=1)


def goes_round(x: torch.Tensor) -> torch.Tensor:
    """Return maps (B, C, sectors, lags) with the last sector before and the first one behind."""
    return torch.cat([x[:, :, -1:], x, x[:, :, :1]], dim=2)


class Together(nn.Module):
    """The same convolutions over lags for each microphone, and what they agree on."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        wide = 2 * channels
        self.first = nn.Conv1d(1, channels, 7, stride=2, padding=3)
        self.second = nn.Conv1d(channels, channels, 5, padding=2)
        self.third = nn.Conv1d(wide, wide, 5, padding=2)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, M, lags) to (B, 6 * channels): the echo, mean and maximum."""
        rows, microphones, lags = x.shape
        each = nn.functional.gelu(self.first(x.reshape(-1, 1, lags)))
        each = nn.functional.gelu(self.second(each))
        each = each.reshape(rows, microphones, *each.shape[1:])
        # Mean and variance have no order of microphones, and take any number of them.
        mean = each.mean(dim=1)
        spread = (each - mean[:, None]).square().mean(dim=1)
        found = nn.functional.gelu(self.third(torch.cat([mean, spread], dim=1)))
        parts = [found[:, :, found.shape[2] // 2], found.mean(dim=2), found.amax(dim=2)]
        return torch.cat(parts, dim=1)
