"""Which estimates hit, by hand; what a faulty array hears; that conditions share their noise."""

from dataclasses import replace

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow, circular_array, true_echoes
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Observation, Pose, Room
from echolearn.checks import BadValue
from echolearn.localization.methods.joint import Joint
from echolearn.localization.methods.snls import Snls
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.white import White
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.studies.trials import FAULTS, GUESSES, METRICS, Condition, Fault, Trials, guess, hits

ROOM = Room((6.0, 5.0, 6.0), 0.25)
POSE = Pose(np.array([1.0, 1.5, 3.0]), heading=0.7)
RING = circular_array()
SCENE = Scene(RING, noise_probe(length=8000), Images(), White())
SILENCE = Observation(np.zeros((1, 6, 8000)), SCENE.probe, RING)


def trials(*, fault="none", snr_db=20.0, numbers=range(4), scene=SCENE):
    return Trials(
        Condition(ROOM, NoiseLevels(snr_db), FAULTS[fault]), scene, POSE, 3, list(numbers), 0
    )


def judged(toa, azimuth, elevation=np.pi / 2):
    """Return the metrics of one estimate by name."""
    [found] = hits(np.array([[toa, azimuth, elevation]]), ROOM, POSE, SILENCE)
    return dict(zip(METRICS, found, strict=True))


def test_the_truth_hits_everything():
    truth = true_echoes(ROOM, POSE, RING)
    for wall in range(4):
        assert set(judged(truth.toa[wall], truth.azimuth[wall]).values()) == {1.0}


def test_five_samples_and_five_degrees_are_the_limits():
    truth = true_echoes(ROOM, POSE, RING)
    toa, azimuth = truth.toa[0], truth.azimuth[0]
    assert judged(toa + 4.9 / 22050, azimuth)["toa"] == 1.0
    assert judged(toa + 5.1 / 22050, azimuth)["toa"] == 0.0
    assert judged(toa, azimuth + np.radians(4.9))["doa"] == 1.0
    assert judged(toa, azimuth - np.radians(5.1))["doa"] == 0.0


def test_another_walls_direction_counts_for_the_lenient_rule_only():
    truth = true_echoes(ROOM, POSE, RING)
    assert judged(truth.toa[0], truth.azimuth[2]) == {
        "toa": 1.0,
        "doa": 0.0,
        "doa_any": 1.0,
        "on_map": 0.0,
    }


@pytest.mark.parametrize("elevation", [0.0, np.pi])
def test_a_planar_array_finds_the_floor_above_or_below(elevation):
    """A ceiling three times as far away shares nothing but the direction; a microphone off the
    plane can tell."""
    room, pose = Room((10.0, 8.0, 5.0), 0.6), Pose(np.array([5.0, 4.0, 1.2]))
    raised = RING.positions + 0.1 * (np.arange(6) == 2)[:, None] * [0.0, 0.0, 1.0]
    for array, right in ((RING, True), (replace(RING, positions=raised), elevation == np.pi)):
        floor = true_echoes(room, pose, array).toa.min()
        [found] = hits(
            np.array([[floor, 0.3, elevation]]), room, pose, replace(SILENCE, array=array)
        )
        assert dict(zip(METRICS, found, strict=True)) == {
            "toa": 1.0,
            "doa": right,
            "doa_any": 1.0,
            "on_map": 0.0,
        }


def test_of_walls_equally_late_the_one_in_that_direction_is_matched():
    pose = Pose(np.array([1.2, 1.2, 3.0]))
    truth = true_echoes(ROOM, pose, RING)
    late = (truth.toa[0] + truth.toa[2]) / 2
    assert abs(truth.toa[0] - truth.toa[2]) * 22050 < 30
    array = circular_array(offset=np.radians(225.0))  # as far from either wall
    truth, silence = true_echoes(ROOM, pose, array), replace(SILENCE, array=array)
    late = (truth.toa[0] + truth.toa[2]) / 2
    estimates = np.array([[late, truth.azimuth[wall], np.pi / 2] for wall in (0, 2)])
    np.testing.assert_array_equal(hits(estimates, ROOM, pose, silence)[:, :2], 1.0)


