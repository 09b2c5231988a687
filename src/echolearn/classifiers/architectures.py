"""Networks from standardised inputs to one logit.

A recipe is a small checked value that makes a network once the shape of a row is known:
`recipe(shape)` returns a `torch.nn.Module` that maps (B, *shape) float32 to logits (B,). To try
another architecture, write another recipe.

`CovarianceNet` serves four tensors. On the covariance of the whole recording (`covnet`) it is the
baseline of the literature, which estimates directions from such covariances; the echo is a small
part of what it sees. On that of the matched filters around an echo (`covnet_gated`, and steered to
it, `covnet_steered`) it sees coherence alone, and takes a side lobe of a louder echo, as coherent
as an echo, for one. Beside an ideal echo (`covnet_ideal`, see `localization.tensors`) it can tell
both.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import nn

from echolearn.checks import check, check_fields, check_list, check_whole


class Recipe(Protocol):
    """What makes a network.

    A recipe may also have `scale(x)`, which returns the module from raw training inputs (B, *shape)
    to what the network is given; without it each entry is standardised by itself.
    """

    def __call__(self, shape: tuple[int, ...]) -> nn.Module:
        """Return the network for rows of `shape`: (B, *shape) float32 to logits (B,)."""


RANGES = {
    "channels": (1, 4096),
    "layers": (0, 20),
    "kernel": (1, 255),
    "dropout": (0.0, 0.95),
}
"""Least and largest value of each setting that is a number."""


@dataclass(frozen=True)
class Mlp:
    """Fully connected layers on K columns.

    Attributes:
        widths: widths of the hidden layers.
        dropout: share of hidden units silenced in training.
    """

    widths: Sequence[int] = (64, 64)
    dropout: float = 0.1

    def __post_init__(self) -> None:
        check_list("net.widths", self.widths, allowed="must be a list of widths, [64,64]")
        check(len(self.widths) > 0, "net.widths", "[]", allowed="must have at least one width")
        for width in self.widths:
            check_whole("net.widths", width, low=1, high=65536)
        check_fields("net", self, ranges=RANGES)

    def __call__(self, shape: tuple[int, ...]) -> nn.Module:
        """Return the network for rows of `shape`, (K,)."""
        allowed = "Mlp is for columns; take CovarianceNet for a tensor"
        check(len(shape) == 1, "net", "Mlp", allowed=allowed)
        layers: list[nn.Module] = []
        before = shape[0]
        for width in self.widths:
            layers += [nn.Linear(before, width), nn.GELU(), nn.Dropout(self.dropout)]
            before = width
        return nn.Sequential(*layers, nn.Linear(before, 1), nn.Flatten(0))


@dataclass(frozen=True)
class CovarianceNet:
    """Convolutions along frequency on the entries of a spatial covariance.

    An echo is a plane wave: the phases between microphones turn steadily with frequency. So the
    M * M real entries of a band are channels, mixed within the band first, then over neighbouring
    bands; mean and maximum over all bands feed the logit, whatever their number.

    Attributes:
        channels: number of channels after the first mixing.
        layers: number of convolutions over bands.
        kernel: width of each in bands, odd.
        dropout: share of pooled units silenced in training.
    """

    channels: int = 32
    layers: int = 2
    kernel: int = 5
    dropout: float = 0.2

    def __post_init__(self) -> None:
        check_fields("net", self, ranges=RANGES)
        check(self.kernel % 2 == 1, "net.kernel", self.kernel, allowed="must be odd")

    def __call__(self, shape: tuple[int, ...]) -> nn.Module:
        """Return the network for rows of `shape`, (bands, M * M)."""
        allowed = "CovarianceNet is for a tensor; take Mlp for columns"
        check(len(shape) == 2, "net", "CovarianceNet", allowed=allowed)
        width = self.channels
        bands: list[nn.Module] = [nn.Conv1d(shape[1], width, 1), nn.GELU()]
        for _ in range(self.layers):
            # As many bands after a convolution as before it, however few they are.
            bands += [nn.Conv1d(width, width, self.kernel, padding=self.kernel // 2), nn.GELU()]
        hidden = [nn.Dropout(self.dropout), nn.Linear(2 * width, width), nn.GELU()]
        head = nn.Sequential(*hidden, nn.Linear(width, 1), nn.Flatten(0))
        return Pooled(nn.Sequential(*bands), head)


class Pooled(nn.Module):
    """A network over bands, mean and maximum over them, and a network on top."""

    def __init__(self, bands: nn.Module, head: nn.Module) -> None:
        super().__init__()
        self.bands = bands
        self.head = head

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, bands, M * M) to logits (B,)."""
        over_bands = self.bands(x.transpose(1, 2))
        pooled = torch.cat([over_bands.mean(dim=2), over_bands.amax(dim=2)], dim=1)
        logit: torch.Tensor = self.head(pooled)
        return logit
