"""Matched filters by torch, held against the compiled ones."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from echolearn.acoustics import signals
from echolearn.acoustics.geometry import SearchWindow
from echolearn.acoustics.types import Observation
from echolearn.dataset.generate import folder_of, generate
from echolearn.dataset.plans import ScatteredPlan
from echolearn.dataset.records import recordings_of, records
from echolearn.dataset.torch_filters import filters_of
from echolearn.localization.localize import localize
from echolearn.localization.matched_filter import Filters, MatchedFilter
from echolearn.localization.methods.em import Em
from echolearn.localization.methods.gated import Gated
from echolearn.localization.methods.joint import Joint
from echolearn.localization.methods.snls import Snls
from echolearn.runtime.engines.serial import Serial
from echolearn.simulation import torch_device
from echolearn.simulation.rir.images import Images
from refusals import refused

WINDOW = SearchWindow()
LAGS = 156  # in the window


@pytest.fixture(scope="module")
def plan(brief):
    """Return 200 rows in low rooms, in which floor and ceiling are heard before the walls."""
    sizes = ((4.0, 4.0, 2.6), (6.0, 5.0, 3.0))
    about = {"snr_db": (-20.0, 40.0), "gain_db": (-10.0, 10.0), "further": ("cfar", "agreement")}
    robot = (WINDOW, replace(brief, rir=Images()), Gated(WINDOW, 36))
    return ScatteredPlan("low", 3, 200, *sizes, (0.2, 0.25), 1.0, *robot, **about)


@pytest.fixture(params=["cpu", "cuda"])
def device(request):
    """Return a device that is there."""
    if request.param == "cuda" and not torch_device.cuda_is_there():
        pytest.skip("not on this machine")
    return request.param


@pytest.mark.parametrize("nearest", [0.2, 1.0])
@pytest.mark.parametrize("count", [1, 70])
def test_torch_computes_the_compiled_filters(device, plan, nearest, count):
    """From 0.2 m on, some lags come before the emission."""
    rng = np.random.default_rng(count)
    scene = plan.scene
    samples = rng.standard_normal((count, 6, scene.probe.length)) * 10.0 ** rng.uniform(-4, 4)
    about = (Observation(samples, scene.probe, scene.array), SearchWindow(nearest, 2.0), 36)
    compiled = MatchedFilter(*about)
    found = MatchedFilter(*about, filters=filters_of(device))
    scale = np.abs(compiled.padded).max()
    assert_allclose(found.padded, compiled.padded, rtol=0, atol=1e-12 * scale)
    scale = np.abs(compiled.steered).max()
    assert_allclose(found.steered, compiled.steered, rtol=0, atol=1e-5 * scale)
    assert found.steered.dtype == np.float32


def test_sets_have_the_labels_of_compiled_ones_and_nearly_their_columns(device, plan):
    rows = range(len(plan))
    compiled, found = records(plan, rows), records(replace(plan, matched_filters=device), rows)
    assert found.dtype == compiled.dtype
    assert 20 < compiled["reflector"].sum() < 195
    for name in found.dtype.names:
        if found[name].dtype == bool:
            assert (found[name] == compiled[name]).all(), name
        most = 1e-5 * np.abs(np.nan_to_num(compiled[name].astype(float))).max()
        # Whether a value exceeds itself, read from a Fourier series, is a matter of the last bit.
        most = 1 / LAGS if name == "exceeded" else most
        assert_allclose(found[name], compiled[name], rtol=0, atol=most, err_msg=name)
    # In double precision nothing is lost at all.
    assert_allclose(found["score"], compiled["score"], rtol=1e-9)


def test_sets_of_either_are_told_apart_and_those_of_before_keep_their_name(plan, tmp_path):
    names = {folder_of(replace(plan, matched_filters=each), tmp_path) for each in ("cuda", "cpu")}
    assert len(names | {folder_of(plan, tmp_path)}) == 3
    # That of this plan before there was a choice.
    assert folder_of(plan, tmp_path).name == "low-ce032ed85d8d"


def test_a_shard_is_computed_in_one_batch(plan, tmp_path):
    few = replace(plan, rows=40, shard_rows=40, matched_filters="cpu")
    folder = generate(few, runs=tmp_path, engine=Serial())
    [shard] = folder.glob("*.npy")
    assert np.load(shard).tobytes() == records(few, range(40)).tobytes()


@pytest.mark.parametrize(
    "localizer",
    [
        Gated(WINDOW, 36),
        Gated(WINDOW, 36, echoes="auto"),
        Gated(WINDOW, 36, sign="either", whiten=True),
        Em(WINDOW, 36, echoes=2),
        Joint(WINDOW, echoes="auto"),
        Snls(WINDOW, 24),
    ],
)
def test_every_step_takes_the_filters_that_were_chosen(localizer, plan):
    """Filters twice as loud give echoes twice as loud, on any grid, whitened or not."""
    observation, _ = recordings_of(plan, range(8))
    observation = replace(observation, noise_psd=np.ones(442))
    loud = Filters(correlate=lambda *args, **about: 2 * signals.matched_filter(*args, **about))
    once, _ = localize(observation, localizer)
    twice, _ = localize(observation, localizer, filters=loud)
    assert_allclose(twice.toa, once.toa, rtol=1e-6)
    assert_allclose(twice.gain, 2 * once.gain, rtol=1e-3)


def test_what_is_not_there_is_one_line(plan, monkeypatch):
    monkeypatch.setattr(torch_device, "cuda_is_there", lambda: False)
    with refused("plan.matched_filters=cuda: must be on this machine; compiled and cpu need"):
        records(replace(plan, matched_filters="cuda"), range(2))
    with refused("plan.matched_filters=gpu: must be compiled, cuda or cpu"):
        replace(plan, matched_filters="gpu")
