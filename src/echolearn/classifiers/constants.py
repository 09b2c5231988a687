"""Scorers as a formula and its numbers: buffers of a torch module, which its ONNX file holds."""

from collections.abc import Callable
from typing import Any

import numpy as np
import torch


def register_constants(module: torch.nn.Module, **values: Any) -> None:
    """Register numbers or arrays as buffers of a module, floats in float64.

    Args:
        module: module that gets an attribute for each of them.
        values: constants by name.
    """
    for name, value in values.items():
        module.register_buffer(name, torch.from_numpy(np.array(value, order="C")))


class Formula(torch.nn.Module):
    """A function of x and of constants: `formula(x, **constants)`."""

    def __init__(self, formula: Callable[..., torch.Tensor], **constants: Any) -> None:
        super().__init__()
        self.formula = formula
        register_constants(self, **constants)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Return the function's value."""
        return self.formula(x, **dict(self.named_buffers()))
