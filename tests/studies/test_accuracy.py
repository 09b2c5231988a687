"""Which estimates are right, by hand; what a faulty array records; that conditions share noise."""

from dataclasses import replace

import numpy as np
import pytest

from echolearn.acoustics.geometry import SearchWindow, circular_array
from echolearn.acoustics.rooms import true_echoes
from echolearn.acoustics.signals import noise_probe
from echolearn.acoustics.types import Pose, Room
from echolearn.checks import BadValue
from echolearn.localization.methods.joint import Joint
from echolearn.localization.methods.snls import Snls
from echolearn.simulation.levels import NoiseLevels
from echolearn.simulation.noise.white import White
from echolearn.simulation.rir.images import Images
from echolearn.simulation.scene import Scene
from echolearn.studies.accuracy import METRICS, drawn_by_chance, is_right, strongest_echo
from echolearn.studies.recordings import FAULTS, Condition, Position, record

ROOM = Room((6.0, 5.0, 6.0), 0.25)
POSE = Pose(np.array([1.0, 1.5, 3.0]), heading=0.7)
RING = circular_array()
SCENE = Scene(RING, noise_probe(length=8000), Images(), White())
TRUTH = true_echoes(ROOM, POSE, array=RING)
SAMPLE = 1 / 22050


def recorded(*, fault="none", snr_db=20.0, number=3, stretch=None, trials=range(4), pose=POSE):
    condition = Condition(ROOM, NoiseLevels(snr_db), FAULTS[fault], stretch)
    return record(Position(number, pose, SCENE), condition, trials=list(trials), seed=0)


def right(*estimate, room=ROOM, pose=POSE, array=RING):
    """Return which metrics one estimate meets, by name."""
    scene = replace(SCENE, array=array)
    [found] = is_right(np.array([estimate]), room=room, pose=pose, scene=scene)
    return dict(zip(METRICS, found, strict=True))


@pytest.mark.parametrize("wall", range(4))
def test_the_truth_meets_every_metric(wall):
    assert set(right(TRUTH.toa[wall], TRUTH.azimuth[wall], np.pi / 2).values()) == {1.0}


@pytest.mark.parametrize(
    ("late", "aside", "metric", "expected"),
    [
        (4.9 * SAMPLE, 0.0, "toa", 1.0),
        (5.1 * SAMPLE, 0.0, "toa", 0.0),
        (0.0, np.radians(4.9), "doa", 1.0),
        (0.0, np.radians(-5.1), "doa", 0.0),
        (np.nan, np.nan, "toa", 0.0),
        (np.nan, np.nan, "on_map", 0.0),
    ],
)
def test_five_samples_and_five_degrees_are_the_limits(late, aside, metric, expected):
    assert right(TRUTH.toa[0] + late, TRUTH.azimuth[0] + aside, np.pi / 2)[metric] == expected


def test_another_walls_direction_counts_for_the_lenient_rule_only():
    found = right(TRUTH.toa[0], TRUTH.azimuth[2], np.pi / 2)
    assert found == {"toa": 1.0, "doa": 0.0, "doa_any": 1.0, "on_map": 0.0}


@pytest.mark.parametrize("elevation", [0.0, np.pi])
def test_a_planar_array_finds_the_floor_above_or_below(elevation):
    """A ceiling three times as far away shares nothing but the direction; a microphone off the
    plane can tell."""
    place = {"room": Room((10.0, 8.0, 5.0), 0.6), "pose": Pose(np.array([5.0, 4.0, 1.2]))}
    raised = RING.positions + 0.1 * (np.arange(6) == 2)[:, None] * [0.0, 0.0, 1.0]
    for array, doa in ((RING, True), (replace(RING, positions=raised), elevation == np.pi)):
        floor = true_echoes(**place, array=array).toa.min()
        found = right(floor, 0.3, elevation, array=array, **place)
        assert found == {"toa": 1.0, "doa": doa, "doa_any": 1.0, "on_map": 0.0}


