"""Numbers that a scorer carries: buffers of a torch module, which its ONNX file will hold."""

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
