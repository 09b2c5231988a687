"""Networks of tensors: what they may not depend on, and how large they are."""

import time

import numpy as np
import pytest
import torch

from echolearn.classifiers.architectures import CovarianceNet
from echolearn.classifiers.map_network import MapNet
from echolearn.classifiers.pose_network import PoseNet
from echolearn.localization.columns import MAP_SECTORS, tensor_shape

RECIPES = {
    "covariance_steered_ideal": CovarianceNet(),
    "correlation_map": MapNet(),
    "candidates": PoseNet(),
}


def rows(name, count=3, microphones=6, seed=0):
    """Draw inputs of a tensor's shape."""
    drawn = np.random.default_rng(seed).normal(size=(count, *tensor_shape(name, microphones)))
    return torch.from_numpy(drawn.astype(np.float32))


def logits(net, x):
    with torch.no_grad():
        return net.eval()(x)


@pytest.mark.parametrize("name", RECIPES)
def test_a_network_is_small_and_fast(name):
    """Below 300 000 weights and a millisecond an echo, with as many microphones as rings have."""
    net = RECIPES[name](tensor_shape(name, 16))
    assert sum(weights.numel() for weights in net.parameters()) < 300_000
    x = rows(name, 1, 16)
    logits(net, x)
    began = time.process_time()
    for _ in range(20):
        logits(net, x)
    assert (time.process_time() - began) / 20 < 20e-3


def test_azimuth_goes_round_and_microphones_have_no_order():
    """Turned by two sectors, the step of the convolutions, a map has the same mean and maximum."""
    net = MapNet(channels=4, hidden=8)(tensor_shape("correlation_map", 6))
    x = rows("correlation_map")
    shuffled = x.clone()
    shuffled[:, MAP_SECTORS + 1 :] = x[:, MAP_SECTORS + 1 :].flip(1)
    assert torch.allclose(logits(net, shuffled), logits(net, x), atol=1e-5)

    level = x[:, None, :MAP_SECTORS].repeat(1, 2, 1, 1)
    whole = logits(net.around, level)[:, -16:]
    assert torch.allclose(logits(net.around, level.roll(6, dims=2))[:, -16:], whole, atol=1e-5)
    turned = logits(net.around, level.roll(6, dims=2))
    assert not torch.allclose(turned[:, :8], logits(net.around, level)[:, :8], atol=1e-3)


def test_candidates_have_no_order_and_those_that_are_not_there_say_nothing():
    recipe = PoseNet(width=8)
    x = rows("candidates", 50)
    x[:, :5, 0], x[:, 5:, 0] = 1.0, 0.0
    net = torch.nn.Sequential(recipe.scale(x.numpy()), recipe(tuple(x.shape[1:])))
    shuffled = x[:, [0, 6, 3, 5, 1, 2, 4, 7]]
    spoilt = x.clone()
    spoilt[:, 5:, 1:] = 77.0
    assert torch.allclose(logits(net, shuffled), logits(net, x), atol=1e-5)
    assert torch.allclose(logits(net, spoilt), logits(net, x), atol=1e-5)
    # Those that are there do.
    other = x.clone()
    other[:, 3, 1:] *= 2.0
    assert not torch.allclose(logits(net, other), logits(net, x), atol=1e-5)
