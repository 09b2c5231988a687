"""Networks from standardised inputs to one logit.

A recipe is a small checked value that makes a network once the shape of a row is known:
    `recipe(shape)` returns a
`torch.nn.Module` that maps (B, *shape) float32 to logits (B,). To try another architecture, write
another recipe.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import nn

from echolearn.checks import check, check_number, check_whole


@dataclass(frozen=True)
class Mlp:
    """Fully connected layers on K columns.

    Attributes:
        widths: of the hidden layers.
        dropout: share of hidden units silenced in training.
    """

    widths: Sequence[int] = (64, 64)
    dropout: float = 0.1

    def __post_init__(self) -> None:
        listed = (
            isinstance(self.widths, Sequence)
            and not isinstance(self.widths, str)
            and len(self.widths) > 0
        )
        check(listed, "net.widths", self.widths, allowed="a list of widths")
        for width in self.widths:
            check_whole("net.widths", width, low=1, high=65536)
        check_number("net.dropout", self.dropout, low=0.0, high=0.95)

    def __call__(self, shape: tuple[int, ...]) -> nn.Module:
        """Return the network for rows of `shape`, (K,)."""
        check(
            len(shape) == 1, "net", "Mlp", allowed="CovarianceNet for a tensor; Mlp is for columns"
        )
        widths = [shape[0], *self.widths]
        layers: list[nn.Module] = []
        for before, after in zip(widths, widths[1:], strict=False):
            layers += [nn.Linear(before, after), nn.GELU(), nn.Dropout(self.dropout)]
        return nn.Sequential(*layers, nn.Linear(widths[-1], 1), nn.Flatten(0))


@dataclass(frozen=True)
class CovarianceNet:
    """Convolutions along frequency on the entries of a spatial covariance.

    An echo is a plane wave: the phases between microphones turn steadily with frequency. So the M *
        M real entries
    of a band are channels, mixed within the band first, then over neighbouring bands; mean and
    maximum over all bands feed the logit, whatever their number.

    Attributes:
        channels: after the first mixing.
        layers: convolutions over bands.
        kernel: width of each in bands, odd.
        dropout: share of pooled units silenced in training.
    """

    channels: int = 32
    layers: int = 2
    kernel: int = 5
    dropout: float = 0.2

    def __post_init__(self) -> None:
        check_whole("net.channels", self.channels, low=1, high=4096)
        check_whole("net.layers", self.layers, low=0, high=20)
        check_whole("net.kernel", self.kernel, low=1, high=255)
        check(self.kernel % 2 == 1, "net.kernel", self.kernel, allowed="an odd width")
        check_number("net.dropout", self.dropout, low=0.0, high=0.95)

    def __call__(self, shape: tuple[int, ...]) -> nn.Module:
        """Return the network for rows of `shape`, (bands, M * M)."""
        check(
            len(shape) == 2,
            "net",
            "CovarianceNet",
            allowed="Mlp for columns; CovarianceNet is for a tensor",
        )
        width = self.channels
        bands: list[nn.Module] = [nn.Conv1d(shape[1], width, 1), nn.GELU()]
        for _ in range(self.layers):
            bands += [nn.Conv1d(width, width, self.kernel, padding=self.kernel // 2), nn.GELU()]
        head = [
            nn.Dropout(self.dropout),
            nn.Linear(2 * width, width),
            nn.GELU(),
            nn.Linear(width, 1),
            nn.Flatten(0),
        ]
        return Pooled(nn.Sequential(*bands), nn.Sequential(*head))


class Pooled(nn.Module):
    """A network over bands, mean and maximum over them, and a network on top."""

    def __init__(self, bands: nn.Module, head: nn.Module) -> None:
        super().__init__()
        self.bands, self.head = bands, head

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (B, bands, M * M) to logits (B,)."""
        over_bands = self.bands(x.transpose(1, 2))
        logit: torch.Tensor = self.head(
            torch.cat([over_bands.mean(dim=2), over_bands.amax(dim=2)], dim=1)
        )
        return logit
