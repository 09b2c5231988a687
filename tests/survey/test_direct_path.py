"""The direct path: where geometry puts it, as loud as it was, and gone afterwards."""

from dataclasses import replace

import numpy as np
import pytest

from echolearn.acoustics.geometry import circular_array
from echolearn.acoustics.signals import matched_filter, noise_probe, power
from echolearn.acoustics.types import MicArray, Observation, Pose, Probe, Room
from echolearn.localization.methods.gated import Gated
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.survey import direct_path

PROBE = noise_probe(length=6000)
ARRAY = circular_array()


def test_whole_samples_are_shifts():
    """Ten samples of way: the burst, ten samples later."""
    array = MicArray(np.array([[10 * 343.0 / 22050.0, 0, 0], [0, 0, 0]]))
    arrived = direct_path.delayed(PROBE, array, speed_of_sound=343.0)
    padded = np.pad(PROBE.samples, (0, 4500))
    assert np.allclose(arrived[0], np.roll(padded, 10), atol=1e-9)
    assert np.allclose(arrived[1], padded, atol=1e-9)


def test_a_tone_arrives_with_the_phase_of_its_way():
    """Half a sample, say, which no shift can give."""
    n = np.arange(2000)
    tone = Probe(np.sin(2 * np.pi * 0.05 * n) * np.hanning(2000), 22050.0, 4000)
    way = 13.37
    arrived = direct_path.delayed(
        tone, MicArray(np.array([[way * 343.0 / 22050.0, 0, 0]])), speed_of_sound=343.0
    )[0]
    expected = np.sin(2 * np.pi * 0.05 * (n - way)) * np.interp(n - way, n, np.hanning(2000))
    assert np.abs(arrived[20:1900] - expected[20:1900]).max() < 1e-4


@pytest.mark.parametrize("gain", [0.01, 1.0, 30.0])
def test_whatever_the_gain_nothing_is_left_of_it(gain):
    arrived = direct_path.delayed(PROBE, ARRAY, speed_of_sound=343.0)
    sensitivity = gain * np.array([1.0, 0.7, 1.4, 1.0, 0.9, -1.1])[:, None]
    left = direct_path.remove(sensitivity * arrived, arrived)
    assert np.abs(left).max() < 1e-9 * gain
    free = arrived / (4 * np.pi * 0.2)
    assert (
        np.abs(direct_path.remove(free, arrived, gain=direct_path.free_field(ARRAY))).max() < 1e-9
    )


def test_a_simulated_room_sounds_as_if_there_had_been_none():
    """The simulation's own direct path is another computation: image sources on an oversampled
    grid."""
    scene = Scene(ARRAY, PROBE, Images(), None)
    room, pose = Room((6.0, 5.0, 4.0), 0.25), Pose(np.array([1.4, 2.5, 2.0]), 0.7)
    received = scene.received(room, pose)
    without = received - scene.direct
    left = direct_path.remove(received, direct_path.delayed(PROBE, ARRAY, speed_of_sound=343.0))
    assert power(left - without).mean() < 4e-3 * power(scene.direct).mean()
    echoes = [Gated()(Observation(samples[None], PROBE, ARRAY)) for samples in (without, left)]
    assert echoes[0].toa == echoes[1].toa and echoes[0].azimuth == echoes[1].azimuth
    assert echoes[1].score == pytest.approx(echoes[0].score, abs=0.02)
    early = matched_filter(received, PROBE, first=5, last=25)
    assert np.abs(matched_filter(left, PROBE, first=5, last=25)).max() < 0.05 * np.abs(early).max()


def test_a_batch_is_each_of_it_and_nothing_is_changed_in_place():
    samples = np.random.default_rng(0).standard_normal((3, 6, 6000))
    before = samples.copy()
    arrived = direct_path.delayed(PROBE, ARRAY, speed_of_sound=343.0)
    together = direct_path.remove(samples, arrived)
    for one, alone in zip(together, samples, strict=True):
        assert np.allclose(one, direct_path.remove(alone, arrived))
    assert np.array_equal(samples, before)


def test_another_speed_of_sound_is_another_time():
    slow = direct_path.delayed(PROBE, ARRAY, speed_of_sound=171.5)
    wide = replace(ARRAY, positions=2 * ARRAY.positions)
    assert np.allclose(slow, direct_path.delayed(PROBE, wide, speed_of_sound=343.0))