@pytest.mark.parametrize("wall", [0, 2])
def test_of_walls_equally_late_the_one_in_that_direction_is_matched(wall):
    """Microphone 1 is as far from either wall of this corner."""
    place = {"pose": Pose(np.array([1.2, 1.2, 3.0])), "array": circular_array(offset=3.926990817)}
    truth = true_echoes(ROOM, **place)
    late = (truth.toa[0] + truth.toa[2]) / 2
    found = right(late, truth.azimuth[wall], np.pi / 2, **place)
    assert found["toa"] == found["doa"] == 1.0


def test_chance_is_the_share_of_window_and_circle_around_walls():
    window = SearchWindow()
    drawn = drawn_by_chance(SCENE, window, count=20_000, rng=np.random.default_rng(0))
    found = is_right(drawn, room=ROOM, pose=POSE, scene=SCENE).mean(axis=0)
    first, last = window.lags(RING, 22050.0)
    lags = np.linspace(first, last, 100_001)
    near = (np.abs(lags[:, None] - TRUTH.toa * 22050) < 5).any(axis=1).mean()
    np.testing.assert_allclose(found[:3], [near, 10 / 360, 40 / 360], atol=0.01)


def test_in_one_stretch_all_have_the_same_noise_wherever_they_stand():
    def noise(place, stretch):
        pose = Pose(POSE.position + np.array([0.1 * place, 0.0, 0.0]))
        trials = [2 * place, 2 * place + 1]
        samples = recorded(
            snr_db=0.0, number=place, stretch=stretch, trials=trials, pose=pose
        ).samples
        received = SCENE.received(ROOM, pose)
        return (samples - received + SCENE.direct) / received.std(axis=-1, keepdims=True)

    here, there, other, own = noise(0, 7), noise(1, 7), noise(0, 8), noise(0, None)
    np.testing.assert_allclose(here[0], here[1], atol=1e-9)
    np.testing.assert_allclose(here, there, rtol=1e-4, atol=1e-4)
    assert abs(np.corrcoef(here[0, 0], other[0, 0])[0, 1]) < 0.1
    assert abs(np.corrcoef(own[0, 0], own[1, 0])[0, 1]) < 0.1


def test_conditions_share_their_noise_which_has_the_density_told():
    quiet, loud, clean = (recorded(snr_db=level) for level in (20.0, 0.0, 100.0))
    noise = loud.samples - clean.samples
    np.testing.assert_allclose(noise / 10.0, quiet.samples - clean.samples, rtol=2e-4, atol=1e-12)
    np.testing.assert_allclose(loud.noise_psd.mean(axis=-1), noise.var(axis=(0, 2)), rtol=0.05)


def test_a_dead_microphone_is_silent_and_the_joint_search_does_without_it():
    observation = recorded(fault="one_dead")
    assert (observation.samples.std(axis=-1) == 0).sum(axis=1).tolist() == [1, 1, 1, 1]
    found = strongest_echo(Joint(), observation)
    assert is_right(found, room=ROOM, pose=POSE, scene=SCENE)[:, 0].all()


def test_what_refuses_a_dead_reference_is_wrong_where_that_is_allowed():
    deaf = recorded(fault="one_dead", number=0)
    assert deaf.samples[0, 0].std() == 0
    assert np.isnan(strongest_echo(Snls(), deaf, may_refuse=True)).all()
    with pytest.raises(BadValue, match="microphone 1"):
        strongest_echo(Snls(), deaf)


def test_gains_and_displacements_have_their_size():
    quiet = {"trials": [0], "snr_db": 60.0}
    healthy, louder, moved = (
        recorded(fault=fault, **quiet) for fault in ("none", "gains_3dB", "positions_5mm")
    )
    ratio_db = 20 * np.log10(louder.samples.std(axis=-1) / healthy.samples.std(axis=-1))
    assert 0.5 < ratio_db.std() < 8.0
    assert moved.array is RING
    change = np.std(moved.samples - healthy.samples) / healthy.samples.std()
    assert 0.05 < change < 1.5
