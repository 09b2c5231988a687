"""A network that is trained on: the weights of its run, behind the scaler they were learned with.

A run's weights are no part of what its checksums prove, so they are proved by what they compute:
with scaler and calibration the confidences of the run's ONNX file.
"""

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load
from torch import nn

from echolearn.acoustics.types import PARITY
from echolearn.checks import BadValue, check
from echolearn.classifiers.earlier import EarlierFilter, Learned

LOOKED_AT = 256
"""Rows on which the weights are proved, at most."""


def learned_by(earlier: EarlierFilter | None) -> Learned | None:
    """Return what a network is trained on from, if it is."""
    return None if earlier is None or earlier.learned is None else earlier.learned()


def go_on(net: nn.Module, *, scale: nn.Module, earlier: EarlierFilter, learned: Learned) -> None:
    """Give a network the weights of its run.

    Args:
        net: new, of the run's shape.
        scale: scaler of the rows that the run was trained on.
        earlier: the run.
        learned: what it has learned.

    Raises:
        BadValue: a network of other layers, or weights that are not those of the run's model.
    """
    name = f"init={earlier.told['name']}"
    try:
        weights = load(learned.weights)
        net.load_state_dict(weights)
    except SafetensorError:
        raise BadValue(f"{name}: its best.safetensors is damaged; train it again") from None
    except RuntimeError:
        allowed = "must be a run of this network, of the same layers"
        raise BadValue(f"{name}: {allowed}; did classifier.net change?") from None
    some = np.asarray(learned.rows[:LOOKED_AT])
    with torch.no_grad():
        decision = nn.Sequential(scale, net).eval()(torch.from_numpy(some)).double().numpy()
    net.train()
    difference = float(np.abs(learned.mapping(decision) - earlier.compute(some)).max())
    shown = f"best.safetensors differs by {difference:.2g}"
    hint = "is it damaged? train it again"
    check(difference <= PARITY, name, shown, allowed="must compute what model.onnx does", hint=hint)
