"""The images of `Images` summed by torch, on a GPU where there is one: for rooms with millions.

The kernels, and so the errors, are those of `simulation.image_loops`: images are spread onto a grid
at twice the rate with the taps of psi, the filter q turns psi into phi.

A GPU adds in any order, and a sum of floating-point numbers depends on its order. So each addend is
rounded to a whole multiple of 2^-44 (-265 dB of an echo at one sample's distance): whole numbers
add up to the same sum in any order, so a device gives the same bytes each time. Those of another
device may differ in the last bits, and those of `Images`, which sums in single precision, do; a
set is made on one kind of device, then. On a GPU it pays from about a million images on.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from echolearn.acoustics.polygon_room import AnyRoom
from echolearn.acoustics.types import Array
from echolearn.checks import check_choice
from echolearn.simulation.responses import check_placement, response_length
from echolearn.simulation.rir.images import lattice
from echolearn.simulation.torch_device import check_device

if TYPE_CHECKING:
    import torch

UNIT = 2.0**-44
"""What sums are whole multiples of; the largest addend, at 1 mm, has 2^47 of them."""

BLOCK = 1 << 21
"""Images that are computed at a time, which take about 200 MB."""


@dataclass(frozen=True)
class TorchImages:
    """Compute responses by spreading images with torch.

    Attributes:
        device: what computes, "cuda" or "cpu".
    """

    device: str = "cuda"

    def __post_init__(self) -> None:
        check_choice("rir.device", self.device, "cuda", "cpu")

    def __call__(
        self,
        room: AnyRoom,
        source: Array,
        *,
        microphones: Array,
        sample_rate: float,
        speed_of_sound: float,
    ) -> Array:
        """Return responses, shape (M, K); arguments as those of `simulation.scene.Responder`."""
        # Both take long to import, and most who load this module call it never.
        from scipy.signal import fftconvolve

        from echolearn.simulation import image_loops

        check_placement(
            room,
            source,
            microphones=microphones,
            sample_rate=sample_rate,
            speed_of_sound=speed_of_sound,
        )
        hint = "without a GPU rir=images is the fast one"
        check_device("rir.device", self.device, hint=hint)
        length = response_length(room, sample_rate)
        scale = 2 * sample_rate / speed_of_sound
        reach = 2.0 * (length + image_loops.REACH)
        reflection = room.reflection(speed_of_sound)
        axes = lattice(
            room, source, microphones=microphones, scale=scale, reflection=reflection, reach=reach
        )
        q = image_loops.correction().astype(float)
        grid = self._spread(axes, size=2 * length + len(q) + image_loops.TAPS, reach=reach)
        # response(n) = sum over j of q(j) grid(2 n + j)
        response = fftconvolve(grid, q[None, ::-1], axes=-1)[:, len(q) - 1 :: 2][:, :length]
        return np.ascontiguousarray(response) * (scale / (4 * np.pi))

    def _spread(self, axes: tuple[Array, Array, Array], *, size: int, reach: float) -> Array:
        """Return the grid, shape (M, size), onto which all images within reach are spread.

        Args:
            axes: for each axis the squared offsets and reflection products, shape (M, 2, K).
            size: samples of the grid.
            reach: largest distance, in samples of the grid.
        """
        import torch

        from echolearn.simulation.image_loops import kernel_table

        x, y, z = (torch.from_numpy(axis).to(self.device) for axis in axes)
        # Blocks are cut from the first axis, which has to be a long one; the sum stays the same.
        if x.shape[-1] < y.shape[-1]:
            x, y = y, x
        table = torch.from_numpy(kernel_table().astype(float)).to(self.device)
        grid = torch.zeros(len(x) * size, dtype=torch.int64, device=self.device)
        step = max(1, BLOCK // (len(x) * y.shape[-1] * z.shape[-1]))
        for start in range(0, x.shape[-1], step):
            block = x[..., start : start + step]
            _add(grid.view(len(x), size), (block, y, z), table=table, reach=reach)
        whole: Array = grid.cpu().numpy().reshape(len(x), size)
        return whole * UNIT


def _add(
    grid: "torch.Tensor",
    axes: "tuple[torch.Tensor, torch.Tensor, torch.Tensor]",
    *,
    table: "torch.Tensor",
    reach: float,
) -> None:
    """Add psi to the grid for a block of images.

    Args:
        grid: whole multiples of `UNIT`, shape (M, size).
        axes: as of `TorchImages._spread`, some of the images along the first.
        table: psi and its slope for each step of the fractional delay, shape (STEPS, 2 TAPS).
        reach: largest distance, in samples of the grid.
    """
    from echolearn.simulation.image_loops import REACH, STEPS, TAPS

    x, y, z = axes
    square = x[:, 0, :, None, None] + y[:, 0, None, :, None] + z[:, 0, None, None, :]
    product = x[:, 1, :, None, None] * y[:, 1, None, :, None] * z[:, 1, None, None, :]
    near = square <= reach * reach
    microphone = near.nonzero()[:, 0]
    delay = square[near].sqrt()
    weight = product[near] / delay / UNIT

    steps = (delay * STEPS).floor()
    part = delay * STEPS - steps
    row = steps.long() % STEPS
    # Time 0 is where the middle of q stands, and psi begins TAPS / 2 - 1 samples before a delay.
    at = microphone * grid.shape[1] + steps.long() // STEPS + (2 * REACH - TAPS // 2 + 1)
    for tap in range(TAPS):
        slope = part * table[row, TAPS + tap]
        addend = (weight * (table[row, tap] + slope)).round().long()
        grid.view(-1).index_add_(0, at + tap, addend)
