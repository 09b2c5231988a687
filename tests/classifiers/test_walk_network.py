"""The network of whole walks: what must not change its verdict, and what it may learn."""

import numpy as np
import torch

from echolearn.classifiers.batches import Batches
from echolearn.classifiers.inputs import LARGEST_WALK, parts_of, walks_in
from echolearn.classifiers.methods.network import Network
from echolearn.classifiers.walk_network import WalkNet
from echolearn.localization.columns import STRIP_DIRECTIONS, STRIP_ENTRIES, STRIP_LAGS
from refusals import refused


def strips(*sizes, poses=5, seed=0):
    """Return strips of noise of walks with so many hypotheses each, marked as sets mark them."""
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(sum(sizes), poses, STRIP_ENTRIES)).astype(np.float32)
    x[..., 0] = 0.0
    numbers = np.repeat(np.arange(len(sizes)), sizes) + 2047
    x[:, :2, 0] = np.stack(np.divmod(numbers, 2048), axis=1)
    return x


def network(**settings):
    """Return an untrained network whose hypotheses do look at each other."""
    torch.manual_seed(1)
    given = {"channels": 3, "width": 8, "heads": 2} | settings
    return WalkNet(**given)((2, STRIP_ENTRIES)).eval()


def logits(net, x):
    with torch.no_grad():
        return net(torch.from_numpy(np.ascontiguousarray(x))).numpy()


def test_other_walks_change_nothing_and_hypotheses_of_the_same_one_do():
    net, x = network(), strips(3, 4, 2)
    whole = logits(net, x)
    alone = [logits(net, x[rows]) for rows in (slice(0, 3), slice(3, 7), slice(7, 9))]
    np.testing.assert_allclose(whole, np.concatenate(alone), atol=1e-6)
    changed = x.copy()
    changed[0, :, 1:] += 3.0
    moved = np.abs(logits(net, changed) - whole)
    assert moved[:3].min() > 1e-4 and moved[3:].max() < 1e-6
    # Without rounds each stands by itself.
    single = network(rounds=0)
    moved = np.abs(logits(single, changed) - logits(single, x))
    assert moved[0] > 1e-4 and moved[1:].max() < 1e-6


def test_hypotheses_have_no_order_and_poses_without_anything_weigh_nothing():
    net, x = network(), strips(4)
    turned = x[[2, 0, 3, 1]]
    np.testing.assert_allclose(logits(net, turned), logits(net, x)[[2, 0, 3, 1]], atol=1e-6)
    longer = np.concatenate([x, np.zeros((4, 30, STRIP_ENTRIES), np.float32)], axis=1)
    np.testing.assert_allclose(logits(net, longer), logits(net, x), atol=1e-6)
    # Nobody heard anything: still a number.
    assert np.isfinite(logits(net, np.zeros_like(x))).all()


def test_in_training_only_poses_are_left_out_that_have_nothing():
    net = network(dropout=0.0, left_out=0.0).train()
    x = strips(4)
    x[:, 3:, 1:] = 0.0
    # The same from either side, as it may be turned round.
    sides = x[..., 1:].reshape(4, 5, STRIP_LAGS, STRIP_DIRECTIONS)
    sides += sides[..., ::-1].copy()
    with torch.no_grad():
        found = net(torch.from_numpy(x)).numpy()
    np.testing.assert_allclose(found, logits(net.eval(), x), atol=1e-6)


def test_lags_and_directions_lie_as_sets_store_them():
    """A line at one direction is seen by one channel of the first convolutions."""
    net = network(rounds=0)
    x = np.zeros((1, 2, STRIP_LAGS, STRIP_DIRECTIONS), np.float32)
    x[..., 2] = 1.0
    row = np.concatenate([np.zeros((1, 2, 1), np.float32), x.reshape(1, 2, -1)], axis=2)
    with torch.no_grad():
        net.pooled.joined[0].weight[:, :28] = 0.0
    base = logits(net, row)
    with torch.no_grad():
        net.poses.first.weight[:, [0, 1, 3, 4, 5, 6]] += 1.0
        assert np.allclose(logits(net, row), base)
        net.poses.first.weight[:, 2] += 1.0
        assert not np.allclose(logits(net, row), base)


def test_the_default_has_less_than_300_000_weights():
    net = WalkNet()((2, STRIP_ENTRIES))
    assert sum(weight.numel() for weight in net.parameters()) < 300_000


def test_no_block_and_no_batch_parts_a_walk():
    sizes = (60, 60, 20, 100, 1, 80)
    x = strips(*sizes, poses=2)
    walk = np.repeat(np.arange(len(sizes)), sizes)
    assert np.array_equal(walks_in(x), walk)
    blocks = list(parts_of(x, 10**6, together=True))
    assert np.array_equal(np.concatenate(blocks), x)
    assert [len(block) for block in blocks] == [120, 121, 80] and LARGEST_WALK == 128
    batches = Batches(torch.from_numpy(x).__getitem__, walk > 2, size=100, seed=0, walks=walk)
    seen = [part[:, :2, 0] for part, _ in batches]
    assert len(seen) == 3 and sum(map(len, seen)) == len(x)
    kinds = [{tuple(mark) for mark in part.tolist()} for part in seen]
    assert sum(map(len, kinds)) == len(set().union(*kinds)) == len(sizes)


def test_settings_that_do_not_fit_are_refused():
    with refused("net.width=10: must be a multiple of heads=4"):
        WalkNet(width=10)
    with refused("net=WalkNet: WalkNet is for strips"):
        WalkNet()((16, 36))


def test_noise_would_part_every_walk_and_is_refused():
    with refused("classifier.noise=0.1: must be 0 for strips"):
        Network(("strips",), WalkNet(), noise=0.1)