def test_in_one_stretch_all_hear_the_same_noise_wherever_they_stand():
    def noise(place, stretch):
        pose = Pose(POSE.position + np.array([0.1 * place, 0.0, 0.0]))
        condition = Condition(ROOM, NoiseLevels(0.0), FAULTS["none"], stretch=stretch)
        received = SCENE.received(ROOM, pose)
        heard = (
            Trials(condition, SCENE, pose, place, [2 * place, 2 * place + 1], 0).record().samples
        )
        noises = heard - received + SCENE.direct
        return noises / np.sqrt(np.mean(received**2, axis=-1, keepdims=True))

    here, there, other = noise(0, 7), noise(1, 7), noise(0, 8)
    np.testing.assert_allclose(here[0], here[1], atol=1e-9)
    np.testing.assert_allclose(here, there, atol=1e-9)
    assert abs(np.corrcoef(here[0, 0], other[0, 0])[0, 1]) < 0.1
    alone = noise(0, None)
    assert abs(np.corrcoef(alone[0, 0], alone[1, 0])[0, 1]) < 0.1


def test_what_was_refused_misses():
    assert set(judged(np.nan, np.nan, np.nan).values()) == {0.0}


def test_chance_is_the_share_of_window_and_circle_around_walls():
    truth, window = true_echoes(ROOM, POSE, RING), SearchWindow()
    estimates = guess(
        replace(SILENCE, samples=np.zeros((400, 6, 1))), window, np.random.default_rng(0)
    )
    assert len(estimates) == 400 * GUESSES
    found = hits(estimates, ROOM, POSE, SILENCE).mean(axis=0)
    first, last = window.lags(RING, 22050.0, 343.0)
    lags = np.linspace(first, last, 100_001)
    near = (np.abs(lags[:, None] - truth.toa * 22050) < 5).any(axis=1).mean()
    assert found[0] == pytest.approx(near, abs=0.01)
    assert found[1] == pytest.approx(10 / 360, abs=0.005)
    assert found[2] == pytest.approx(4 * 10 / 360, abs=0.01)


def test_conditions_share_their_noise():
    quiet, loud = (trials(snr_db=level).record().samples for level in (20.0, 0.0))
    clean = trials(snr_db=100.0).record().samples
    np.testing.assert_allclose((loud - clean) / 10.0, quiet - clean, rtol=2e-4, atol=1e-12)


def test_a_dead_microphone_is_silent_and_the_joint_search_does_without_it():
    heard = trials(fault="one_dead").record().samples
    assert (heard.std(axis=-1) == 0).sum(axis=1).tolist() == [1, 1, 1, 1]
    found = trials(fault="one_dead").judge([Joint(), Snls()], SearchWindow())
    assert found.shape == (4, 3, 4)
    assert found[:, 0, 0].tolist() == [1.0] * 4


def test_a_dead_reference_makes_s_nls_miss_and_nothing_fail():
    condition = Condition(ROOM, NoiseLevels(20.0), Fault(dead=1))
    places = (Trials(condition, SCENE, POSE, place, [0], 0) for place in range(100))
    deaf = next(trial for trial in places if trial.record().samples[0, 0].std() == 0)
    with pytest.raises(BadValue, match="microphone 1"):
        Snls()(deaf.record())
    assert deaf.judge([Snls()], SearchWindow())[0, 0].tolist() == [0.0] * 4


def test_gains_and_displacements_have_their_size():
    gains = trials(fault="gains_3dB", numbers=[0], snr_db=60.0).record().samples
    plain = trials(numbers=[0], snr_db=60.0).record().samples
    ratio_db = 20 * np.log10(gains.std(axis=-1) / plain.std(axis=-1))
    assert 0.5 < ratio_db.std() < 8.0
    moved = trials(fault="positions_5mm", numbers=[0], snr_db=60.0).record()
    assert moved.array is RING
    assert 0.05 < np.std(moved.samples - plain) / plain.std() < 1.5


def test_the_noise_alone_has_its_density():
    record = trials(snr_db=0.0).record()
    clean = trials(snr_db=100.0).record()
    power = (record.samples - clean.samples).var(axis=(0, 2))
    np.testing.assert_allclose(record.noise_psd.mean(axis=-1), power, rtol=0.05)
